"""Find the command, make its flags from its settings dataclass, turn errors into one line and an exit code."""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import importlib
import inspect
import io
import os
import re
import signal
import sys
import textwrap
import threading
import types
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Union, cast, get_args, get_origin, get_type_hints

import tyro
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructFieldSpec, StructTypeInfo

from creative_nao.errors import CreativeNaoError, nearest_name, printable
from creative_nao.storage import DISK_FAULTS

FLAGS = ConstructorRegistry()
"""How tyro makes flags from our settings dataclasses, while inside ``with FLAGS``."""


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
    """Return the text under each field of a dataclass, also inherited ones, as one line; none without the source."""
    texts = {}
    for parent in reversed([one for one in settings.__mro__ if dataclasses.is_dataclass(one)]):
        try:
            (definition,) = ast.parse(textwrap.dedent(inspect.getsource(parent))).body
        except OSError:
            continue
        assert isinstance(definition, ast.ClassDef)
        for field, below in zip(definition.body, definition.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(below, ast.Expr):
                texts[field.target.id] = " ".join(ast.literal_eval(below.value).split())
    return texts


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
        if get_origin(value) is Annotated:
            value = get_args(value)[0]
        if get_origin(value) is tuple:
            one = get_args(value)[0].__name__.upper()
            return f"{one} [{one} ...]"
        choices = ("True", "False") if value is bool else get_args(value)
        return "{" + ",".join(choices) + "}" if choices else value.__name__.upper()
    return None


PROGRAM = "creative-nao"
COMMANDS = {
    "teach": ("teach", "TeachSettings", "record the six basic actions by dragging the robot's limp arms"),
    "train": ("train", "TrainSettings", "train a memory on basic actions"),
    "map": ("map", "MapSettings", "generate and score a whole grid of a memory's PB space"),
    "score": ("score", "ScoreSettings", "score recorded movements against the basic actions"),
    "infer": ("infer", "InferSettings", "find the point of a memory's PB space that makes a recorded movement"),
    "export": ("export", "ExportSettings", "write a movement for a robot, another program, or as a film"),
    "agent train": ("agent", "TrainAgentSettings", "train an agent that learns to explore a memory"),
    "agent memories": ("agent_memories", "AgentMemoriesSettings", "train memories for `agent train learned_map`"),
    "agent tune": ("agent", "TuneAgentSettings", "search hyperparameters on validation memories"),
    "agent run": ("agent", "RunAgentSettings", "let an agent play and print what it earned"),
    "agent record": ("agent", "RecordAgentSettings", "write an agent's episodes as a Minari dataset"),
    "agent body-sense": ("agent_body_sense", "BodySenseSettings", "learn which movements the body refuses"),
    "explore": ("explore", "ExploreSettings", "touch a memory in the browser and watch the robot do what is there"),
    "evaluate": ("evaluate", "EvaluateSettings", "compare agents on a suite; ends with a table and a report"),
    "evaluate paper": ("evaluate_paper", "PaperOptions", "reproduce the paper, claim by claim"),
    "evaluate verify": ("evaluate", "VerifySettings", "play episodes of a result file again"),
    "evaluate leaderboard": ("evaluate", "LeaderboardSettings", "compare finished runs"),
    "memories": ("memories", "MemoriesSettings", "list the shipped memories"),
    "doctor": ("doctor", "DoctorSettings", "say what this machine can do"),
}
"""Command, of one or two words: its file in this folder, its settings class and what it is for."""

USER_ERROR, INTERRUPTED = 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code: 0, 2 for a user's mistake, 130 after Ctrl-C or SIGTERM."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):  # what the terminal's encoding does not have is written as an escape
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if not words or words[0] in ("-h", "--help"):
        print(overview())
        return 0
    if words[0] == "--version":
        from creative_nao import __version__

        print(f"{PROGRAM} {__version__}")
        return 0
    try:
        with _terminated_like_interrupted():
            return _run(words)
    except CreativeNaoError as error:
        return _fail(str(error))
    except (FileExistsError, NotADirectoryError, IsADirectoryError, PermissionError) as error:
        return _fail(f"{error.filename}: {error.strerror}")
    except KeyboardInterrupt:
        print(f"{PROGRAM}: stopped", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        if error.errno not in DISK_FAULTS:
            raise
        return _fail(
            f"{error.filename or 'a file could not be written'}: {error.strerror}; the old file, if any, stands"
        )


def overview(group: str = "") -> str:
    """Return the text of bare `creative-nao`, or of a command that only groups others, such as `agent`."""
    names = [name for name in COMMANDS if not group or name.startswith(f"{group} ")]
    width = max(map(len, names))
    head = f"{PROGRAM} {group}".strip()
    lines = [f"usage: {head} COMMAND [options]", ""]
    if not group:
        lines += ["A robot invents movements of its own, and its creativity is measured.", ""]
    lines += [f"  {name:<{width}}  {COMMANDS[name][2]}" for name in names]
    lines += ["", f"{PROGRAM} COMMAND --help tells the options of a command, their units and defaults."]
    if not group:
        lines.append(f"A first look, in minutes: {PROGRAM} evaluate quick")
    return "\n".join(lines)


@contextlib.contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """While inside, SIGTERM ends the work as Ctrl-C does, so that nothing half-written and no worker is left behind."""

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _run(words: list[str]) -> int:
    """Run the command that the first one or two words name."""
    name = " ".join(words[:2]) if " ".join(words[:2]) in COMMANDS else words[0]
    if name not in COMMANDS:
        parts = [command.partition(" ")[2] for command in COMMANDS if command.startswith(f"{name} ")]
        if not parts:
            known = [command for command in COMMANDS if " " not in command] + ["agent"]
            return _fail(f"no command `{name}`{nearest_name(name, known)}; there are {', '.join(known)}")
        if words[1:] in ([], ["-h"], ["--help"]):
            print(overview(name))
            return 0
        return _fail(f"no command `{name} {words[1]}`{nearest_name(words[1], parts)}; there are {', '.join(parts)}")
    module_name, settings_name, _ = COMMANDS[name]
    module = importlib.import_module(f"creative_nao.cli.{module_name}")
    settings = _parse(getattr(module, settings_name), name, words[len(name.split()) :])
    return settings if isinstance(settings, int) else module.run(settings)


def _parse(settings_class: type, name: str, words: list[str]) -> Any:
    """Return the settings, or an exit code when the flags ask for help or cannot be read."""
    flags = [word.partition("=")[0] for word in words if word.startswith("--")]
    if twice := [flag for flag in flags if flags.count(flag) > 1]:
        return _fail(
            f"{name}: {twice[0]} is given twice, of which one would be lost; give it once, with all its values"
        )
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint), FLAGS:
            return tyro.cli(settings_class, prog=f"{PROGRAM} {name}", args=words)
    except SystemExit as error:
        if error.code in (0, None):
            return 0
        return _fail(f"{name}: {_one_line(complaint.getvalue())}; see {PROGRAM} {name} --help")


def _one_line(box: str) -> str:
    """Return the message of a framed, many-lined complaint as one line."""
    lines = [
        re.sub(r"[╭╮╰╯│─|+]+|-{5,}", " ", line).strip() for line in re.sub(r"\x1b\[[0-9;]*m", "", box).splitlines()
    ]
    sentences = []
    for line in lines[1:]:
        if not line or line.startswith(("Argument helptext", "For full helptext")):
            if sentences:
                break
            continue
        sentences.append(line)
    return " ".join(sentences).rstrip(".") or "these options cannot be read"


def _fail(message: str) -> int:
    print(f"{PROGRAM}: {printable(' '.join(message.split()))}", file=sys.stderr)
    return USER_ERROR
