"""Files are replaced whole or not at all, and what a killed writer left is told from what is being written."""

import errno
import multiprocessing
import os
import subprocess
import sys
import threading

import pytest

from creative_nao import storage

LEFT_BY_A_KILLED_WRITER = """
import os, signal, sys
from creative_nao import storage
with storage.replacing(sys.argv[1]) as temporary:
    temporary.write_text("half", encoding="utf-8")
    os.kill(os.getpid(), signal.SIGKILL)
"""
needs_locks = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no locks of this kind")


def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path):
    path = storage.write_text(tmp_path / "a.txt", "old")
    with pytest.raises(ZeroDivisionError), storage.replacing(path) as temporary:
        temporary.write_text(f"half {1 // 0}", encoding="utf-8")

    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_names_the_file_that_was_wanted(tmp_path):
    with pytest.raises(OSError, match="No space left") as caught, storage.replacing(tmp_path / "a.txt"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    assert caught.value.filename == str(tmp_path / "a.txt")


def test_an_error_of_ours_keeps_its_text(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"^only text$"), storage.replacing(tmp_path / "a.txt"):
        raise FileNotFoundError("only text")


def test_files_are_readable_like_all_others_of_the_user(tmp_path):
    (tmp_path / "plain").touch()

    assert storage.write_bytes(tmp_path / "a", b"").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_name_as_long_as_the_system_allows_is_written(tmp_path):
    path = storage.write_text(tmp_path / ("n" * 251 + ".txt"), "whole")

    assert path.read_text(encoding="utf-8") == "whole"


@needs_locks
def test_the_next_writer_removes_what_a_killed_one_left(tmp_path):
    subprocess.run([sys.executable, "-c", LEFT_BY_A_KILLED_WRITER, str(tmp_path / "a.txt")], check=False)
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(".a.txt.writing-")
    storage.write_text(tmp_path / "other.txt", "whole")

    assert [path.name for path in tmp_path.iterdir()] == ["other.txt"]


@needs_locks
def test_what_is_being_written_is_left_alone_and_so_is_another_machine_s(tmp_path):
    foreign = tmp_path / ".b.txt.writing-00000000-12345678.txt"
    foreign.touch()
    with storage.replacing(tmp_path / "a.txt") as temporary:
        temporary.write_text("whole", encoding="utf-8")
        storage.sweep(tmp_path)
        assert temporary.exists()

    assert {path.name for path in tmp_path.iterdir()} == {"a.txt", foreign.name}


@needs_locks
def test_one_writer_at_a_time_is_alone_in_a_folder(tmp_path):
    order = []

    def wait():
        with storage.alone(tmp_path):
            order.append("second")

    with storage.alone(tmp_path):
        other = threading.Thread(target=wait)
        other.start()
        other.join(0.2)
        order.append("first")
    other.join(10)

    assert order == ["first", "second"]


def write_often(path, text):
    for _ in range(60):
        storage.write_text(path, text)


def test_writers_and_sweepers_in_a_crowd_never_tear_or_lose_a_file(tmp_path):
    path = tmp_path / "a.txt"
    texts = [letter * 10_000 for letter in "abc"]
    crowd = [multiprocessing.get_context("spawn").Process(target=write_often, args=(path, text)) for text in texts]
    for one in crowd:
        one.start()
    for one in crowd:
        one.join(120)

    assert [one.exitcode for one in crowd] == [0, 0, 0]
    assert path.read_text(encoding="utf-8") in texts
    assert list(tmp_path.iterdir()) == [path]
