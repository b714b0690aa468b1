"""A program of Python 2 or 3 cut into statements by its words, in time that grows as its length; nothing is run."""

from __future__ import annotations

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from creative_nao.errors import FileFormatError
from creative_nao.exchange.keys import text_of

MAX_NESTED = 50  # brackets and blocks within each other
_HEADERS = {"if", "elif", "else", "for", "while", "try", "except", "finally", "with", "def", "class", "async"}

_WORD = re.compile(
    r"(?P<space>[ \t\f]+|\\\r?\n)|(?P<comment>\#[^\n]*)|(?P<newline>\r?\n|\r)"
    r"|(?P<string>[bBrRuUfF]{0,2}(?:'''|\"\"\"|'|\"))"
    r"|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\w*)|(?P<name>[^\W\d]\w*)"
    r"|(?P<mark>\*\*=|//=|>>=|<<=|[-+*/%&|^@<>=!]=|->|\*\*|//|<<|>>|<>|.)",
)
_STRING_END = {
    "'''": re.compile(r"(?:[^\\]|\\.)*?'''", re.DOTALL), '"""': re.compile(r'(?:[^\\]|\\.)*?"""', re.DOTALL),
    "'": re.compile(r"(?:[^\\\r\n']|\\\r\n|\\.)*+'", re.DOTALL),
    '"': re.compile(r'(?:[^\\\r\n"]|\\\r\n|\\.)*+"', re.DOTALL),
}  # fmt: skip
_OPENS, _CLOSES = "([{", ")]}"


@dataclass(slots=True)
class Statement:
    """One simple statement, or the head of a compound one; words are texts, kinds their sorts."""

    indent: float
    line: int
    words: list[str] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    parent: Statement | None = None
    names: set[str] = field(default_factory=set)
    """Names that stand in it, see `names_in`."""

    @property
    def function(self) -> Statement | None:
        """The function it stands in."""
        above = self.parent
        while above is not None and above.words[0] != "def":
            above = above.parent
        return above

    def condition(self) -> Statement | None:
        """Return the loop or the condition, within its function, on which it depends."""
        above = self.parent
        while above is not None and above.words[0] != "def":
            if above.words[0] in ("for", "while", "elif", "else", "except"):
                return above
            if above.words[0] == "if" and above.words[1:2] != ["__name__"]:
                return above
            above = above.parent
        return None


def decoded(path: Path, content: bytes) -> str:
    """Return a program's text: UTF-8, or the western encoding that one of its first two lines declares (PEP 263)."""
    head = b"\n".join(content.split(b"\n", 2)[:2])
    declared = re.search(
        rb"^[ \t\f]*#.*?coding[:=][ \t]*(latin-?1|iso-8859-15?|cp1252|windows-1252)\b", head, re.M | re.I
    )
    return content.decode(declared[1].decode(), "replace") if declared else text_of(path, content)


def statements_of(path: Path, text: str) -> list[Statement]:
    """Cut a program into statements, each below the heads of the blocks it stands in."""
    found: list[Statement] = []
    blocks: list[Statement] = []
    place, line, depth, indent = 0, 1, 0, 0
    current: Statement | None = None
    fresh, dots = True, 0  # at the beginning of a line; dots of the name so far

    def ended() -> None:
        nonlocal current
        if current is not None and current.words:
            current.names = names_in(current.words, current.kinds)
            found.append(current)
        current = None

    def fault(reason: str, of: int) -> FileFormatError:
        return FileFormatError(f"{path}: line {of}: {reason}.")

    while place < len(text):
        word = _WORD.match(text, place)
        if word is None:
            raise fault("is not Python text", line)
        kind, piece = str(word.lastgroup), word[0]
        place = word.end()
        if kind == "string":
            quote = piece.lstrip("bBrRuUfF")
            end = _STRING_END[quote].match(text, place)
            if end is None:
                raise fault("is not Python text: a text in quotes does not end", line)
            kind = "f-string" if "f" in piece[: -len(quote)].lower() else kind
            piece, place = text[word.start() : end.end()], end.end()
        at = line
        line += piece.count("\n")
        if kind == "newline":
            if depth == 0:
                ended()
                fresh, indent = True, 0
            continue
        if kind == "space":
            if fresh and current is None and not piece.startswith("\\"):
                indent = len(piece.expandtabs(8))
            continue
        if kind == "comment":
            continue
        if kind == "mark" and not (piece.isascii() and piece.isprintable()):
            raise fault(f"is not Python text ({piece!a})", at)
        if current is None:
            if piece == ";":
                continue
            if fresh:
                while blocks and blocks[-1].indent >= indent:
                    blocks.pop()
            inside = indent if fresh or not blocks else blocks[-1].indent + 0.001
            current = Statement(inside, at, parent=blocks[-1] if blocks else None)
            if len(blocks) > MAX_NESTED:
                raise fault("is nested too deeply", at)
            fresh = False
        if piece in _OPENS and kind == "mark":
            depth += 1
            if depth > MAX_NESTED:
                raise fault("is nested too deeply", at)
        elif piece in _CLOSES and kind == "mark":
            depth -= 1
            if depth < 0:
                raise fault(f"is not Python text: `{piece}` closes nothing", at)
        elif kind == "mark" and depth == 0 and piece == ";":
            ended()
            continue
        elif kind == "mark" and depth == 0 and piece == ":" and current.words and current.words[0] in _HEADERS:
            if current.words[0] == "async" and len(current.words) > 1:
                del current.words[0], current.kinds[0]
            if len(current.words) < 2 and current.words[0] in ("if", "elif", "for", "while", "with", "def", "class"):
                raise fault(f"is not Python text: `{current.words[0]}` of nothing", at)
            current.names = names_in(current.words, current.kinds)
            found.append(current)
            blocks.append(current)
            current = None
            continue
        dots = dots + 1 if piece == "." else dots * (kind == "name")
        if dots > MAX_NESTED:  # each name within it is kept
            raise fault("holds a name of too many parts", at)
        current.words.append(piece)
        current.kinds.append(kind)
    ended()
    if depth:
        raise fault("is not Python text: a bracket is not closed", line)
    return found


def parts_of(words: list[str], mark: str) -> list[tuple[int, int]]:
    """Return where the parts between marks outside of brackets begin and end."""
    parts, depth, begin = [], 0, 0
    for place, word in enumerate(words):
        depth += (word in ("(", "[", "{")) - (word in (")", "]", "}"))
        if word == mark and depth == 0:
            parts.append((begin, place))
            begin = place + 1
    return [*parts, (begin, len(words))]


def dotted(words: list[str]) -> str:
    """Return a name such as `self.times`, or an empty text for anything else."""
    if not words or len(words) % 2 == 0 or any(mark != "." for mark in words[1::2]):
        return ""
    return ".".join(words[::2]) if all(word.isidentifier() for word in words[::2]) else ""


def names_in(words: list[str], kinds: list[str]) -> set[str]:
    """Return the names that stand in words, and the beginnings of dotted ones: `self.times.append` is three names."""
    found = set[str]()
    for place, kind in enumerate(kinds):
        if kind == "name" and (not place or words[place - 1] != "."):
            name, end = words[place], place + 1
            found.add(name)
            while end + 1 < len(words) and words[end] == "." and kinds[end + 1] == "name" and end - place < 8:
                name = f"{name}.{words[end + 1]}"
                found.add(name)
                end += 2
    return found


_DEGREE = math.pi / 180
_CONSTANTS: dict[str, float] = dict.fromkeys(("math.pi", "numpy.pi", "np.pi", "almath.PI"), math.pi)
_CONSTANTS |= dict.fromkeys(("almath.TO_RAD", "motion.TO_RAD", "TO_RAD"), _DEGREE)
_TO_RADIANS = {"math.radians", "radians", "np.deg2rad", "numpy.deg2rad", "np.radians", "numpy.radians"}


def evaluate(words: list[str], kinds: list[str], value_of: Callable[[str], Any], count: Callable[[int], None]) -> Any:
    """Return the value of literals, lists and simple sums and products; ValueError for anything else.

    `value_of` gives the values of names; `count` is told of each list how long it is.
    """
    if name := dotted(words):
        known: dict[str, Any] = {"True": True, "False": False, "None": None} | _CONSTANTS
        return known[name] if name in known else value_of(name)
    if "f-string" in kinds or not words:
        raise ValueError("an expression")
    plain = [re.sub(r"(?<=\d)[lL]$", "", w) if k == "number" else w for w, k in zip(words, kinds, strict=True)]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of odd literals
            return _folded(ast.parse(" ".join(plain), mode="eval").body, value_of, count)
    except (SyntaxError, TypeError, ArithmeticError, RecursionError, MemoryError):
        raise ValueError("an expression") from None


def _folded(node: ast.expr, value_of: Callable[[str], Any], count: Callable[[int], None]) -> Any:
    match node:
        case ast.Constant(value=value) if value is None or isinstance(value, int | float | str):
            return value
        case ast.List(elts=parts) | ast.Tuple(elts=parts):
            count(len(parts))
            return [_folded(part, value_of, count) for part in parts]
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=inner):
            value = _number(_folded(inner, value_of, count))
            return -value if isinstance(node.op, ast.USub) else value
        case ast.BinOp(left=left, op=op, right=right):
            return _joined(op, _folded(left, value_of, count), _folded(right, value_of, count), count)
        case ast.Call(func=ast.Name(id="list"), args=[], keywords=[]):
            return []
        case ast.Call(func=ast.Name(id="len"), args=[inner], keywords=[]):
            return len(_folded(inner, value_of, count))
        case ast.Call(func=func, args=[inner], keywords=[]) if ast.unparse(func) in _TO_RADIANS:
            return _number(_folded(inner, value_of, count)) * _DEGREE
        case ast.Name() | ast.Attribute():
            name = ast.unparse(node)
            return _CONSTANTS[name] if name in _CONSTANTS else value_of(name)
    raise ValueError("an expression")


def _joined(op: ast.operator, left: Any, right: Any, count: Callable[[int], None]) -> Any:
    """Return a sum, difference, product or quotient of numbers, or a list added to or repeated."""
    if isinstance(op, ast.Mult) and isinstance(left, list) and type(right) is int:
        count(len(left) * max(right, 0))
        return left * right
    if isinstance(op, ast.Add) and isinstance(left, list) and isinstance(right, list):
        count(len(left) + len(right))
        return left + right
    a, b = _number(left), _number(right)
    if isinstance(op, ast.Div) and type(a) is int and type(b) is int and a % b:
        raise ValueError("a division that Python 2 and 3 do differently")
    done = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
    if type(op) not in done:
        raise ValueError("an expression")
    return done[type(op)](a, b)


def _number(value: Any) -> float:
    if type(value) not in (int, float) or abs(value) > 1e300:
        raise ValueError("no number")
    return value
