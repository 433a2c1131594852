"""Classes in words: names and templates from the files that people have, and the prompts that they make."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import explain_validation, load_json
from toolkit.core.text import list_some
from toolkit.models.labels import LabelsFile, find_labels, read_lines, read_names

DEFAULT_TEMPLATE = "a photo of a {}."
"""Template of Radford et al. (2021), section 3.1.4."""
PLACE = re.compile(r"\{\w*\}")
"""Place of the class: `{}`, or CLIP_benchmark's `{c}`."""
SHOWN = 5
"""Most names in a message."""


def read_class_names(file: Path, dataset: str | None = None) -> list[str]:
    """Read names of classes from the lines of a text file, or from JSON.

    JSON holds any list that `find_labels` knows, or data sets with their lists (CLIP_benchmark's
    `--custom_classname_file`), of which `dataset` names a data set.

    Raises:
        ToolkitError: there are fewer than two names, a name stands twice, or the file holds something else.
    """
    if file.suffix == ".json":
        content = load_json(file)
        names = find_labels(content)
        if names is None:
            names = find_labels(_pick(file, content, dataset)) or []
    else:
        names = read_names(file)
    names = [name.strip() for name in names]
    if len(names) < 2 or not all(names):
        found = "an empty name" if len(names) > 1 else len(names)
        raise ToolkitError(f"{file}: expected the names of at least two classes, found {found}")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ToolkitError(f"{file}: the class '{twice}' stands twice: remove either")
    try:
        return list(LabelsFile(labels=names).labels or [])
    except ValidationError as error:
        raise ToolkitError(f"{file}: {explain_validation(error)}") from None


def make_prompts(names: list[str], file: Path | None, dataset: str | None = None) -> dict[str, list[str]]:
    """Return the prompts of each class.

    Args:
        names: names of the classes.
        file: lines of templates, or JSON: a list of templates, prompts by class (as CuPL's), or data sets with either
            (CLIP_benchmark's `--custom_template_file`). None: `DEFAULT_TEMPLATE`.
        dataset: name of a data set, if there are several.

    Raises:
        ToolkitError: there is no template, a template has no place for the class, or a class has no prompts.
    """
    templates: Any = [DEFAULT_TEMPLATE]
    if file is not None:
        templates = load_json(file) if file.suffix == ".json" else read_lines(file)
        # a mapping without the classes' names holds data sets
        if isinstance(templates, Mapping) and not set(names) <= set(templates):
            templates = _pick(file, templates, dataset)
    # prompts by class, or the same templates for all
    if isinstance(templates, Mapping):
        missing = [name for name in names if not templates.get(name)]
        if missing:
            raise ToolkitError(f"{file}: no prompts for {list_some(missing, SHOWN)}: expected some for each class")
        prompts = {name: templates[name] for name in names}
    else:
        prompts = dict.fromkeys(names, templates)
    for texts in prompts.values():
        are_texts = isinstance(texts, list) and all(isinstance(text, str) and text.strip() for text in texts)
        if not are_texts or not texts:
            raise ToolkitError(f"{file}: expected at least one template, such as '{DEFAULT_TEMPLATE}', and texts alone")
        bare = next((text for text in texts if not PLACE.search(text)), None)
        if bare is not None and not isinstance(templates, Mapping):
            raise ToolkitError(f"{file}: the template '{bare}' has no {{}} where the class goes: put it in")
    # joined, as the class's name may hold any sign
    return {name: [name.join(PLACE.split(text)) for text in texts] for name, texts in prompts.items()}


def _pick(file: Path, content: object, dataset: str | None) -> object:
    """Return the entry of a data set."""
    if not isinstance(content, Mapping) or not content:
        raise ToolkitError(f"{file}: expected a list, or data sets with their lists")
    known = list_some(list(content), SHOWN)
    if dataset is None and len(content) > 1:
        raise FieldError(f"{file}: holds {len(content)} data sets ({known}): choose with {{dataset}}", {})
    name = next(iter(content)) if dataset is None else dataset
    if name not in content:
        raise FieldError(f"{file}: no such data set: expected one of {known}", {"dataset": name})
    return content[name]
