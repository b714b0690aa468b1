"""Files: atomic writes, and bounded reads of bytes, text, JSON and YAML that anybody may have made.

JSON files of ours carry a SHA-256 of their content under `sha256`, which `read_json` compares; only plain files are
opened, without waiting.

New content goes into a temporary file beside the old one, which it then replaces: a reader sees the old content or the
new one. The writer holds a lock on the temporary file for as long as it lives, so that the next writer in that folder
can tell what a killed writer left behind from what is being written, and remove it.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import json
import logging
import math
import os
import platform
import re
import secrets
import stat
import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal

from creative_nao.errors import CreativeNaoError, FileFormatError, NotFoundError

try:
    import fcntl
except ImportError:  # Windows has no such locks; what a killed writer left stays there
    fcntl = None

DISK_FAULTS = {
    errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.ENOENT, errno.ENAMETOOLONG, errno.EIO, errno.ESTALE,
}  # fmt: skip
"""What a full, read-only, broken or vanished place to write answers."""

_MACHINE = f"{zlib.crc32(platform.node().encode()):08x}"
"""Another machine's lock need not be visible here: each sweeps only what it left itself."""
_MARK = ".writing-"
_NAME_CHARACTERS = 40


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str], private: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path`; when the block ends well, it takes the place of `path` in one step.

    When the block raises, the temporary file is removed and `path` stays as it was. Missing folders are made. Only
    its owner may read a `private` file.

    Raises:
        OSError: If the file cannot be written; `filename` is then `path`.
    """
    target = Path(path)
    lock = -1
    temporary = target.with_name(
        f".{target.name[:_NAME_CHARACTERS]}{_MARK}{_MACHINE}-{secrets.token_hex(4)}{target.suffix}"
    )
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        sweep(target.parent)
        lock = _create(temporary, 0o600 if private else 0o666)
        yield temporary
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, target)
    except OSError as error:
        # Only the system's own errors: ours are text.
        if error.errno is not None and error.filename in (None, os.fspath(temporary), temporary):
            error.filename = os.fspath(target)
        raise
    finally:
        with contextlib.suppress(OSError):  # where nothing can be removed, the first error is the one to tell
            temporary.unlink(missing_ok=True)
        if lock >= 0:
            os.close(lock)


def write_bytes(path: str | os.PathLike[str], content: bytes, private: bool = False) -> Path:
    """Replace the content of `path` by `content` in one step, as `replacing` does, and return the path."""
    with replacing(path, private) as temporary:
        temporary.write_bytes(content)
    return Path(path)


def write_text(path: str | os.PathLike[str], content: str, private: bool = False) -> Path:
    """Replace the content of `path` by `content` (UTF-8) in one step, as `replacing` does, and return the path."""
    return write_bytes(path, content.encode("utf-8"), private)


def sweep(folder: str | os.PathLike[str]) -> None:
    """Remove the temporary files in a folder whose writers on this machine are gone; leave those being written."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if not (entry.name.startswith(".") and f"{_MARK}{_MACHINE}-" in entry.name):
                continue
            with contextlib.suppress(OSError):
                handle = _open_plain(entry.path, os.O_RDONLY | _NO_LINK)
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    os.unlink(entry.path)
                finally:
                    os.close(handle)


def own_folder(folder: str | os.PathLike[str]) -> Path:
    """Make a folder for what this user keeps, or close one that is there to all others, and return it."""
    path = Path(folder)
    path.mkdir(parents=True, exist_ok=True, mode=0o700)
    with contextlib.suppress(OSError):  # another user's, or a file system without owners
        path.chmod(0o700)
    return path


LOCK_S = 5.0
"""How long a folder's lock is waited for: on a folder that others may read, anybody can hold it for ever."""


@contextlib.contextmanager
def alone(folder: str | os.PathLike[str], deadline_s: float = LOCK_S) -> Iterator[None]:
    """While inside, other processes of this machine that ask for the same folder wait: to read a file and replace it.

    Where the system has no locks on folders, nobody waits. The folder is made if it is missing.

    Raises:
        TimeoutError: If another process has held the lock for `deadline_s` [s].
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    end = time.monotonic() + deadline_s
    try:
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > end:
                    raise TimeoutError(errno.ETIMEDOUT, "another process holds its lock", os.fspath(folder)) from None
                time.sleep(0.02)
            except OSError:  # some network file systems have none
                break
        yield
    finally:
        os.close(handle)


def _create(temporary: Path, mode: int) -> int:
    """Make the file and return a handle that holds its lock; -1 where there are no locks."""
    while True:
        handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, mode)
        if fcntl is None:
            os.close(handle)
            return -1
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        if os.fstat(handle).st_nlink:
            return handle
        os.close(handle)  # swept away between its creation and its lock


_NO_LINK, _NO_WAIT = getattr(os, "O_NOFOLLOW", 0), getattr(os, "O_NONBLOCK", 0)  # Windows has neither


def _open_plain(path: str | os.PathLike[str], flags: int) -> int:
    """Open a plain file and return its handle; what waits for somebody, such as a pipe, is an OSError at once."""
    handle = os.open(path, flags | _NO_WAIT, 0o666)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "it should be a plain file, but is none", os.fspath(path))
    return handle


def open_plain(path: str | os.PathLike[str], mode: Literal["rb", "ab"] = "rb", *, follow: bool = True) -> BinaryIO:
    """Open a plain file; a pipe, device, socket or folder is an OSError, and unless told to `follow`, a link too."""
    return open(
        path, mode, encoding=None, opener=lambda name, flags: _open_plain(name, flags | (0 if follow else _NO_LINK))
    )


def read_end(path: Path, most: int) -> str:
    """Return the last `most` bytes of a plain file that is no link, as text; OSError if it cannot be read."""
    with open_plain(path, follow=False) as stream:
        stream.seek(max(0, os.fstat(stream.fileno()).st_size - most))
        return stream.read(most).decode("utf-8", "replace")


MAX_TEXT_BYTES = 64_000_000  # largest JSON file, a run folder's results; smaller limits are given where they are known
MAX_DEPTH = 64  # lists and objects within each other that JSON may have
MAX_DIGITS = 40  # of a whole number in JSON; the state of a random generator has 39
MAX_JSON_GROUPS = 250_000  # lists and objects of a JSON file; one of three bytes takes a hundred in memory
MAX_JSON_VALUES = 2_000_000
MAX_YAML_BYTES = 2_000_000
MAX_YAML_VALUES = 250_000  # scalars, lists and mappings of a YAML file, with its aliases written out


def read_bytes(path: Path, what: str, largest: int = MAX_TEXT_BYTES, *, follow: bool = True) -> bytes:
    """Return the content of a file of at most `largest` bytes; a larger one is refused before a byte of it is read.

    `what` says in messages what it should be: ``suite``. A link is refused unless told to `follow`.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is larger or cannot be read.
    """
    if not os.path.isfile(path):  # unlike `Path.is_file`, says no to a name that is too long
        raise NotFoundError(f"no {what} at {path}")
    try:
        with open_plain(path, follow=follow) as stream:
            size = os.fstat(stream.fileno()).st_size
            content = b"" if size > largest else stream.read(largest + 1)
    except OSError as error:
        raise FileFormatError(f"{path}: the {what} cannot be read: {error.strerror}") from error
    if max(size, len(content)) > largest:
        raise FileFormatError(f"{path}: has {max(size, len(content))} bytes, expected at most {largest} of a {what}")
    return content


SEAL = "sha256"
"""Name under which a JSON object holds the SHA-256 of the text that it stands in, its own digits taken as zeros."""
BLANK = "0" * 64


def sealed(content: bytes) -> bytes:
    """Return text with its first 64 zeros replaced by the SHA-256 of the text."""
    return content.replace(BLANK.encode(), hashlib.sha256(content).hexdigest().encode(), 1)


def unsealed(values: dict[str, Any], content: bytes, where: str) -> dict[str, Any]:
    """Return an object without its `SEAL`, after comparing that with the text that the object was read from.

    Where it has none, since 0.1.0 or another program wrote it, a note is logged once.

    Raises:
        FileFormatError: If the text is not what was written.
    """
    if SEAL not in values:
        if any(len(key) == len(SEAL) and sum(map(str.__ne__, key, SEAL)) == 1 for key in values):
            raise FileFormatError(f"{where}: damaged: its `{SEAL}` has another name")
        note_unsealed(where)
        return values
    told = values[SEAL]
    plain = content.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n")  # as an editor may have saved it
    if (
        not isinstance(told, str)
        or told != hashlib.sha256(plain.replace(told.encode(errors="replace"), BLANK.encode(), 1)).hexdigest()
    ):
        raise FileFormatError(
            f"{where}: damaged, or changed by hand: it does not fit its own `{SEAL}`; take that out to use it as it is"
        )
    return {key: value for key, value in values.items() if key != SEAL}


@functools.lru_cache(maxsize=1_000)
def note_unsealed(where: str) -> None:
    """Log, once for each file, that it has no SHA-256 that could be compared."""
    text = f"{where}: carries no SHA-256 of its content (release 0.1.0 wrote none); damage would not be noticed"
    logging.getLogger("creative_nao").warning("%s", CreativeNaoError(text))


def write_json(
    path: str | os.PathLike[str], values: Mapping[str, Any], indent: int | None = 2, private: bool = False
) -> Path:
    """Write an object as JSON without NaN, with its `SEAL`, as `replacing` does, and return the path."""
    text = json.dumps({SEAL: BLANK} | dict(values) | {SEAL: BLANK}, indent=indent, allow_nan=False)
    return write_bytes(path, sealed(f"{text}\n".encode()), private)


def read_json(path: Path, what: str, largest: int = MAX_TEXT_BYTES, where: str = "") -> Any:
    """Return what a file of `write_json` holds, or another JSON file; `where` begins messages, else `what` and path.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is too large, torn, not JSON, or not what was written.
    """
    content, where = read_bytes(path, what, largest), where or f"{what} {path}"
    values = as_json(as_text(content, where, what), where)
    return unsealed(values, content, where) if isinstance(values, dict) else values


def read_text(path: Path, what: str, largest: int = MAX_TEXT_BYTES) -> str:
    """Return UTF-8 text, with or without a byte order mark, of a file; errors as of `read_bytes` and `as_text`."""
    return as_text(read_bytes(path, what, largest), f"{path}", what)


def as_text(content: bytes, where: str, what: str) -> str:
    """Return bytes as text without its byte order mark; `where` begins the FileFormatError if it is not UTF-8."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        wide = content[:4].startswith((b"\xff\xfe", b"\xfe\xff", b"\0\0\xfe\xff"))
        hint = "perhaps UTF-16; " if wide else ""
        raise FileFormatError(
            f"{where}: byte {error.start} of the {what} is not UTF-8 text; {hint}save the file in UTF-8"
        ) from None


def as_json(text: str, where: str) -> Any:
    """Return what JSON text holds; `where` begins the message and names the file.

    Raises:
        FileFormatError: If it is torn, is nested more than `MAX_DEPTH` deep, says a name twice, or holds a number that
            is not finite or has more than `MAX_DIGITS` digits, or more than `MAX_JSON_GROUPS` lists and objects or
            `MAX_JSON_VALUES` values.
    """
    n_groups = text.count("{") + text.count("[")  # those in texts too: a bound that needs no parser
    if n_groups > MAX_JSON_GROUPS or text.count(",") > MAX_JSON_VALUES:
        raise FileFormatError(
            f"{where}: has {n_groups} lists and objects and {text.count(',')} commas, expected JSON of at most "
            f"{MAX_JSON_GROUPS} and {MAX_JSON_VALUES}"
        )
    try:
        found = json.loads(text, object_pairs_hook=_each_once)
        fault = json_fault(found)
    except RecursionError:
        found, fault = None, "it is nested too deeply"
    except ValueError as error:
        found, fault = None, str(error)
    if fault is not None:
        raise FileFormatError(f"{where}: not JSON ({fault})")
    return found


def json_fault(value: Any) -> str | None:
    """Return why a value is not JSON within the bounds (depth, digits, finite numbers, text as keys), else None."""
    level = [value]
    for depth in range(MAX_DEPTH + 1):
        inner: list[Any] = []
        for one in level:
            if isinstance(one, dict | list | tuple):
                if depth == MAX_DEPTH:
                    return "it is nested too deeply"
                inner += one.values() if isinstance(one, dict) else one
                if isinstance(one, dict) and not all(isinstance(key, str) for key in one):
                    return "it has a key that is no text"
            elif isinstance(one, float):
                if not math.isfinite(one):
                    return f"it holds {one}"
            elif type(one) is int:
                if abs(one) >= 10**MAX_DIGITS:
                    return f"it holds a whole number of more than {MAX_DIGITS} digits"
            elif not (one is None or isinstance(one, str | bool)):
                return f"it holds {type(one).__name__}"
        level = inner
    return None


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()  # counting each name would take hours in an object of millions
        again = next(name for name, _ in pairs if name in seen or seen.add(name))
        raise ValueError(f"it says `{again[:60]}` twice")
    return found


def as_yaml(text: str, where: str, most: int = MAX_YAML_VALUES) -> Any:
    """Return what YAML text holds, read by PyYAML's safe loader; numbers such as 1e-5 are numbers, unlike in YAML 1.1.

    `where` begins the message and names the file.

    Raises:
        FileFormatError: If it is torn, has more than `MAX_YAML_BYTES` characters or a tag that names code, is nested
            more than `MAX_DEPTH` deep, says a key twice, or unfolds to more than `most` values.
    """
    import yaml

    if len(text) > MAX_YAML_BYTES:
        raise FileFormatError(f"{where}: has {len(text)} characters, expected at most {MAX_YAML_BYTES} of YAML")
    try:
        depth = n_values = 0
        for event in yaml.parse(text, Loader=_yaml_loader()):
            n_values += isinstance(event, yaml.NodeEvent)
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH or n_values > most:
                fault = "it is nested too deeply" if depth > MAX_DEPTH else f"it holds more than {most} values"
                raise FileFormatError(f"{where}: not YAML ({fault})")
        loader = _yaml_loader()(text)
        node = loader.get_single_node()
        if node is not None and _unfolded(node, {}, where) > most:
            raise FileFormatError(f"{where}: its anchors and aliases unfold to more than {most} values")
        return None if node is None else loader.construct_document(node)
    except FileFormatError:
        raise
    except (yaml.YAMLError, RecursionError, ValueError, TypeError, OverflowError, AttributeError, LookupError) as error:
        raise FileFormatError(f"{where}: not YAML ({' '.join(str(error).split())})") from error


@functools.cache
def _yaml_loader() -> Any:
    import yaml

    loader = type("Loader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
    number = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+", re.ASCII)
    loader.add_implicit_resolver("tag:yaml.org,2002:float", number, list("-+.0123456789"))
    for tag in ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float"):
        loader.add_constructor(tag, functools.partial(_yaml_number, yaml.SafeLoader.yaml_constructors[tag]))
    return loader


def _yaml_number(construct: Callable[[Any, Any], Any], loader: Any, node: Any) -> Any:
    text = loader.construct_scalar(node)
    if len(text) > MAX_DIGITS or ":" in text:  # YAML 1.1 reads 1:30 as 90, in base 60
        raise ValueError(f"line {node.start_mark.line + 1}: `{text[:60]}` is no number of at most {MAX_DIGITS} digits")
    return construct(loader, node)


def _unfolded(node: Any, sizes: dict[int, float], where: str) -> float:
    """Return how many values a YAML node holds with its aliases written out; refuse a key that stands there twice."""
    if id(node) not in sizes:
        sizes[id(node)] = math.inf  # until it is known: one that holds itself is endless
        pairs = node.value if node.id == "mapping" else []
        keys: set[str] = set()
        for key in (key for key, _ in pairs if key.id == "scalar" and key.value != "<<"):
            if key.value in keys:
                line = key.start_mark.line + 1
                raise FileFormatError(f"{where}: line {line}: `{key.value[:60]}` is there already")
            keys.add(key.value)
        parts = [part for pair in pairs for part in pair] if pairs else node.value if node.id == "sequence" else []
        sizes[id(node)] = 1.0 + sum(_unfolded(part, sizes, where) for part in parts)
    return sizes[id(node)]
