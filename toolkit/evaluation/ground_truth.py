"""What is evaluated: the images of a capture folder, clean and corrupted, and the true class of each object."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

from toolkit.captures.capture import Capture
from toolkit.captures.corrupted_copy import Corruption, name_source
from toolkit.captures.manifest import GATES_FILE
from toolkit.captures.read import CaptureFolder, read_captures
from toolkit.core.errors import ToolkitError
from toolkit.core.rooms import explain_missing, find_offer
from toolkit.core.tables import format_test
from toolkit.core.workspace import Workspace
from toolkit.corruptions.catalogue import find_note
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.metrics import Comparison
from toolkit.models.network import Classifier
from toolkit.objects.spec import read_spec

if TYPE_CHECKING:
    import torch

    from toolkit.captures.dataset import CaptureDataset


def describe_both(all_of_it: Sequence[Comparison], passed: Sequence[Comparison], n_failed: dict[str, int]) -> list[str]:
    """For each source with failed photographs, each pooled comparison with them and without them, one line each."""
    without = {(row.source, row.object, row.second): row for row in passed}
    lines = []
    for row in all_of_it:
        if row.object != "all" or not n_failed.get(row.source):
            continue
        other = without.get((row.source, row.object, row.second))
        rest = "no pair is left" if other is None else _describe(other)
        lines.append(
            f"{row.source}: {n_failed[row.source]} photograph{'s' if n_failed[row.source] > 1 else ''} failed a gate. "
            f"{row.second} with them: "
            f"{_describe(row)}; without them: {rest}"
        )
    return lines


def _describe(row: Comparison) -> str:
    found = row.outcomes
    shares = f"{found.n_first}/{found.n} right bare, {found.n_second}/{found.n} with it"
    return f"{shares}, {found.only_second} gained, {found.only_first} lost ({format_test(found.mcnemar_p)})"


def read_labelled_captures(
    captures_dir: Path, workspace: Workspace, classifier: Classifier, config: EvalConfig
) -> tuple[CaptureFolder, dict[str, int]]:
    """The images to classify, and the true class of every object among them.

    An object whose spec names a class that the network does not have is left out with a note.

    Args:
        captures_dir: `captures/`, one of its sources, one object's folder, or an ImageFolder.
        workspace: whose object specs say what each object is.
        classifier: whose classes are meant.
        config: which sources, objects and variants are meant, and under which corruptions besides.

    Raises:
        ToolkitError: no images, no object whose class the network knows, a folder that is no object, or a broken
            manifest.
    """
    folder = read_captures(captures_dir, config.selection, trust_files=config.trust_files)
    folder = leave_out_unknown(folder, workspace, classifier)
    folder = add_corrupted(_mark_gates(folder), config.corruptions)
    return folder, find_true_classes(folder, workspace, classifier)


def _mark_gates(folder: CaptureFolder) -> CaptureFolder:
    """The captures with the gates that their photographs failed, which the room of photographs knows."""
    mark = find_offer("failed gates")
    if mark is not None:
        return mark(folder)
    judged = sorted({capture.source for capture in folder.captures if (capture.source_dir / GATES_FILE).is_file()})
    notes = [f"{explain_missing('failed gates')} ({', '.join(judged)})"] if judged else []
    return replace(folder, notes=(*folder.notes, *notes))


def add_corrupted(folder: CaptureFolder, corruptions: Sequence[Corruption]) -> CaptureFolder:
    """The folder with each source once more under each corruption: `sim` in fog of severity 3 is source `sim-fog-3`.

    Nothing is read here: an image is corrupted whenever it is read, see `read_pixels`. A source of the folder that has
    the name already keeps it, and the other gets a `+`. Files that are corrupted already, by the
    manifest, are not corrupted again; a note says so.

    Args:
        folder: what is evaluated.
        corruptions: (name, severity) of each.
    """
    if not corruptions:
        return folder
    clean = [capture for capture in folder.captures if capture.corruption is None]
    taken = {capture.source for capture in folder.captures}
    corrupted = sorted(taken - {prediction.source for prediction in clean})
    made: list[Capture] = []
    for source in dict.fromkeys(prediction.source for prediction in clean):
        for corruption in corruptions:
            name = name_source(source, corruption)
            # a folder of that name may be there already, corrupted into files
            while name in taken:
                name += "+"
            taken.add(name)
            made += [
                replace(prediction, source=name, path=f"{name}/{prediction.path_in_source}", corruption=corruption)
                for prediction in clean
                if prediction.source == source
            ]
    notes = [f"corrupted already, and not once more: {', '.join(corrupted)}"] if corrupted else []
    notes += [note] if (note := find_note(list(dict.fromkeys(name for name, _ in corruptions)))) else []
    captures = sorted((*folder.captures, *made), key=lambda one: (one.source, one.object, one.variant, one.path))
    return replace(folder, captures=tuple(captures), notes=(*folder.notes, *notes))


def find_true_classes(folder: CaptureFolder, workspace: Workspace, classifier: Classifier) -> dict[str, int]:
    """Class index of every object of a capture folder: from its spec, its manifest, else the name of its folder.

    A folder's name may be a class name, with spaces or underscores, or a WordNet id as in ImageNet's own folders.

    Raises:
        ToolkitError: an object is neither known nor named for a class, or its spec's class is none of the network's.
    """
    specs = workspace.object_specs()
    classes = {}
    for name in folder.objects:
        if name in specs:
            classes[name] = class_of_spec(specs[name], classifier)
            continue
        # what the manifest says comes before the folder's name
        said = next(
            (capture.class_name for capture in folder.captures if capture.object == name and capture.class_name), None
        )
        if said is not None:
            classes[name] = classifier.class_index(int(said) if said.isdecimal() else said)
        else:
            classes[name] = _class_of_folder(name, folder, sorted(specs), classifier)
    return classes


def find_other_classes(folder: CaptureFolder, classes: dict[str, int], classifier: Classifier) -> list[str]:
    """Return a line for each object that was captured as one class and is judged as another.

    Args:
        folder: images, with the class that their manifest states.
        classes: from `find_true_classes`.
        classifier: whose classes are meant.
    """
    said: dict[tuple[str, str], int] = Counter(
        (capture.object, capture.class_name) for capture in folder.captures if capture.class_name
    )
    lines = []
    for (name, spelling), count in said.items():
        try:
            index = classifier.class_index(int(spelling) if spelling.isdecimal() else spelling)
        except ToolkitError:
            continue
        if index != classes[name]:
            lines.append(
                f"{name}: {count} image{'s' if count > 1 else ''} captured as '{spelling}' and judged as "
                f"'{classifier.labels[classes[name]]}', which its spec names now"
            )
    return lines


def leave_out_unknown(folder: CaptureFolder, workspace: Workspace, classifier: Classifier) -> CaptureFolder:
    """The folder without the objects whose spec names a class that the network does not have; a note tells of each.

    Raises:
        ToolkitError: the network knows the class of none of the objects, or a spec is broken.
    """
    specs = workspace.object_specs()
    reasons = {}
    for name in folder.objects:
        if name in specs:
            wanted = read_spec(specs[name]).class_name
            try:
                classifier.class_index(wanted)
            except ToolkitError as error:
                reasons[name] = f"{specs[name]}: {error}"
    if not reasons:
        return folder
    if len(reasons) == len(folder.objects):
        raise ToolkitError(
            f"{next(iter(reasons.values()))}: {classifier.name} knows none of the objects in {folder.root}"
        )
    counts = Counter(capture.object for capture in folder.captures)
    notes = [
        f"{counts[name]} image{'s' if counts[name] > 1 else ''} of '{name}' left out, {classifier.name} does not know "
        f"its class: {reason}"
        for name, reason in reasons.items()
    ]
    kept = tuple(capture for capture in folder.captures if capture.object not in reasons)
    return replace(folder, captures=kept, notes=(*folder.notes, *notes))


def class_of_spec(spec_file: Path, classifier: Classifier) -> int:
    """Class index of an object by its spec.

    Raises:
        ToolkitError: the spec is broken, or its class is none of the network's.
    """
    name = read_spec(spec_file).class_name
    try:
        return classifier.class_index(name)
    except ToolkitError as error:
        raise ToolkitError(f"{spec_file}: {error}") from None


def _class_of_folder(name: str, folder: CaptureFolder, specs: list[str], classifier: Classifier) -> int:
    why = ""
    # a folder called `12` is a name, not an index: only a spec may give a class by its number
    for spelling in dict.fromkeys((name, name.replace("_", " "))) if not name.isdecimal() else ():
        try:
            return classifier.class_index(spelling)
        except ToolkitError as error:
            # that a name means several classes says more than a guess at its spelling
            why = str(error) if str(error).startswith("several") else why
    where = next(capture.path for capture in folder.captures if capture.object == name)
    near = get_close_matches(name, [*specs, *classifier.labels], n=3)
    hint = why or (f"did you mean {' or '.join(near)}?" if near else f"known objects: {', '.join(specs)}.")
    raise ToolkitError(
        f"{folder.root}: no object or class called '{name}' ({where}): {hint} Rename the folder, "
        f'or say what it shows with class = "..." in rig/objects/{name}.toml'
    )


def load_captures(
    workspace: Workspace, classifier: Classifier, captures_dir: Path | str | None = None, *,
    sources: Sequence[str] = (), objects: Sequence[str] = (), variants: Sequence[str] = (),
    transform: "Callable[[torch.Tensor], torch.Tensor] | None" = None,
) -> "CaptureDataset":  # fmt: skip
    """Captures as a `torch.utils.data.Dataset` of `(image, target, info)`, for a `DataLoader` with any workers.

    `image` is (3, s, s) float32, sRGB-encoded in [0, 1], resized and cut as the classifier wants it, not normalised;
    `target` the index of the object's class among the classifier's; `info` a dict of path, source, object, variant,
    pose_id and T_world_camera. An object whose class the classifier does not have is left out.

    Args:
        workspace: whose object specs say what each object is.
        classifier: whose classes and preprocessing are meant.
        captures_dir: a folder of images, SOURCE/OBJECT/VARIANT/FILE; by default the workspace's `captures/`.
        sources: only these; all by default, as for the next two.
        objects: only these.
        variants: only these.
        transform: of each finished image; with workers it must be picklable.

    Raises:
        ToolkitError: no images, a name that is not there, an object that is neither known nor named for a class, or
            none whose class the classifier has.
    """
    from toolkit.captures.dataset import CaptureDataset  # which loads torch

    config = EvalConfig(sources=tuple(sources), objects=tuple(objects), variants=tuple(variants))
    root = Path(captures_dir or workspace.captures_dir)
    folder, targets = read_labelled_captures(root, workspace, classifier, config)
    return CaptureDataset(folder, targets, classifier.preprocessing, transform)
