"""Which class each photographed object is."""

from difflib import get_close_matches

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
            try:
                classes[name] = classifier.class_index(read_spec(specs[name]).class_name)
            except ToolkitError as error:
                raise ToolkitError(f"{specs[name]}: {error}") from None
        else:
            classes[name] = _class_of_folder(name, folder, sorted(specs), classifier)
    return classes


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
