"""The images of a capture folder to evaluate, clean and corrupted, and the true class of each object."""

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
from toolkit.core.lazy import torch
from toolkit.core.rooms import explain_missing, find_offer
from toolkit.core.tables import format_test
from toolkit.core.text import count_of
from toolkit.core.workspace import Workspace
from toolkit.corruptions.catalogue import find_note
from toolkit.evaluation import EvalConfig
from toolkit.evaluation.metrics import Comparison
from toolkit.models.network import Classifier
from toolkit.objects.spec import read_spec

if TYPE_CHECKING:
    from toolkit.captures.dataset import CaptureDataset


def describe_both(all_of_it: Sequence[Comparison], passed: Sequence[Comparison], n_failed: dict[str, int]) -> list[str]:
    """Return a line for each pooled comparison of sources with failed photographs: with and without them."""
    # the same comparison without photographs that failed a gate
    without = {(row.source, row.object, row.second): row for row in passed}
    lines = []
    for row in all_of_it:
        if row.object != "all" or not n_failed.get(row.source):
            continue
        other = without.get((row.source, row.object, row.second))
        rest = "no pair is left" if other is None else _describe(other)
        lines.append(
            f"{row.source}: {count_of(n_failed[row.source], 'photograph')} failed a gate. "
            f"{row.second} with them: {_describe(row)}; without them: {rest}"
        )
    return lines


def _describe(row: Comparison) -> str:
    found = row.outcomes
    shares = f"{found.n_first}/{found.n} correct without it, {found.n_second}/{found.n} with it"
    return f"{shares}, {found.only_second} gained, {found.only_first} lost ({format_test(found.mcnemar_p)})"


def read_labelled_captures(
    captures_dir: Path, workspace: Workspace, classifier: Classifier, config: EvalConfig
) -> tuple[CaptureFolder, dict[str, int]]:
    """Return the images to classify, and the true class of every object among them.

    Objects whose class the network does not have are left out with a note. Arguments and errors are those of
    `evaluate_captures`.
    """
    folder = read_captures(captures_dir, config.selection, trust_files=config.trust_files)
    folder = leave_out_unknown(folder, workspace, classifier)
    # the room of photographs, which is loaded only here, knows the gates that a photograph failed
    places = {(item.source_dir, item.source) for item in folder.captures}
    if judged := sorted({source for place, source in places if (place / GATES_FILE).is_file()}):
        if mark := find_offer("failed gates"):
            folder = mark(folder)
        else:
            note = f"{explain_missing('failed gates')} ({', '.join(judged)})"
            folder = replace(folder, notes=(*folder.notes, note))
    folder = add_corrupted(folder, config.corruptions)
    return folder, find_true_classes(folder, workspace, classifier)


def add_corrupted(folder: CaptureFolder, corruptions: Sequence[Corruption]) -> CaptureFolder:
    """Add each source under each (name, severity) to a folder: `sim` in fog of severity 3 is source `sim-fog-3`.

    Nothing is read here: `read_pixels` corrupts an image when it reads it. If the folder has a source of that name, the
    added source gets a `+`. Files that are corrupted, by the manifest, are not corrupted again; a note states it.
    """
    if not corruptions:
        return folder
    # what is corrupted in its file is not corrupted again
    clean = [capture for capture in folder.captures if capture.corruption is None]
    taken = {capture.source for capture in folder.captures}
    corrupted = sorted(taken - {capture.source for capture in clean})
    made: list[Capture] = []
    for source in dict.fromkeys(capture.source for capture in clean):
        for corruption in corruptions:
            name = name_source(source, corruption)
            # a folder of that name may be there already, corrupted into files
            while name in taken:
                name += "+"
            taken.add(name)
            own = [capture for capture in clean if capture.source == source]
            paths = [f"{name}/{capture.path_in_source}" for capture in own]
            made += [
                replace(capture, source=name, path=path, corruption=corruption)
                for capture, path in zip(own, paths, strict=True)
            ]
    # notes on corrupted files, and on corruptions that are not published
    notes = [f"not corrupted again, as they are corrupted: {', '.join(corrupted)}"] if corrupted else []
    notes += [note] if (note := find_note(list(dict.fromkeys(name for name, _ in corruptions)))) else []
    # among the captures, as if they lay there as files
    captures = sorted((*folder.captures, *made), key=lambda item: (item.source, item.object, item.variant, item.path))
    return replace(folder, captures=tuple(captures), notes=(*folder.notes, *notes))


def find_true_classes(folder: CaptureFolder, workspace: Workspace, classifier: Classifier) -> dict[str, int]:
    """Return the class index of every object of a capture folder, by its spec, its manifest, or its folder's name.

    A folder's name may be a class name, with spaces or underscores, or a WordNet id as in ImageNet's own folders.

    Raises:
        ToolkitError: an object has neither a spec nor a class name, or the network does not have its class.
    """
    specs = workspace.object_specs()
    classes = {}
    # by the spec first
    for name in folder.objects:
        if name in specs:
            classes[name] = class_of_spec(specs[name], classifier)
            continue
        # the manifest comes before the folder's name
        said = [item.class_name for item in folder.captures if item.object == name and item.class_name]
        if said:
            classes[name] = classifier.class_index(int(said[0]) if said[0].isdecimal() else said[0])
        else:
            classes[name] = _class_of_folder(name, folder, sorted(specs), classifier)
    return classes


def find_other_classes(folder: CaptureFolder, classes: dict[str, int], classifier: Classifier) -> list[str]:
    """Return a line for each object whose class in the manifest differs from `classes`, of `find_true_classes`."""
    # classes that the manifests state, with their number of images
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
                f"{name}: {count_of(count, 'image')} captured as '{spelling}' and judged as "
                f"'{classifier.labels[classes[name]]}', the class in its spec now"
            )
    return lines


def leave_out_unknown(folder: CaptureFolder, workspace: Workspace, classifier: Classifier) -> CaptureFolder:
    """Return the folder without objects whose class the network does not have, with a note on each.

    Raises:
        ToolkitError: the network has no object's class, or a spec is broken.
    """
    specs = workspace.object_specs()
    reasons = {}
    # only a spec can name an unknown class: other names are errors
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
        f"{count_of(counts[name], 'image')} of '{name}' left out, {classifier.name} does not know its class: {reason}"
        for name, reason in reasons.items()
    ]
    kept = tuple(capture for capture in folder.captures if capture.object not in reasons)
    return replace(folder, captures=kept, notes=(*folder.notes, *notes))


def class_of_spec(spec_file: Path, classifier: Classifier) -> int:
    """Return the class index of an object by its spec; a `ToolkitError` if the network does not have it."""
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
            # that a name means several classes tells more than a similar spelling
            why = str(error) if str(error).startswith("several") else why
    where = next(capture.path for capture in folder.captures if capture.object == name)
    near = get_close_matches(name, [*specs, *classifier.labels], n=3)
    hint = why or (f"did you mean {' or '.join(near)}?" if near else f"known objects: {', '.join(specs)}.")
    raise ToolkitError(
        f"{folder.root}: no object or class called '{name}' ({where}): {hint} Rename the folder, "
        f'or name its class with class = "..." in rig/objects/{name}.toml'
    )


def load_captures(
    workspace: Workspace, classifier: Classifier, captures_dir: Path | str | None = None, *,
    sources: Sequence[str] = (), objects: Sequence[str] = (), variants: Sequence[str] = (),
    transform: "Callable[[torch.Tensor], torch.Tensor] | None" = None,
) -> "CaptureDataset":  # fmt: skip
    """Return captures as a `torch.utils.data.Dataset` of `(image, target, info)`, for a `DataLoader` with any workers.

    `image` is (3, s, s) float32, sRGB-encoded in [0, 1], resized and cut for the classifier, not normalised. `target`
    is the index of the object's class. `info` is a dict of path, source, object, variant, pose_id and T_world_camera.
    Objects whose class the classifier does not have are left out.

    Args:
        workspace: workspace with the object specs.
        classifier: classifier with the classes and the preprocessing.
        captures_dir: a folder of images, SOURCE/OBJECT/VARIANT/FILE; by default the workspace's `captures/`.
        sources: only these; all by default.
        objects: likewise.
        variants: likewise.
        transform: transform of each finished image; with workers it must be picklable.

    Raises:
        ToolkitError: there are no images, a name does not exist, an object has neither a spec nor a class name, or the
            classifier has no object's class.
    """
    from toolkit.captures.dataset import CaptureDataset  # which loads torch

    config = EvalConfig(sources=tuple(sources), objects=tuple(objects), variants=tuple(variants))
    root = Path(captures_dir or workspace.captures_dir)
    folder, targets = read_labelled_captures(root, workspace, classifier, config)
    return CaptureDataset(folder, targets, classifier.preprocessing, transform)
