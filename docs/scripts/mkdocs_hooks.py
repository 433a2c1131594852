"""What the site takes from the code: commands from the command line, fields of files from the models that read them.

A page says where: `<!-- commands -->`, `<!-- fields: toolkit.objects.spec.ObjectSpec -->`, `<!-- names -->`,
`<!-- modules -->`.
"""

import ast
import importlib
import re
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

PACKAGE = Path(__file__).resolve().parents[2] / "toolkit"
SHARED = "Every command"
"""The heading under which a command's help lists the options that all have."""
MARKER = re.compile(r"^<!-- (?P<what>commands|names|modules|fields)(?:: (?P<where>[\w.]+))? -->$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Called by mkdocs for every page: put what is generated in the place of its marker."""
    return MARKER.sub(lambda found: write_part(found["what"], found["where"]), markdown)


def write_part(what: str, where: str | None) -> str:
    """Markdown of one marker."""
    if what == "commands":
        return "\n".join(write_commands())
    if what == "names":
        return "\n".join(write_names())
    if what == "modules":
        return "\n".join(write_modules())
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
    """Usage, help, a table of its own options, and a line of those that every command has."""
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
    name = re.sub(r"[^\w-]", "", parameter.get_usage_pieces(context)[0]).upper()
    name += "..." if parameter.nargs == -1 else ""
    return name if parameter.required else f"[{name}]"


def _describe(parameter: Any, context: Any) -> tuple[str, str]:
    """An option's flags with its type, or an argument's name; and its help, which ends with its default."""
    flags, text = parameter.get_help_record(context) or ("", "")
    shown = _name_argument(parameter, context) if parameter.param_type_name == "argument" else flags
    return f"`{shown}`", _cell(text)


def _cell(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|").strip()


def write_fields(model: type[BaseModel]) -> Iterator[str]:
    """A table of a model's fields: JSON key, type, default, and what its docstring says of it."""
    meaning = _read_attributes(model.__doc__ or "")
    yield from ("| field | type | default | meaning |", "|---|---|---|---|")
    for name, field in model.model_fields.items():
        key = field.alias or name
        default = "required" if field.is_required() else _say_default(field)
        yield f"| `{key}` | {_cell(say_type(field.annotation))} | {default} | {_cell(meaning.get(name, ''))} |"


def _say_default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True, validated_data={})
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
    """Every name that `import toolkit as tk` offers, for mkdocstrings, in the order in which the package lists them."""
    homes = list_homes()
    if homes:
        yield from (
            "## Names",
            "",
            "`import toolkit as tk`, and these are there, each loaded when it is first used.",
            "",
        )
    for name, module in homes.items():
        yield from (f"::: {module}.{name}", "")


def list_homes() -> dict[str, str]:
    """Name -> module, of what `toolkit/__init__.pyi` imports to offer it: `from module import name as name`."""
    tree = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module]
    homes = {one.name: str(node.module) for node in imports for one in node.names if one.asname == one.name}
    listed = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and node.value in homes]
    return {name: homes[name] for name in dict.fromkeys([*listed, *homes])}


def write_modules() -> Iterator[str]:
    """Every module under its package, with the first sentence of its docstring."""
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


def _read_summary(file: Path) -> str:
    docstring = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return " ".join(docstring.split("\n\n")[0].split())
