"""What works on one system works on the others, as far as the source can tell."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = [
    path for part in ("creative_nao", "benchmarks", "examples", "docs") for path in sorted((ROOT / part).rglob("*.py"))
]
TEXT_METHODS = {"read_text", "write_text"}
NEVER = {"fork", "getuid", "geteuid", "getpgid", "killpg", "setsid", "uname", "statvfs", "mkfifo", "O_DIRECTORY"}
GUARDED = {"sched_getaffinity", "sched_setaffinity", "O_NOFOLLOW", "posix_fadvise", "getloadavg"}
POSIX_MODULES = {"fcntl", "pwd", "grp", "resource", "termios", "tty", "pty", "syslog"}
SIGNALS = {"SIGINT", "SIGTERM", "signal", "Signals", "default_int_handler", "SIG_DFL", "SIG_IGN", "getsignal"}
"""What `signal` has on every system."""


def calls(text):
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            yield node


def without_encoding(text):
    """Return the lines that open a text file in whatever encoding the system prefers."""
    lines = []
    for call in calls(text):
        name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
        owner = ast.unparse(call.func.value) if isinstance(call.func, ast.Attribute) else ""
        if owner in ("atomic", "os", "Image", "gzip", "zipfile", "webbrowser"):  # bytes, or UTF-8 by themselves
            continue
        if name == "open" and not owner:
            mode = (
                call.args[1] if len(call.args) > 1 else next((k.value for k in call.keywords if k.arg == "mode"), None)
            )
            missing = not (isinstance(mode, ast.Constant) and "b" in str(mode.value))
        elif name in TEXT_METHODS and owner:
            missing = len(call.args) <= (name == "write_text")
        else:
            continue
        if missing and not any(k.arg in ("encoding", None) for k in call.keywords):
            lines.append(call.lineno)
    return lines


def without_fallback(text):
    """Return uses of what only some systems have, and of what is asked for without looking whether it is there."""
    found, tree = [], ast.parse(text)
    named = [call.args[1] for call in calls(text) if ast.unparse(call.func) == "hasattr" and len(call.args) > 1]
    looked_for = {node.value for node in named if isinstance(node, ast.Constant)}
    tried = [
        inside
        for node in ast.walk(tree)
        if isinstance(node, ast.Try) and any("ImportError" in ast.unparse(one) for one in node.handlers)
        for inside in node.body
    ]
    for node in ast.walk(tree):
        of_os = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "os"
        if of_os and node.attr in NEVER | GUARDED and node.attr not in looked_for:
            found.append((node.lineno, node.attr))
        of_signal = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "signal"
        if of_signal and node.attr not in SIGNALS | looked_for:
            found.append((node.lineno, node.attr))
        imported = [one.name for one in node.names] if isinstance(node, ast.Import) and node not in tried else []
        imported += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
        found += [(node.lineno, name) for name in imported if name.partition(".")[0] in POSIX_MODULES]
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_text_file_is_opened_with_a_named_encoding(path):
    assert not without_encoding(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_nothing_is_used_that_only_some_systems_have(path):
    assert not without_fallback(path.read_text(encoding="utf-8"))


def test_both_searches_find_what_they_look_for():
    bad = "open(p)\nopen(p, 'w')\np.read_text()\np.write_text('x')\nopen(p, 'rb')\np.read_text(encoding='utf-8')\n"

    assert without_encoding(bad) == [1, 2, 3, 4]
    assert without_fallback("import os\nos.fork()\nos.sched_getaffinity(0)\n") == [
        (2, "fork"),
        (3, "sched_getaffinity"),
    ]
    assert without_fallback(
        "import signal\nsignal.alarm(1)\nsignal.SIGTERM\nimport fcntl\nfrom pwd import getpwnam\n"
    ) == [
        (4, "fcntl"),
        (5, "pwd"),
        (2, "alarm"),
    ]
    assert not without_fallback("n = os.sched_getaffinity(0) if hasattr(os, 'sched_getaffinity') else 1")


def test_no_two_files_differ_only_in_case():
    names = [path.relative_to(ROOT).as_posix().lower() for path in (ROOT / "creative_nao").rglob("*")]

    assert len(names) == len(set(names))
