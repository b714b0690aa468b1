"""Values written as Python in a settings file, such as ``dict(net_arch=[64, 64])``: read, never executed.

RL Zoo evaluates such strings. Here they are parsed, and only numbers, strings, truth values, None, lists, tuples,
dictionaries, `dict(...)`, `float("1e-3")` and the names of torch's activations are understood.
"""

from __future__ import annotations

import ast
from typing import Any

from creative_nao.errors import SettingsError, nearest_name

ACTIVATIONS = ("ReLU", "Tanh", "ELU", "LeakyReLU", "SiLU", "GELU", "Softplus")
"""Activations that a policy may have, classes of `torch.nn`."""


def parse_literal(text: str, where: str) -> Any:
    """Return the value that `text` describes; an activation as its name with the prefix ``nn.``.

    Args:
        text: A Python expression of the kinds named above.
        where: What it is the value of, for the error.

    Raises:
        SettingsError: If it is anything else.

    Example:
        >>> parse_literal("dict(net_arch=[64, 64], activation_fn=nn.ReLU)", "policy_kwargs")
        {'net_arch': [64, 64], 'activation_fn': 'nn.ReLU'}
    """
    try:
        return _value(ast.parse(text.strip(), mode="eval").body, where)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        if isinstance(error, SettingsError):
            raise
        raise SettingsError(
            f"{where} should be a value such as dict(net_arch=[64, 64]), but is {text!r:.80}"
        ) from error


def activation_name(name: str, where: str) -> str:
    """Return ``nn.X`` for ``X`` or ``nn.X``.

    Raises:
        SettingsError: If there is no such activation.
    """
    bare = name.rpartition(".")[2]
    if bare not in ACTIVATIONS or name not in (bare, f"nn.{bare}", f"th.nn.{bare}", f"torch.nn.{bare}"):
        raise SettingsError(
            f"{where}: no activation `{name}`{nearest_name(bare, ACTIVATIONS)}; there are {', '.join(ACTIVATIONS)}"
        )
    return f"nn.{bare}"


def _value(node: ast.expr, where: str) -> Any:
    match node:
        case ast.Constant(value=bool() | int() | float() | str() | None as value):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return -value
        case ast.List(elts=parts) | ast.Tuple(elts=parts):
            return [_value(part, where) for part in parts]
        case ast.Dict(keys=keys, values=values) if None not in keys:
            return {_value(key, where): _value(part, where) for key, part in zip(keys, values, strict=True) if key}
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=keywords) if all(k.arg for k in keywords):
            return {str(k.arg): _value(k.value, where) for k in keywords}
        case ast.Call(func=ast.Name(id="float"), args=[ast.Constant(value=int() | float() | str() as value)]):
            return float(value)
        case ast.Attribute() | ast.Name():
            return activation_name(ast.unparse(node), where)
    raise SettingsError(
        f"{where} holds `{ast.unparse(node):.60}`, which is not read: only numbers, strings, lists, dict(...) and "
        "activations such as nn.ReLU are, since nothing in a settings file is executed"
    )
