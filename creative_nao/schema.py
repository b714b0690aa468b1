"""One schema for every record in a file: strict pydantic dataclasses, and one line of error that names the field.

    @record
    class Walk:
        format_version: Version1
        name: Name
        n_steps: Annotated[int, Field(ge=1, le=4000)] = 10

    walk = parse(Walk, read_text(path, "walk"), f"walk {path}")

`Walk(...)` checks its arguments too and raises `SettingsError`; `parse` raises `FileFormatError`. An `AfterValidator`
raises ValueError whose text says what is expected: ``ValueError("a prime number")``; `__post_init__` raises
`SettingsError` with a whole sentence. Refused: a truth value or text for a number, 1.0 for a whole number, NaN,
infinities, unknown keys; in JSON also repeated keys, deep nesting and numbers of many digits. Accepted beyond the
strict mode of pydantic: a list for a tuple, an object for a record, a NumPy scalar for a number.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import os
import re
import types
import typing
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar, dataclass_transform, overload

import numpy as np
import pydantic.dataclasses
from pydantic import AfterValidator, BeforeValidator, ConfigDict, FailFast, Field, TypeAdapter, ValidationError
from pydantic_core import ArgsKwargs

from creative_nao.errors import CreativeNaoError, FileFormatError, SettingsError, nearest_name, shown
from creative_nao.storage import MAX_DIGITS, MAX_TEXT_BYTES, as_json, as_text, json_fault, read_json, write_json

__all__ = [
    "AfterValidator", "Count", "Field", "Index", "JsonObject", "LongText", "Name", "Names", "NonNegative", "PlainName",
    "Positive", "Seed", "Sha256", "Text", "UnitInterval", "Version1", "Versions", "checked", "checked_path", "dump",
    "load_json", "must", "parse", "record", "save_json",
]  # fmt: skip

T = TypeVar("T")
MAX_KEYS = 10_000  # of an object in a file
_LONGEST_NAME = 200  # characters of a name: of a joint, an action, an agent
_LONGEST_TEXT = 20_000  # characters of a `LongText`: a command line, a note of several sentences


_is_writable = re.compile("[^\ud800-\udfff]*").fullmatch
"""Whether text can be written as UTF-8: JSON may hold halves of characters."""


def must(holds: Callable[[Any], object], expected: str) -> AfterValidator:
    """Return the check of a field: where `holds` says no, the message tells what was `expected`."""

    def validate(value: Any) -> Any:
        if not holds(value):
            raise ValueError(expected)
        return value

    return AfterValidator(validate)


def _is_plain_name(name: str) -> bool:
    """Return whether a name may become a file's: nothing in it leads elsewhere, hides the file or cannot be seen."""
    letters = _is_name(name) and not any(mark in name for mark in "/\\:")
    return letters and not name.startswith(".") and name == name.strip()


def _json_object(value: dict[str, Any]) -> dict[str, Any]:
    if (fault := json_fault(value)) is not None:
        raise ValueError(f"bounded JSON ({fault})")
    return value


def _is_name(text: str) -> bool:
    return 0 < len(text) <= _LONGEST_NAME and text.isprintable()


Count = Annotated[int, Field(ge=1)]
"""A whole number of at least 1."""
Index = Annotated[int, Field(ge=0)]
"""A whole number of at least 0."""
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
UnitInterval = Annotated[float, Field(ge=0, le=1)]
Text = Annotated[str, Field(max_length=_LONGEST_NAME), must(_is_writable, "text that can be written as UTF-8")]
LongText = Annotated[str, Field(max_length=_LONGEST_TEXT), must(_is_writable, "text that can be written as UTF-8")]
Name = Annotated[str, must(_is_name, f"a name of 1 to {_LONGEST_NAME} printable characters")]
"""Of a joint, an action, an agent."""
Names = Annotated[
    tuple[Name, ...],
    Field(min_length=1, max_length=1_000),
    must(lambda names: len(set(names)) == len(names), "a list of different names"),
]
PlainName = Annotated[str, must(_is_plain_name, "a plain name, as of a file")]
"""One that may become a file's."""
Sha256 = Annotated[str, must(re.compile("[0-9a-f]{64}").fullmatch, "a SHA-256 of 64 hexadecimal digits")]
Versions = Annotated[dict[Text, Text], Field(max_length=1_000)]
"""Versions of packages by name."""
JsonObject = Annotated[dict[str, Any], AfterValidator(_json_object)]
"""Free JSON, such as a record of provenance."""
Version1 = Annotated[int, must(lambda version: version == 1, "1, the version that this release reads")]
"""Type of a field `format_version`; a file of another version is refused before its other fields are looked at."""


@overload
def record(cls: type[T], /) -> type[T]: ...
@overload
def record(*, closed: bool = True, **options: Any) -> Callable[[type[T]], type[T]]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field, Field))
def record(cls: type[T] | None = None, /, *, closed: bool = True, **options: Any) -> Any:
    """Turn a class with annotated fields into a strict, frozen pydantic dataclass.

    Args:
        cls: The class; its annotations must be known when it is made.
        closed: Whether keys that are no fields are refused, else ignored.
        options: More for `dataclasses.dataclass`, such as `kw_only` or `eq`.
    """
    if cls is None:
        return functools.partial(record, closed=closed, **options)
    told = inspect.get_annotations(cls)
    resolved = inspect.get_annotations(cls, eval_str=True)
    cls.__annotations__ = {name: _accepting(annotation) for name, annotation in resolved.items()}
    config = ConfigDict(strict=True, extra="forbid" if closed else "ignore", allow_inf_nan=False)
    made = pydantic.dataclasses.dataclass(cls, config=config, **{"frozen": True, **options})  # pyright: ignore
    made.__annotations__ = told
    fields = [field.name for field in dataclasses.fields(made) if field.init]

    @functools.wraps(made.__init__)
    def construct(self: Any, /, *args: Any, **kwargs: Any) -> None:
        try:
            made.__pydantic_validator__.validate_python(ArgsKwargs(args, kwargs), self_instance=self)
        except ValidationError as error:
            values = {**dict(zip(fields, args, strict=False)), **kwargs}
            raise SettingsError(_message(error, values, "", fields)) from None

    made.__init__ = construct  # pyright: ignore[reportAttributeAccessIssue]
    return made


@overload
def parse(kind: type[T], values: Any, where: str, *, error: type[CreativeNaoError] = ..., what: str = ...) -> T: ...
@overload
def parse(kind: Any, values: Any, where: str, *, error: type[CreativeNaoError] = ..., what: str = ...) -> Any: ...
def parse(
    kind: Any, values: Any, where: str, *, error: type[CreativeNaoError] = FileFormatError, what: str = "text"
) -> Any:
    """Return the record that a file or a header holds.

    Args:
        kind: Class made by `record`, or any annotation such as `JsonObject`.
        values: JSON as bytes or text; or plain values, as TOML, YAML or a header of arrays gave them.
        where: Beginning of the message; names the file.
        error: What is raised: `FileFormatError`, or `SettingsError` for what a user wrote by hand.
        what: What the bytes are, for messages.

    Raises:
        FileFormatError: Or `error`; the message names the field, what was expected and what came.
    """
    if isinstance(values, bytes):
        values = as_text(values, where, what)
    if isinstance(values, str):
        values = as_json(values, where)
    return _validated(kind, values, where, error)


def checked(kind: Any, value: Any, name: str) -> Any:
    """Return an argument of a function after checking it: ``checked(Count, n_steps, "n_steps")``.

    `kind` is an annotation as of a field, or a class that the value should be an instance of, such as
    `np.random.Generator`; SettingsError names the argument.
    """
    if not isinstance(kind, type) or _is_record(kind) or kind.__module__ == "builtins":
        return _validated(kind, value, f"`{name}`", SettingsError)
    if not isinstance(value, kind):
        raise SettingsError(f"`{name}` should be a `{kind.__name__}`, but is {shown(value)}")
    return value


def dump(instance: Any) -> dict[str, Any]:
    """Return a record as plain values that JSON, TOML and YAML can hold; tuples become lists."""
    return type(instance).__pydantic_serializer__.to_python(instance, mode="json")


def checked_path(path: str | os.PathLike[str], name: str = "path") -> Path:
    """Return the path of a file; a value of another kind raises SettingsError."""
    return Path(os.fspath(path) if isinstance(path, os.PathLike) else checked(str, path, name))


def load_json(kind: type[T], path: str | os.PathLike[str], what: str, largest: int = MAX_TEXT_BYTES) -> T:
    """Return the record in a JSON file of at most `largest` bytes; `what` says in messages what it should be.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is too large, torn, not what was written, or a field is wrong.
    """
    return parse(kind, read_json(Path(path), what, largest), f"{what} {path}")


def save_json(path: str | os.PathLike[str], instance: Any, indent: int | None = 2, private: bool = False) -> Path:
    """Write a record as JSON with a SHA-256 of its content, as `storage.replacing` does, and return the path."""
    return write_json(path, dump(instance), indent, private)


def _accepting(annotation: Any) -> Any:
    """Return an annotation that also takes a list for a tuple, an object for a record and NumPy's scalars."""
    origin, args = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        inner = _accepting(args[0])
        if typing.get_origin(inner) is not Annotated:
            return Annotated[inner, *args[1:]]
        *kept, conversion = inner.__metadata__  # which is applied before the bounds when it stands last
        return Annotated[inner.__origin__, *kept, *args[1:], conversion]
    if annotation in (int, float):
        return Annotated[annotation, BeforeValidator(_plain_number)]
    if _is_record(annotation):
        return Annotated[annotation, BeforeValidator(functools.partial(_record_from, annotation))]
    if origin in (types.UnionType, typing.Union):
        return typing.Union[tuple(map(_accepting, args))]  # noqa: UP007 - made of what is there
    if origin is tuple:
        inner = tuple(one if one is ... else _accepting(one) for one in args)
        fast = [FailFast()] if ... in args else []
        return Annotated[tuple[inner], *fast, BeforeValidator(functools.partial(_as, tuple))]
    if origin is list:
        return Annotated[list[_accepting(args[0])], FailFast(), BeforeValidator(functools.partial(_as, list))]
    if origin is dict:
        return Annotated[dict[_accepting(args[0]), _accepting(args[1])], BeforeValidator(_bounded_keys)]
    return annotation


def _plain_number(value: Any) -> Any:
    if isinstance(value, int) and abs(value) >= 10**MAX_DIGITS:
        raise ValueError(f"a number of at most {MAX_DIGITS} digits")
    return value.item() if isinstance(value, np.generic) else value


def _as(kind: type, value: Any) -> Any:
    return kind(value) if isinstance(value, list | tuple) else value


def _bounded_keys(value: Any) -> Any:
    if isinstance(value, dict) and len(value) > MAX_KEYS:
        raise ValueError(f"an object of at most {MAX_KEYS} fields")
    return value


def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and "__pydantic_validator__" in vars(kind)


def _record_from(kind: type[T], values: Any) -> T:
    if isinstance(values, kind):
        return values
    if not isinstance(values, dict):
        raise ValueError(f"should be a JSON object, but is {shown(values)}")
    if len(values) > MAX_KEYS or not all(isinstance(key, str) and _is_writable(key) for key in values):
        raise ValueError(f"should be an object of at most {MAX_KEYS} fields named by text, but is {shown(values)}")
    return kind(**values)


def _validated(kind: Any, values: Any, where: str, error: type[CreativeNaoError]) -> Any:
    try:
        return _record_from(kind, values) if _is_record(kind) else _adapter(kind).validate_python(values)
    except ValidationError as fault:
        text = _message(fault, values, where)
    except RecursionError:
        text = f"{where}: it is nested too deeply"
    except ValueError as fault:
        text = f"{where}{' ' if str(fault).startswith('should be') else ': '}{fault}"
    raise error(text)


@functools.lru_cache(maxsize=256)
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(_accepting(kind), config=ConfigDict(strict=True, allow_inf_nan=False))


def _message(error: ValidationError, values: Any, where: str, fields: Sequence[str] = ()) -> str:
    """Return the one line that tells the first fault: a wrong version, else an unknown key, else what comes first."""
    faults = error.errors(include_url=False)
    fault = min(faults, key=lambda one: (one["loc"][-1:] != ("format_version",), one["type"] != _UNKNOWN))
    loc, came = fault["loc"], shown(fault["input"])
    path = _path(loc, values, fields)
    if fault["type"] == _UNKNOWN:
        name = str(loc[-1])
        return f"no key `{name[:60]}`{nearest_name(name, fields)}; there are: {', '.join(fields)}"
    if fault["type"].startswith("missing"):
        return f"{_joined(where, [*path, loc[-1]])} is missing"
    if fault["type"] == "unexpected_positional_argument":
        return f"at most {len(fields)} values are taken: {', '.join(fields)}"
    outer = _joined(where, path)
    told = fault.get("ctx", {}).get("error")
    if isinstance(told, CreativeNaoError):  # from a record within, or a `__post_init__`
        return f"{outer}: {told}" if outer else str(told)
    if str(told).startswith("should be"):
        return f"{outer} {told}"
    alternatives = dict.fromkeys(_expected(one) for one in faults if _path(one["loc"], values, fields) == path)
    verbs = ("have keys that are", "has") if loc[-1:] == ("[key]",) else ("be", "is")
    return f"{outer or 'it'} should {verbs[0]} {' or '.join(alternatives)}, but {verbs[1]} {came}"


_UNKNOWN = "unexpected_keyword_argument"
_EXPECTED = {
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "text",
    "string_unicode": "text that can be written as UTF-8",
    "string_too_long": "text of at most {max_length} characters",
    "string_too_short": "text of at least {min_length} characters",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a JSON object",
    "none_required": "null",
    "too_long": "{field_type} of at most {max_length} entries",
    "too_short": "{field_type} of at least {min_length} entries",
    "greater_than_equal": "at least {ge}",
    "greater_than": "above {gt}",
    "less_than_equal": "at most {le}",
    "less_than": "below {lt}",
    "literal_error": "{expected}",
    "value_error": "{error}",
}
"""What pydantic's errors expected, in plain words; in braces what it tells of the bound."""


def _expected(fault: Any) -> str:
    told = _EXPECTED.get(fault["type"], str(fault["msg"]).removeprefix("Input should be "))
    bounds = {name: f"{bound:g}" if isinstance(bound, float) else bound for name, bound in fault.get("ctx", {}).items()}
    bounds["field_type"] = "an object" if bounds.get("field_type") == "Dictionary" else "a list"
    if fault["type"] == "literal_error":
        bounds["expected"] = bounds["expected"].replace("'", "`")
    return told.format_map(bounds) if fault["type"] in _EXPECTED else told


def _path(loc: Sequence[str | int], values: Any, fields: Sequence[str]) -> list[str | int]:
    """Return where a fault is, without the names of the members of a union that pydantic puts between."""
    found: list[str | int] = []
    for place, part in enumerate(loc):
        if place == 0 and fields and isinstance(part, int):  # an argument given by its place
            part = fields[part] if part < len(fields) else str(part)
        listed = isinstance(values, list | tuple) and isinstance(part, int) and part < len(values)
        if listed or (isinstance(values, dict) and isinstance(part, str) and part in values):
            values = values[part]  # pyright: ignore[reportCallIssue, reportArgumentType]
            found.append(part)
    return found


def _joined(where: str, path: Iterable[str | int]) -> str:
    """Return the beginning of a message: walk.json: ``rows``, entry 3: ``reward``."""
    text = where
    for part in path:
        mark, name = (", ", f"entry {part + 1}") if isinstance(part, int) else (": ", f"`{part[:60]}`")
        text += f"{mark if text else ''}{name}"
    return text
