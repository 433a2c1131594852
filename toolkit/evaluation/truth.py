"""Which class each photographed object is."""

from collections import Counter
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from toolkit.captures.read import CaptureFolder
from toolkit.classifiers.network import Classifier
from toolkit.errors import ToolkitError
from toolkit.objects.spec import read_spec
from toolkit.workspace import Workspace


def find_true_classes(folder: CaptureFolder, workspace: Workspace, classifier: Classifier) -> dict[str, int]:
    """Class index of every object of a capture folder: from its spec, else from the name of its folder.

    A folder's name may be a class name, with spaces or underscores, or a WordNet id as in ImageNet's own folders.

    Raises:
        ToolkitError: an object is neither known nor named for a class, or its spec's class is none of the network's.
    """
    specs = workspace.object_specs()
    classes = {}
    for name in folder.objects:
        if name in specs:
            classes[name] = class_of_spec(specs[name], classifier)
        else:
            classes[name] = _class_of_folder(name, folder, sorted(specs), classifier)
    return classes


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
    counts = Counter(one.object for one in folder.captures)
    notes = [
        f"{counts[name]} image{'s' if counts[name] > 1 else ''} of '{name}' left out, {classifier.name} does not know "
        f"its class: {reason}"
        for name, reason in reasons.items()
    ]
    kept = tuple(one for one in folder.captures if one.object not in reasons)
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
            why = str(error) if str(error).startswith("several") else why
    where = next(capture.path for capture in folder.captures if capture.object == name)
    near = get_close_matches(name, [*specs, *classifier.labels], n=3)
    hint = why or (f"did you mean {' or '.join(near)}?" if near else f"known objects: {', '.join(specs)}")
    raise ToolkitError(
        f"{folder.root}: no object or class called '{name}' ({where}): {hint} Rename the folder, "
        f'or say what it shows with class = "..." in rig/objects/{name}.toml'
    )
