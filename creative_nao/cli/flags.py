"""How the flags of a command are told in its help: each text as one paragraph, each default once, each value by name.

tyro makes the flags from a settings dataclass: their names, types, defaults and the text under each field. Left to
itself it breaks a text where its source line ends, adds ``(default: None)`` to a text that says what happens without
the flag, and calls what is wanted ``{None}|PATH`` or, where it has no flag, ``STR``.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap
import types
from typing import Annotated, Any, Union, cast, get_args, get_origin, get_type_hints

import tyro
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructFieldSpec, StructTypeInfo

FLAGS = ConstructorRegistry()
"""What tyro is to know of settings beyond their types, while inside ``with FLAGS``."""


@FLAGS.struct_rule
def _settings(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Describe one of our settings dataclasses to tyro; None leaves any other type to it."""
    if not dataclasses.is_dataclass(info.type) or not info.type.__module__.startswith("creative_nao."):
        return None
    hints: dict[str, Any] = get_type_hints(info.type, include_extras=True)
    texts = field_texts(info.type)
    fields = []
    for field in dataclasses.fields(info.type):
        default, kind = _default(field, info.default), hints[field.name]
        text, hint = with_default(texts.get(field.name, ""), default)
        if not dataclasses.is_dataclass(kind):  # a group of flags has a text of its own, but neither value nor default
            value = _value_name(field.name, kind, required=default is tyro.MISSING)
            kind = Annotated[kind, tyro.conf.arg(help=text, help_behavior_hint=hint, metavar=value)]
        fields.append(StructFieldSpec(field.name, cast(Any, kind), default, helptext=text))
    return StructConstructorSpec(info.type, tuple(fields))


def field_texts(settings: type) -> dict[str, str]:
    """Return the text under each field of a dataclass, as one line; none where its source is not installed."""
    try:
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(settings))).body
    except OSError:
        return {}
    assert isinstance(definition, ast.ClassDef)
    found = {}
    for field, below in zip(definition.body, definition.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(below, ast.Expr):
            found[field.target.id] = " ".join(ast.literal_eval(below.value).split())
    return found


def with_default(text: str, default: Any) -> tuple[str, str | None]:
    """Return the text of a flag and what stands behind it; None leaves that to tyro, which shows the default.

    Where the default is None, the text ends by saying what then happens, after ``; default:``.

    Example:
        >>> with_default("Folder of recordings; default: the six shipped ones.", None)
        ('Folder of recordings.', '(default: the six shipped ones)')
        >>> with_default("Row of the table.", None)
        ('Row of the table.', '(default: none)')
        >>> with_default("Row of the table.", 3)
        ('Row of the table.', None)
    """
    if default not in (None, ()):
        return text, None
    before, mark, instead = text.rpartition("; default: ")
    return (f"{before}.", f"(default: {instead.removesuffix('.')})") if mark else (text, "(default: none)")


def _default(field: dataclasses.Field[Any], whole: Any) -> Any:
    """Return the default of a field: that of the settings it belongs to, if they have one, else its own."""
    if dataclasses.is_dataclass(whole):
        return getattr(whole, field.name)
    if field.default is not dataclasses.MISSING:
        return field.default
    return tyro.MISSING if field.default_factory is dataclasses.MISSING else field.default_factory()


def _value_name(name: str, hint: Any, *, required: bool) -> str | None:
    """Return what the help calls the value of a field; None leaves it to tyro."""
    kind = hint
    if get_origin(hint) is Annotated:
        kind, *marks = get_args(hint)
        if tyro.conf.Positional in marks:
            several = " ..." if get_origin(kind) is tuple else ""
            return f"{name.upper()}{several}" if required else f"[{name.upper()}{several}]"
    if get_origin(kind) in (Union, types.UnionType) and type(None) in get_args(kind):
        (value,) = (one for one in get_args(kind) if one is not type(None))
        if get_origin(value) is tuple:
            one = get_args(value)[0].__name__.upper()
            return f"{one} [{one} ...]"
        choices = ("True", "False") if value is bool else get_args(value)
        return "{" + ",".join(choices) + "}" if choices else value.__name__.upper()
    return None
