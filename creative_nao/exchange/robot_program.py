"""Programs that move a NAO, read without running them: exports of Choregraphe and what people write by hand.

Followed are the lists that calls of `angleInterpolation` and `angleInterpolationBezier` play: assigned as literals,
simple sums and products of them, or filled by `append` and `extend`, in the order of the lines. Each call is a
movement; in a program without one, lists called names, times and keys are. Whatever else may change such a list -
loops, conditions, changes in place, functions elsewhere - makes it unknown, and a movement that needs it is refused,
naming the line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from creative_nao.errors import FileFormatError
from creative_nao.exchange.choregraphe import keys_of
from creative_nao.exchange.keys import MAX_MOVEMENTS, NOTHING_SAID, Keys, Reading
from creative_nao.exchange.program_text import Statement, decoded, dotted, evaluate, names_in, parts_of, statements_of

MAX_PYTHON_BYTES = 600_000
MAX_CELLS = 1_000_000  # of all lists that are played or made
MAX_DEPTH = 10  # lists within each other that are played; the handles of a Bezier curve are four
_LISTS = {
    "names": "names", "jointNames": "names", "joint_names": "names",
    "times": "times", "timeLists": "times", "time_lists": "times",
    "keys": "keys", "angles": "keys", "angleLists": "keys", "angle_lists": "keys",
}  # fmt: skip
"""Names under which the three lists are known in a program that does not play them."""
_PLAYS = {"angleInterpolation": (0, 2, 1), "angleInterpolationBezier": (0, 1, 2)}
"""Calls that play lists, and where names, times and keys stand in them."""
_WITHOUT_TIMES = {"setAngles", "changeAngles", "angleInterpolationWithSpeed", "setAngle", "changeAngle"}
_HARMLESS = _WITHOUT_TIMES | {
    "setStiffnesses", "stiffnessInterpolation", "getStiffnesses", "getAngles", "setCollisionProtectionEnabled",
    "killTasksUsingResources", "areResourcesAvailable", "debug", "info", "warning", "error", "log",
}  # fmt: skip
_QUIET = _HARMLESS | _PLAYS.keys() | {
    "max", "min", "sum", "len", "str", "repr", "float", "int", "round", "any", "all", "isinstance", "type", "print",
    "format", "range", "join", "dumps",
}  # fmt: skip
_PLAIN = "should hold plain numbers and texts, but"
MAX_NOTES = 50
_HIDDEN = {"exec", "execfile", "setattr", "globals"}
_OWN = {  # how our own exports slow down on request and tell what they would do; --slower is 1 unless asked otherwise
    "when=[[t*options.slowerfortinone]foroneintimes]": "when",
    "forname,one_times,one_keysinzip(names,when,keys)": "",
    "defdry_run(when,stiffness)": "",
    "dry_run(when,options.stiffness)": "",
}


class _Unknown:
    """What cannot be followed, and why; `line` is where."""

    def __init__(self, line: int, reason: str) -> None:
        self.line, self.reason = line, reason


def read_python(path: Path, content: bytes, reading: Reading = NOTHING_SAID) -> list[Keys]:
    """Read the movements of a program without running it; errors name the line."""
    if len(content) > MAX_PYTHON_BYTES:
        raise FileFormatError(
            f"{path}: has {len(content)} bytes, expected at most {MAX_PYTHON_BYTES} of a Python file."
        )
    return _Follower(path, statements_of(path, decoded(path, content))).movements()


class _Parameter(_Unknown):
    """An argument of a function: known where the function is called."""


class _Sticky(_Unknown):
    """Unknown for good: a function changes it, and when that runs is not known."""


_Place = tuple[int, str]  # function (0: none) and name; attributes of objects belong to none


class _Follower:
    """Follows the statements of a program in their order and gathers what it plays."""

    def __init__(self, path: Path, statements: list[Statement]) -> None:
        self.path, self.statements = path, statements
        self.calls = {id(one): found for one in statements if (found := self._plays(one))}
        self.values: dict[_Place, Any] = {}
        self.shared: dict[_Place, set[_Place]] = {}  # names that may hold the same lists
        self.homes: dict[str, list[int]] = {}  # the functions in which an attribute is set
        self.functions = {one.words[1]: one for one in statements if one.words[0] == "def" and len(one.words) > 1}
        self.tracked = self._reached()
        self.waiting: dict[int, list[Statement]] = {}
        self.ran: set[int] = set()
        self.found: list[tuple[list[Any], int]] = []  # names, times and keys, and the line
        self.filled: dict[str, tuple[_Place, int]] = {}
        self.relative = 0
        self.notes: list[str] = []
        self.n_cells = 0

    def fault(self, line: int, told: str) -> FileFormatError:
        return FileFormatError(f"{self.path}: line {line}: {told}.")

    @staticmethod
    def _plays(one: Statement) -> tuple[str, int] | None:
        for place, word in enumerate(one.words[:-1]):
            if word in _PLAYS and one.words[place + 1] == "(" and one.words[0] != "def":
                return word, place + 1
        return None

    def _reached(self) -> set[str]:
        """Return the names that may share lists with what is played, or with the three known ones where nothing is."""
        leads: dict[str, list[str]] = {}
        start = set[str]()
        for one in self.statements:
            known = one.names
            plays = id(one) in self.calls or self._function_called(one) is not None
            start |= known if plays else {n for n in known if n.rpartition(".")[2] in _LISTS or _says_absolute(n)}
            if "=" in one.words:
                knot = f"={id(one)}"  # ties all names of one assignment together
                leads[knot] = list(known)
                for name in known:
                    leads.setdefault(name, []).append(knot)
        reached, todo = set[str](), list(start)
        while todo:
            if (name := todo.pop()) not in reached:
                reached.add(name)
                todo += leads.get(name, ())
        return reached - {"self", "list", "True", "False", "None"} - _QUIET

    def movements(self) -> list[Keys]:
        """Return what the program plays."""
        for one in self.statements:
            self._follow(one)
        for scope, calls in self.waiting.items():
            for call in calls if scope not in self.ran else []:
                if not any(isinstance(self._value(call, name), _Parameter) for name in self._needed(call)):
                    self._play(call, {})
        if not self.calls:
            self._begins_anew(None, 0)
        if not self.found:
            self._nothing()
        movements = []
        for (names, times, keys), line in self.found:
            movement = keys_of(self.path, names, times, keys)
            movement.place = f"line {line}"
            movement.notes += self.notes
            movements.append(movement)
        return movements

    def _nothing(self) -> None:
        for one in self.statements:
            if id(one) in self.calls:
                raise self.fault(one.line, "plays lists that it is given, and is given none that are known")
            for name in _WITHOUT_TIMES & set(one.words):
                raise self.fault(one.line, f"`{name}` gives postures without times; expected `angleInterpolation`")
        missing = [name for name in ("names", "times", "keys") if name not in self.filled]
        raise FileFormatError(
            f"{self.path}: no list of {' and '.join(missing)}; expected names, times and keys (or angles)."
        )

    # one statement

    def _follow(self, one: Statement) -> None:
        words = one.words
        own = _OWN.get("".join(words)) if len(words) < 30 else None
        if own is not None:
            if own:
                self._bind(one, own, self._value(one, "times"), {"times"})
            return
        for place, word in enumerate(words):
            hidden = word in _HIDDEN or (word in ("locals", "vars", "__dict__") and ("=" in words or "update" in words))
            if hidden and one.kinds[place] == "name" and (word == "__dict__" or words[place - 1 : place] != ["."]):
                raise self.fault(one.line, f"`{word}` may change what is played; it cannot be followed")
            if word in _WITHOUT_TIMES and one.kinds[place] == "name" and len(self.notes) < MAX_NOTES:
                self.notes.append(f"left out: `{word}` in line {one.line}, which gives no times")
        if id(one) in self.calls:
            self._call(one)
            return
        if words[0] == "def":
            for name in names_in(words[2:], one.kinds[2:]):
                self.values[id(one), name] = _Parameter(one.line, f"`{name}` is an argument of a function")
            return
        called = self._function_called(one)
        if called is not None and id(called) in self.waiting:
            self._run(one, called)
            return
        mentioned = one.names & self.tracked
        if not mentioned or words[0] == "class":
            return
        if words[0] == "global":
            for name in mentioned:
                self.values[0, name] = _Sticky(one.line, f"`{name}` changes in a function; it cannot be followed")
            return
        parts = parts_of(words, "=")
        if words[0] in ("for", "with", "del", "import", "from", "except"):
            self._lose(one, mentioned, f"`{words[0]}` uses `{min(mentioned)}`")
        elif len(parts) > 1:
            self._assign(one, parts, mentioned)
        elif not self._filled(one) and not self._is_quiet(words, mentioned):
            self._lose(one, mentioned, f"`{min(mentioned)}` may change here")

    @staticmethod
    def _is_quiet(words: list[str], mentioned: set[str]) -> bool:
        """Whether words only look: every call in them is of a function or of a robot that changes no list."""
        if any(word.endswith("=") and word not in ("==", "<=", ">=", "!=") for word in words) or "lambda" in words:
            return False
        called = {words[k - 1] for k, word in enumerate(words) if word == "(" and k and words[k - 1].isidentifier()}
        heads = ("print", "return", "assert", "if", "elif", "while", "raise", "yield")
        quiet = _QUIET if words[:1] == ["return"] else _QUIET | {"list"}  # a copy holds the same rows
        return called <= quiet and (words[0] in heads or bool(called)) and "for" not in words

    def _assign(self, one: Statement, parts: list[tuple[int, int]], mentioned: set[str]) -> None:
        begin, end = parts[-1]
        words, kinds = one.words[begin:end], one.kinds[begin:end]
        value = self._evaluated(one, words, kinds)
        inside = names_in(words, kinds) & self.tracked
        if isinstance(value, _Unknown) and inside and not self._is_quiet(["return", *words], inside):
            self._lose(one, inside, f"`{min(inside)}` is used in an expression")
        for first, last in parts[:-1]:
            target, sorts = one.words[first:last], one.kinds[first:last]
            if ":" in target and "[" not in target[: target.index(":")]:  # an annotation
                target, sorts = target[: target.index(":")], sorts[: target.index(":")]
            if name := dotted(target):
                self._bind(one, name, value, inside)
                continue
            if target[:1] == ["("] and target[-1:] == [")"]:
                target, sorts = target[1:-1], sorts[1:-1]
            singles = [dotted(target[a:b]) for a, b in parts_of(target, ",") if b > a]
            if not all(singles):
                self._lose(one, names_in(target, sorts) & self.tracked, f"`{''.join(target)[:40]}` is set in place")
                continue
            unknown = _Unknown(one.line, "holds an expression; it is not run")
            values = value if isinstance(value, list) and len(value) == len(singles) else [unknown] * len(singles)
            for name, single in zip(singles, list(values), strict=True):
                self._bind(one, name, single, inside)

    def _filled(self, one: Statement) -> bool:
        """Follow `T.append(...)`, `T.extend(...)` and `T += ...`; return whether it is one."""
        words = one.words
        if "+=" in words:
            name, begin, end, many = dotted(words[: words.index("+=")]), words.index("+=") + 1, len(words), True
        else:
            opened = words.index("(") if "(" in words else 0
            if opened < 3 or words[opened - 1] not in ("append", "extend") or words[-1] != ")":
                return False
            begin, end, many = opened + 1, len(words) - 1, words[opened - 1] != "append"
            name = dotted(words[: opened - 2])
        if not name:
            return False
        place, held = self._place(one, name), self._value(one, name)
        value = self._evaluated(one, words[begin:end], one.kinds[begin:end])
        blocked, home = one.condition(), self.homes.get(name, [place[0]])[-1]
        if blocked is not None:
            self._lose(one, {name}, f"`{name}` grows only under the `{blocked.words[0]}` of line {blocked.line}")
        elif isinstance(held, _Unknown) and not isinstance(held, _Parameter):
            pass
        elif home != self._scope(one):
            self._lose(one, {name}, f"`{name}` grows in another function than it begins in")
        elif isinstance(value, _Unknown):
            told = value.reason if value.reason.startswith("`") else f"`{name}` {_PLAIN} {value.reason}"
            self.values[place] = _Unknown(value.line, told)
        elif not isinstance(held, list) or (many and not isinstance(value, list)):
            self._lose(one, {name}, f"`{name}` is no list that is known")
        else:
            held.extend(value) if many else held.append(value)
            self._share(one, place, names_in(words[begin:end], one.kinds[begin:end]))
        return True

    # values

    def _scope(self, one: Statement) -> int:
        function = one.function
        return 0 if function is None else id(function)

    def _place(self, one: Statement, name: str) -> _Place:
        """Return where a name is found: in its function, else outside of all."""
        scope = self._scope(one)
        return (scope, name) if "." not in name and (scope, name) in self.values else (0, name)

    def _value(self, one: Statement, name: str) -> Any:
        return self.values.get(self._place(one, name), _Unknown(one.line, f"`{name}` is not known here"))

    def _bind(self, one: Statement, name: str, value: Any, beside: set[str]) -> None:
        """Give a name a value; `beside` are the names from which it comes."""
        blocked, scope = one.condition(), self._scope(one)
        if blocked is not None:
            told = f"`{name}` is set only under the `{blocked.words[0]}` of line {blocked.line}"
            value = _Unknown(one.line, f"{told}; it cannot be followed")
        place = (0 if "." in name else scope, name)
        kind = None if self.calls else _LISTS.get(name.rpartition(".")[2])
        if kind:
            self._begins_anew(kind, one.line)
            self.filled[kind] = (place, one.line)
        if _says_absolute(name) and value in (False, 0):
            self.relative = one.line
        if isinstance(self.values.get(place), _Sticky):
            return
        if "." in name and scope not in self.homes.setdefault(name, []):
            self.homes[name].append(scope)
        self.values[place] = value
        self._share(one, place, beside)

    def _share(self, one: Statement, place: _Place, names: set[str]) -> None:
        """Remember which names may hold the same lists: what happens to one unseen happens to all."""
        for other in (self._place(one, name) for name in names):
            if other != place and isinstance(self.values.get(other), list):
                self.shared.setdefault(place, set()).add(other)
                self.shared.setdefault(other, set()).add(place)

    def _lose(self, one: Statement, names: set[str], reason: str) -> None:
        """Make names unknown, and all that share lists; what a function does to others' lists cannot be followed."""
        scope, todo = self._scope(one), [self._place(one, name) for name in names]
        while todo:
            place = todo.pop()
            home = self.homes.get(place[1], [place[0]])[-1]
            self.values[place] = (_Unknown if home == scope else _Sticky)(one.line, f"{reason}; it cannot be followed")
            todo += self.shared.pop(place, ())

    def _evaluated(self, one: Statement, words: list[str], kinds: list[str]) -> Any:
        """Return the value of literals and simple sums and products, or what cannot be followed."""

        def value_of(name: str) -> Any:
            value = self._value(one, name)
            if isinstance(value, _Unknown):
                raise ValueError(value)
            return value

        try:
            return evaluate(words, kinds, value_of, self._count)
        except ValueError as error:
            if isinstance(error, FileFormatError):
                raise
            if isinstance(error.args[0], _Unknown):
                return error.args[0]
            return _Unknown(one.line, "holds an expression; it is not run")

    def _count(self, n: int) -> None:
        self.n_cells += n
        if self.n_cells > MAX_CELLS:
            raise FileFormatError(f"{self.path}: makes lists of more than {MAX_CELLS} numbers.")

    # what is played

    def _function_called(self, one: Statement) -> Statement | None:
        place = next((k for k, word in enumerate(one.words) if word == "("), 0)
        return self.functions.get(one.words[place - 1]) if place and one.words[0] not in ("def", "class") else None

    def _call(self, one: Statement) -> None:
        """Play a call now if all it needs is at hand, else when its function is called or the program ends."""
        places = [self._place(one, name) for name in self._needed(one)]
        at_hand = all(p in self.values and not isinstance(self.values[p], _Parameter) for p in places)
        if at_hand and (one.function is None or all(p[0] or "." in p[1] for p in places)):
            self._play(one, {})
        else:
            self.waiting.setdefault(self._scope(one), []).append(one)

    def _arguments(self, one: Statement) -> list[tuple[int, int]]:
        _, opened = self.calls[id(one)]
        depth, end = 0, len(one.words)
        for place in range(opened, len(one.words)):
            depth += (one.words[place] in ("(", "[", "{")) - (one.words[place] in (")", "]", "}"))
            if depth == 0:
                end = place
                break
        parts = [(opened + 1 + a, opened + 1 + b) for a, b in parts_of(one.words[opened + 1 : end], ",") if b > a]
        return [(a + 2 if one.words[a + 1 : a + 2] == ["="] else a, b) for a, b in parts]

    def _needed(self, one: Statement) -> set[str]:
        return {dotted(one.words[begin:end]) for begin, end in self._arguments(one)} - {"", "True", "False"}

    def _run(self, one: Statement, function: Statement) -> None:
        """Play what waits in a function for this call, with its arguments in the place of the parameters."""
        opened, inner = one.words.index("("), list[str]()
        if one.words[-1] == ")":
            inner = one.words[opened + 1 : -1]
        given = [dotted(inner[a:b]) for a, b in parts_of(inner, ",") if b > a]
        head = function.words[3:-1]
        parameters = [head[a] for a, b in parts_of(head, ",") if b > a and head[a] != "self"]
        bound: dict[str, Any] = {}
        for place, parameter in enumerate(parameters):
            lost = _Unknown(one.line, f"`{parameter}` is given in a way that cannot be followed")
            bound[parameter] = self._value(one, given[place]) if place < len(given) and given[place] else lost
        self.ran.add(id(function))
        for call in self.waiting[id(function)]:
            self._play(call, bound)

    def _play(self, one: Statement, bound: dict[str, Any]) -> None:
        """Keep what a call plays."""
        method, _ = self.calls[id(one)]
        values = []
        for begin, end in self._arguments(one):
            name = dotted(one.words[begin:end])
            value = self._evaluated(one, one.words[begin:end], one.kinds[begin:end])
            if isinstance(value, _Parameter) and name in bound:
                value = bound[name]
            homes = self.homes.get(name, [])
            if len(homes) > 1 and homes[-1] != self._scope(one):
                raise self.fault(one.line, f"`{name}` is set in {len(homes)} functions; it cannot be followed")
            if isinstance(value, _Unknown):
                told = value.reason if value.reason.startswith("`") else f"what `{method}` plays {value.reason}"
                raise self.fault(value.line, told)
            values.append(value)
        if not 3 <= len(values) <= 4 or "*" in {one.words[begin] for begin, _ in self._arguments(one)}:
            raise self.fault(one.line, f"`{method}` has {len(values)} arguments, expected 3 or 4")
        if method == "angleInterpolation" and len(values) == 3:
            self.notes.append(f"line {one.line} does not say whether its angles are absolute; taken so")
        elif method == "angleInterpolation" and values[3] not in (True, 1):
            raise self.fault(one.line, f"angles are relative (isAbsolute is {values[3]!r:.20}); expected absolute ones")
        blocked = one.condition()
        if blocked is not None and blocked.words[0] in ("for", "while"):
            self.notes.append(f"line {one.line} is in the loop of line {blocked.line}; read once")
        self._keep([self._copied(values[place]) for place in _PLAYS[method]], one.line)

    def _keep(self, played: list[Any], line: int) -> None:
        if self.found and played == self.found[-1][0]:
            self.notes.append(f"line {line} plays the same again; read once")
        else:
            self.found.append((played, line))
        if max(len(self.found), len(self.notes)) > MAX_MOVEMENTS:
            raise self.fault(line, f"more than {MAX_MOVEMENTS} movements or things to say about them")

    def _copied(self, value: Any, depth: int = 0) -> Any:
        if isinstance(value, list):
            self._count(len(value))
            if depth > MAX_DEPTH:
                raise FileFormatError(f"{self.path}: plays lists that hold themselves, or within {MAX_DEPTH} others.")
            return [self._copied(one, depth + 1) for one in value]
        return value

    def _begins_anew(self, kind: str | None, line: int) -> None:
        """Where nothing is played, three filled lists are a movement as soon as one of them begins anew."""
        held = {name: self.values.get(place) for name, (place, _) in self.filled.items()}
        if kind is not None and held.get(kind, []) == []:
            return
        for name, value in held.items():
            if isinstance(value, _Unknown):
                told = value.reason if value.reason.startswith("`") else f"`{name}` {_PLAIN} {value.reason}"
                raise self.fault(value.line, told)
        if not all(held.get(name) for name in ("names", "times", "keys")):
            self.filled = {name: where for name, where in self.filled.items() if held[name]}
            if kind is not None:
                raise self.fault(line, f"`{kind}` begins anew before names, times and keys are complete")
            return
        if self.relative:
            raise self.fault(self.relative, "angles are relative; expected absolute ones")
        first = self.filled["names"][1]
        self._keep([self._copied(held[name]) for name in ("names", "times", "keys")], first)
        self.filled = {}


def _says_absolute(name: str) -> bool:
    return name.rpartition(".")[2].lower().replace("_", "") in ("isabsolute", "absolute")
