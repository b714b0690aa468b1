"""Write a file so that a reader sees the old content or the new one, never a torn one.

The new content goes into a temporary file beside the old one, which it then replaces. Its writer holds a lock on the
temporary file for as long as it lives; what a killed writer left behind is therefore told from what is being written,
and swept away by the next writer in that folder.
"""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import secrets
import zlib
from collections.abc import Iterator
from pathlib import Path

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
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; when the block ends well, it takes the place of `path` in one step.

    When the block raises, the temporary file is removed and `path` stays as it was. Missing folders are made.

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
        lock = _create(temporary)
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


def write_bytes(path: str | os.PathLike[str], content: bytes) -> Path:
    """Replace the content of `path` by `content` in one step and return the path."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return Path(path)


def write_text(path: str | os.PathLike[str], content: str) -> Path:
    """Replace the content of `path` by `content` (UTF-8) in one step and return the path."""
    return write_bytes(path, content.encode("utf-8"))


def sweep(folder: str | os.PathLike[str]) -> None:
    """Remove the temporary files in a folder whose writers on this machine are gone; leave those being written."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith(".") and f"{_MARK}{_MACHINE}-" in entry.name:
                _remove_if_abandoned(entry.path)


@contextlib.contextmanager
def alone(folder: str | os.PathLike[str]) -> Iterator[None]:
    """While inside, other processes of this machine that ask for the same folder wait: to read a file and replace it.

    Where the system has no locks on folders, nobody waits. The folder is made if it is missing.
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # some network file systems have none
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _create(temporary: Path) -> int:
    """Make the file and return a handle that holds its lock; -1 where there are no locks."""
    while True:
        handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        if fcntl is None:
            os.close(handle)
            return -1
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        if os.fstat(handle).st_nlink:
            return handle
        os.close(handle)  # swept away between its creation and its lock


def _remove_if_abandoned(path: str) -> None:
    assert fcntl is not None
    with contextlib.suppress(OSError):
        handle = os.open(path, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.unlink(path)
        finally:
            os.close(handle)
