"""The parts of pages that come from the code: commands from the command line, fields of files from their models.

A page says where, and `make reference` writes what stands between: `<!-- commands -->` … `<!-- end -->`. There are also
`<!-- fields: toolkit.objects.spec.ObjectSpec -->`, `<!-- names -->`, `<!-- modules -->` and `<!-- layers -->`.
"""

import ast
import importlib
import re
import sys
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from toolkit.cli.app import write_bounds
from toolkit.core.files import write_text

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PACKAGE = Path(__file__).resolve().parents[2] / "toolkit"
SHARED = "Every command"
"""The heading under which a command's help lists the options that all have."""
PART = re.compile(
    r"^<!-- (?P<what>commands|names|modules|layers|fields)(?:: (?P<where>[\w.]+))? -->$.*?^<!-- end -->$",
    re.MULTILINE | re.DOTALL,
)


def main() -> None:
    """Write the parts of every page again."""
    for file in list_pages():
        file.write_text(fill_page(file.read_text(encoding="utf-8")), encoding="utf-8")


def list_pages() -> list[Path]:
    """The pages that have a part made from the code."""
    pages = sorted((PACKAGE.parent / "docs").rglob("*.md"))
    return [file for file in pages if PART.search(file.read_text(encoding="utf-8"))]


def fill_page(markdown: str) -> str:
    """Return a page with its parts made again."""

    def write(found: re.Match[str]) -> str:
        begin = found[0].split("\n", 1)[0]
        return f"{begin}\n\n{write_part(found['what'], found['where']).strip()}\n\n<!-- end -->"

    return PART.sub(write, markdown)


def on_post_build(config: Any, **_: object) -> None:
    """Called by mkdocs at the end: writes `llms.txt`, a list of all pages for language models."""
    pages = [name for entry in config["nav"] for name in _list_pages(entry)]
    write_text(
        Path(config["site_dir"]) / "llms.txt", write_index(config["site_name"], config["site_description"], pages)
    )


THEME_FAULTS = re.compile(r' tabindex=""|(?<=id="__drawer") autocomplete="off"|(?<=id="__search") autocomplete="off"')
"""Attributes of the theme that HTML does not allow there."""


def on_post_page(output: str, **_: object) -> str:
    """Return a page of the site as valid HTML."""
    return THEME_FAULTS.sub("", output)


def on_post_template(output_content: str, **_: object) -> str:
    """Return `404.html` as valid HTML; files of the theme that are no pages stay as they are."""
    return THEME_FAULTS.sub("", output_content)


def _list_pages(entry: dict[str, Any]) -> Iterator[str]:
    """The files of an entry of the navigation and of those below it."""
    for value in entry.values():
        yield from (name for below in value for name in _list_pages(below)) if isinstance(value, list) else (value,)


def write_index(title: str, promise: str, pages: list[str]) -> str:
    """Return the text of `llms.txt`: a link to each page, with the page's first sentence."""
    lines = [f"# {title}", "", f"> {promise}", "", "## Pages", ""]
    for name in pages:
        text = (PACKAGE.parent / "docs" / name).read_text(encoding="utf-8")
        heading, _, rest = text.partition("\n")
        blocks = (block.strip() for block in rest.split("\n\n"))
        first = next((" ".join(block.split()) for block in blocks if re.match(r"[A-Z*`]", block)), "")
        sentence = re.split(r"(?<=[.!?])\s", re.sub(r"\[([^]]*)\]\([^)]*\)|\*\*", r"\1", first))[0]
        lines.append(f"- [{heading.lstrip('# ')}]({name.removesuffix('.md')}.html): {sentence}")
    return "\n".join(lines) + "\n"


def on_page_markdown(markdown: str, **_: object) -> str:
    """Called by mkdocs for every page: the site has the whole docstrings where the page has their first sentences."""

    def write(found: re.Match[str]) -> str:
        return "\n".join(f"::: {module}.{name}\n" for name, module in list_homes().items())

    return PART.sub(lambda found: write(found) if found["what"] == "names" else found[0], markdown)


def write_part(what: str, where: str | None) -> str:
    """Markdown of one part."""
    writers = {"commands": write_commands, "names": write_names, "modules": write_modules, "layers": write_layers}
    if what in writers:
        return "\n".join(writers[what]())
    module, _, name = (where or "").rpartition(".")
    return "\n".join(write_fields(getattr(importlib.import_module(module), name)))


def write_commands() -> Iterator[str]:
    """Every command of the real command line under its group: what it does, its arguments and options."""
    import typer

    from toolkit.cli import app

    commands: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    groups: dict[str, list[str]] = {}
    for name, command in commands.items():
        groups.setdefault(_name_group(command), []).append(name)
    for group, names in groups.items():
        yield from ("", f"## {group}", "")
        for name in names:
            yield from _write_command(name, commands[name].load())


def _name_group(command: Any) -> str:
    panel = getattr(command, "rich_help_panel", None)
    return panel if isinstance(panel, str) else "Commands"


def _write_command(name: str, listed: Any) -> Iterator[str]:
    """Return usage, help, a table of the command's own options, and a line of the shared options."""
    context = listed.make_context(name, [], resilient_parsing=True)
    command = context.command  # the whole one: what is listed may know its name alone
    parameters = [one for one in command.get_params(context) if one.name != "help"]
    arguments = [one for one in parameters if one.param_type_name == "argument"]
    usage = " ".join(["toolkit", name, *(_name_argument(one, context) for one in arguments), "[OPTIONS]"])
    yield from ("", f"### toolkit {name}", "", "```text", usage, "```", "", (command.help or "").strip(), "")
    shared = [one for one in parameters if getattr(one, "rich_help_panel", None) == SHARED]
    own = [one for one in parameters if one not in shared]
    if own:
        yield from ("| option | what it is |", "|---|---|")
    for parameter in own:
        flags, text = _describe(parameter, context)
        yield f"| {flags} | {text} |"
    if shared:
        flags = ", ".join(_describe(one, context)[0] for one in shared)
        yield from ("", f"As every command: {flags}.")


def _name_argument(parameter: Any, context: Any) -> str:
    """`FOLDER`, `[FOLDER]` where it may be left out, `FILES...` where there may be several."""
    name = re.sub(r"[^\w|-]", "", parameter.get_usage_pieces(context)[0]).upper()
    name += "..." if parameter.nargs == -1 else ""
    return name if parameter.required else f"[{name}]"


def _describe(parameter: Any, context: Any) -> tuple[str, str]:
    """An option's flags with its type, or an argument's name; and its help, which ends with its default."""
    flags, text = parameter.get_help_record(context) or ("", "")
    shown = _name_argument(parameter, context) if parameter.param_type_name == "argument" else flags
    return f"`{shown.replace('|', '/')}`", _cell(write_bounds(text))


def _cell(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|").strip()


def write_fields(model: type[BaseModel]) -> Iterator[str]:
    """A table of a model's fields: JSON key, type, default, and their text in its docstring or its bases'."""
    meaning: dict[str, str] = {}
    for base in reversed(model.__mro__[: model.__mro__.index(BaseModel)]):
        meaning |= _read_attributes(base.__doc__ or "")
    yield from ("| field | type | default | meaning |", "|---|---|---|---|")
    for name, field in model.model_fields.items():
        key = field.alias or name
        default = "required" if field.is_required() else _say_default(field)
        yield f"| `{key}` | {_cell(say_type(field.annotation))} | {default} | {_cell(meaning.get(name, ''))} |"


def _say_default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True)
    if value is None or isinstance(value, BaseModel):
        return ""
    return f"`{list(value) if isinstance(value, tuple) else value!r}`".replace("'", '"')


def say_type(kind: Any) -> str:
    """A type in words: `number`, `text`, `top or front`, `list of number`."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return say_type(inner[0])
    if origin is typing.Literal:
        return " or ".join(str(one) for one in inner)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(say_type(one) for one in inner if one is not type(None)))
    if origin is dict:
        return f"{say_type(inner[1])} by name"
    if origin in (list, tuple):
        fixed = origin is tuple and Ellipsis not in inner
        return f"{len(inner)} × {say_type(inner[0])}" if fixed else f"list of {say_type(inner[0])}"
    words = {str: "text", int: "whole number", float: "number", bool: "true or false", Any: "any", object: "any"}
    return words.get(kind, getattr(kind, "__name__", str(kind)).lstrip("_"))


def _read_attributes(docstring: str) -> dict[str, str]:
    """The `Attributes:` of a Google docstring; `a, b: text` goes to both."""
    _, _, part = docstring.partition("Attributes:\n")
    found: dict[str, str] = {}
    for entry in re.split(r"\n {8}(?=\S)", "\n" + part.split("\n\n")[0]):
        names, _, text = entry.strip().partition(": ")
        for name in names.split(", "):
            found[name] = " ".join(text.split())
    return found


def write_names() -> Iterator[str]:
    """Every name that `import toolkit as tk` offers, in the order in which the package lists them."""
    yield from ("| name | what it is |", "|---|---|")
    for name, module in list_homes().items():
        file = PACKAGE.parent / Path(*module.split(".")).with_suffix(".py")
        file = file if file.is_file() else file.with_suffix("") / "__init__.py"
        yield f"| `{name}` | {_cell(_read_name(file, name))} |"


def _read_name(file: Path, name: str) -> str:
    """First sentence on a class or function of a file, or on a value: the text below it."""
    body = ast.parse(file.read_text(encoding="utf-8")).body
    for node, after in zip(body, [*body[1:], ast.Pass()], strict=True):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == name:
            return _shorten(ast.get_docstring(node))
        targets = getattr(node, "targets", [getattr(node, "target", None)])
        if any(getattr(one, "id", None) == name for one in targets):
            told = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            return _shorten(str(after.value.value)) if told else ""
    return ""


def list_homes() -> dict[str, str]:
    """Name -> module, of what `toolkit/__init__.pyi` imports to offer it: `from module import name as name`."""
    tree = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module]
    homes = {one.name: str(node.module) for node in imports for one in node.names if one.asname == one.name}
    listed = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and node.value in homes]
    return {name: homes[name] for name in dict.fromkeys([*listed, *homes])}


def write_modules() -> Iterator[str]:
    """Every module under its package, with the first paragraph of its docstring."""
    for package in sorted(PACKAGE.glob("*/__init__.py")):
        yield from (
            "",
            f"### toolkit.{package.parent.name}",
            "",
            _read_summary(package),
            "",
            "| module | what it is |",
            "|---|---|",
        )
        for file in sorted(package.parent.rglob("*.py")):
            name = ".".join(file.relative_to(package.parent).with_suffix("").parts)
            if file != package:
                yield f"| `{name.removesuffix('.__init__')}` | {_cell(_read_summary(file))} |"


def write_layers() -> Iterator[str]:
    """The packages in the order in which they may import, from `pyproject.toml`, with the docstring of each."""
    settings = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    layers = next(one["layers"] for one in settings["tool"]["importlinter"]["contracts"] if one["id"] == "layers")
    yield from ("| package | what it owns |", "|---|---|")
    for layer in layers:
        for package in layer.split(" | "):
            yield f"| `{package}/` | {_cell(_read_summary(PACKAGE / package / '__init__.py'))} |"


def _read_summary(file: Path) -> str:
    return _shorten(ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))))


def _shorten(docstring: str | None) -> str:
    """The first paragraph, on one line."""
    return " ".join((docstring or "").split("\n\n")[0].split())


if __name__ == "__main__":
    main()
