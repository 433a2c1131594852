"""Settings declared once: a config defines flags, validation, record and hash.

    class Sheet(Config):
        size_px: Annotated[int, Field(ge=8, le=224), Flag()] = Field(100, description="Side of the patch, pixels.")

A config is frozen. A recipe is an instance; `with_overrides` returns a changed copy. A config may hold other configs,
whose fields are named by their path, such as `affine.share`.
"""

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeGuard, TypeVar, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError, model_serializer
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, core_schema

from toolkit.core.errors import FieldError, ToolkitError, one_of, show_value
from toolkit.core.text import join_words

Range = tuple[float, float]
UNITS = {"m_s": " m/s", "deg": "°", "mm": " mm", "px": " px", "m": " m", "s": " s"}
KINDS: dict[object, str] = {int: "a whole number", float: "a number", bool: "on or off", Path: "a file", str: "text"}
Self = TypeVar("Self", bound="Config")


@dataclass(frozen=True)
class Flag:
    """Mark of a field with a flag.

    Attributes:
        name: name of the flag, if it differs from the field, such as `--rotation` for `rotation_deg`.
        metavar: placeholder of the value in the help, such as `LOW HIGH`.
        typed: type on the command line, if a validator converts it to the field's type.
        make: maker of the part that a switch `--pose/--no-pose` turns on, for a field that holds a part or None; by
            default the part's class.
    """

    name: str | None = None
    metavar: str | None = None
    group: str = "Options"
    positional: bool = False
    typed: object = None
    make: Callable[[], object] | None = None


@dataclass(frozen=True)
class Expect:
    """Expected values in the errors of a field, in place of type and bounds: `0 to 16 texels`."""

    words: str


@dataclass(frozen=True)
class Rising:
    """Bounds of a rising pair of numbers: `Annotated[Range, Rising(0.02, 2)]`."""

    low: float
    high: float

    def __str__(self) -> str:
        return f"two rising numbers from {self.low:g} to {self.high:g}"

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def _check(self, pair: Range) -> Range:
        if not self.low <= pair[0] <= pair[1] <= self.high:
            raise ValueError(f"expected {self}")
        return pair


@dataclass(frozen=True)
class Joined:
    """Mark of a pair that is no range, such as a size; `by` stands between the two numbers."""

    by: str


class Later:
    """Mark of a later field: its default is left out of record and hash, so that old hashes stay."""


class FileRecord(BaseModel):
    """Facts in a file, frozen; a file with an unknown field is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_serializer(mode="wrap")
    def _dump(self, dump: Callable[["FileRecord"], dict[str, Any]]) -> dict[str, Any]:
        dumped = dump(self)
        for name, info in type(self).model_fields.items():
            is_later = any(mark is Later or isinstance(mark, Later) for mark in info.metadata)
            if is_later and getattr(self, name) == info.get_default(call_default_factory=True):
                dumped.pop(name, None)
        return dumped


if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)


class _ShortHelp(ModelMetaclass):
    """Hides pydantic's methods from `help(SomeConfig)`."""

    def __dir__(cls) -> list[str]:
        ours = [vars(base) for base in cls.__mro__ if not base.__module__.startswith(("pydantic", "builtins"))]
        return sorted({name for names in ours for name in names if not name.startswith(("_", "model_"))})


class Config(FileRecord, metaclass=_ShortHelp):
    """Frozen, validated settings.

    Raises:
        FieldError: a field's value cannot be used.
        ToolkitError: there is no such field.
    """

    model_config = ConfigDict(allow_inf_nan=False, arbitrary_types_allowed=True)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise explain(type(self), values, error.errors()[0]) from None

    # else pydantic runs this __init__ for nested configs, and errors lose the outer field's name
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Let `help` show each field with its description, and a signature without validators."""
        kind = inspect.Parameter.KEYWORD_ONLY
        lines, parameters = [], []
        for name, info in cls.model_fields.items():
            default = inspect.Parameter.empty if info.is_required() else info.get_default(call_default_factory=True)
            parameters.append(inspect.Parameter(name, kind, default=default))
            lines.append(f"    {name}: {re.sub(r'[{}]', '', info.description or 'see its class')}")
        if lines and "\n    Attributes:" not in (cls.__doc__ or ""):
            cls.__doc__ = f"{inspect.cleandoc(cls.__doc__ or '')}\n\nAttributes:\n" + "\n".join(lines)
        cls.__signature__ = inspect.Signature(parameters)

    def record(self) -> dict[str, Any]:
        """Return all settings as JSON values, without fields declared with `exclude=True`."""
        return self.model_dump(mode="json")

    def with_overrides(self: Self, overrides: Mapping[str, Any] | None = None, /, **by_name: Any) -> Self:
        """Return a copy with some fields changed.

        Args:
            overrides: path of a field -> new value. For a field that holds a part or None, True keeps or makes the
                part, and False or None removes it.
            by_name: likewise, for fields of this config.

        Raises:
            FieldError: a value cannot be used, or belongs to a part that is off.
        """
        values = {name: getattr(self, name) for name in type(self).model_fields}
        below: dict[str, dict[str, Any]] = {}
        for path, value in {**(overrides or {}), **by_name}.items():
            name, _, rest = path.partition(".")
            # a path with a dot changes a field of a part; True and False switch a part on, with its defaults, or off
            if rest:
                below.setdefault(name, {})[rest] = value
            elif isinstance(value, bool) and (make := part_maker(type(self), name)) is not None:
                values[name] = (values[name] or make()) if value else None
            else:
                values[name] = value
        # parts last, so that a part that was just switched on can be changed too
        for name, some in below.items():
            values[name] = _override_part(name, values.get(name), some)
        # made anew, as only that validates
        return type(self)(**values)

    def rows(self) -> list[tuple[str, str]]:
        """Return (name, value) of every setting in words; a part is a single row, None is left out."""
        held = [(name, getattr(self, name)) for name in type(self).model_fields]
        return [(name.replace("_", " "), _describe_field(self, name)) for name, value in held if value is not None]


def explain(config: type[Config], values: Mapping[str, Any], error: ErrorDetails) -> ToolkitError:
    """Return the error of pydantic in the project's words."""
    # follow the path of the error through nested configs
    names: list[str] = []
    info: FieldInfo | None = None
    found: object = values
    owner: type[Config] | None = config
    for step in error["loc"]:
        if owner is None or step not in owner.model_fields:
            continue  # number of an item, or tag of a union's member
        name = str(step)
        info, found = owner.model_fields[name], found.get(name) if isinstance(found, Mapping) else None
        names.append(name)
        owner = next((kind for kind in _members(info.annotation) if is_config(kind)), None)
    # a name that no field has: the nearest known is told
    if error["type"] == "extra_forbidden":
        return one_of("setting", str(error["loc"][-1]), list((owner or config).model_fields))
    path = ".".join(names)
    # an error of the whole config names no field
    if info is None:
        return ToolkitError(str(error["msg"]).removeprefix("Value error, "))
    if error["type"] == "missing":
        # in braces, so that commands show the flag, and Python the field
        return FieldError(f"{{{path}}}: expected {expected_of(info) or 'a value'}; it has no default", {})
    if error["type"] == "value_error":
        return FieldError(str(error["ctx"]["error"]), {path: found})
    # pydantic's own words only where a field has none
    words = expected_of(info, found) or error["msg"].replace("Input should be ", "")
    return FieldError(f"expected {words}", {path: found})


def expected_of(info: FieldInfo, found: object = None) -> str:
    """Return what a field can hold, in words, from its type and bounds."""
    # a field may state its own words
    for mark in info.metadata:
        if isinstance(mark, Expect):
            return mark.words
        if isinstance(mark, Rising):
            return str(mark)
    kind = typed_as(info)
    if get_origin(kind) is Literal:
        known = [str(choice) for choice in get_args(kind)]
        near = get_close_matches(str(found), known, n=1)
        return join_words(known, "or") + (f"; did you mean {near[0]}?" if near else "")
    # for a number out of bounds the bounds are enough
    words, bounds = KINDS.get(kind, ""), bounds_of(info)
    return ", ".join(filter(None, [words, bounds])) if not bounds or isinstance(found, str) else bounds


def bounds_of(info: FieldInfo) -> str:
    """Return a number's bounds in words: `8 to 224`, `at least 2`, `above 0 and at most 1`; empty without bounds."""
    low = high = ""
    for mark in info.metadata:
        match mark:
            case Ge(ge=bound):
                low = f"at least {bound:.12g}"
            case Gt(gt=bound):
                low = f"above {bound:.12g}"
            case Le(le=bound):
                high = f"at most {bound:.12g}"
            case Lt(lt=bound):
                high = f"below {bound:.12g}"
    if low.startswith("at least") and high.startswith("at most"):
        return f"{low.removeprefix('at least ')} to {high.removeprefix('at most ')}"
    return join_words(filter(None, [low, high]))


def typed_as(info: FieldInfo) -> Any:
    """Return the type that a user gives for a field: that of its flag, else its own without None."""
    flag = flag_of(info)
    if flag is not None and flag.typed is not None:
        return flag.typed
    members = _members(info.annotation)
    return members[0] if len(members) == 1 else Union[tuple(members)]  # noqa: UP007, the members are values here


def flag_of(info: FieldInfo) -> Flag | None:
    """Return the flag of a field, if it has any."""
    return next((mark for mark in info.metadata if isinstance(mark, Flag)), None)


def part_maker(config: type[Config], name: str) -> Callable[[], object] | None:
    """Return the maker of the part that a switch turns on; None for a field that is no switch."""
    info = config.model_fields.get(name)
    if info is None or NoneType not in get_args(info.annotation):
        return None
    flag = flag_of(info)
    if flag is not None and flag.make is not None:
        return flag.make
    # a part is a config or a dataclass
    kinds = [kind for kind in _members(info.annotation) if get_origin(kind) is None and isinstance(kind, type)]
    return next((kind for kind in kinds if is_config(kind) or is_dataclass(kind)), None)


def describe(value: object, name: str = "", between: str = " to ") -> str:
    """Return a value in words, with the unit in its name; of a part all fields, probabilities last."""
    if isinstance(value, Config) or (is_dataclass(value) and not isinstance(value, type)):
        # a part may describe itself
        if hasattr(value, "describe"):
            return str(value.describe())
        names = list(type(value).model_fields) if isinstance(value, Config) else [field.name for field in fields(value)]
        # fields that are off are left out
        held = [field for field in names if getattr(value, field) is not None]
        held.sort(key=lambda name: name.endswith("probability"))
        return ", ".join(f"{_name_words(field)} {_describe_field(value, field)}" for field in held)
    # the unit is the end of the name, such as `_mm`
    unit = UNITS.get(_unit_of(name), "")
    if isinstance(value, tuple) and len(value) == 2 and all(isinstance(item, int | float) for item in value):
        return f"{value[0]:g}{between}{value[1]:g}{unit}"
    if isinstance(value, tuple | list):
        return ", ".join(describe(item) for item in value)
    return f"{value:.4g}{unit}" if isinstance(value, float) else f"{show_value(value)}{unit}"


def describe_changes(base: Config, overrides: Mapping[str, object]) -> str:
    """Return the overrides that differ from a config, in words: `steps 20, length 60 mm, glare off`."""
    changed = []
    for path, value in overrides.items():
        before: object = base
        for name in path.split("."):
            before = getattr(before, name, None)
        # a switch of a part is compared with whether there is one
        is_switch = isinstance(value, bool) and not isinstance(before, bool)
        is_same = value == (before is not None) if is_switch else value == before
        if not is_same:
            changed.append(f"{_name_words(name)} {describe(value, name)}")
    return ", ".join(changed)


def _name_words(name: str) -> str:
    return name.removesuffix(f"_{_unit_of(name)}").replace("_", " ")


def _describe_field(owner: object, name: str) -> str:
    info = type(owner).model_fields.get(name) if isinstance(owner, Config) else None
    joined = next((mark for mark in info.metadata if isinstance(mark, Joined)), None) if info is not None else None
    return describe(getattr(owner, name), name, joined.by if joined else " to ")


def align_rows(rows: list[tuple[str, str]]) -> list[str]:
    """Return `name  value` lines, the values below each other."""
    width = max((len(name) for name, _ in rows), default=0)
    return [f"  {name:<{width}}  {value}" for name, value in rows]


def _override_part(name: str, part: object, changes: Mapping[str, Any]) -> object:
    if part is None:
        first = next(iter(changes))
        raise FieldError(f"expected together with {{{name}}}, which is off", {f"{name}.{first}": changes[first]})
    try:
        if isinstance(part, Config):
            return part.with_overrides(changes)
        if is_dataclass(part) and not isinstance(part, type):
            return replace(part, **changes)
    except FieldError as error:
        raise error.within(name) from None
    raise ToolkitError(f"{name} has no settings of its own")


def _members(annotation: object) -> list[Any]:
    if get_origin(annotation) is Annotated:
        return _members(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return [kind for member in get_args(annotation) if member is not NoneType for kind in _members(member)]
    return [annotation]


def is_config(kind: object) -> TypeGuard[type["Config"]]:
    """Whether an annotation is a config class; in Python 3.10 `tuple[int, int]` is a type, but no class."""
    return get_origin(kind) is None and isinstance(kind, type) and issubclass(kind, Config)


def _unit_of(name: str) -> str:
    """Return the unit at the end of a field's name: `mm` of `size_mm`, `m_s` of `fastest_m_s`."""
    return next((unit for unit in UNITS if f"_{name}".endswith(f"_{unit}")), "")
