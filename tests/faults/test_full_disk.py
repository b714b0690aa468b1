"""Work that finds no place to write, or another run in it, tears no file. Killed work: docs/reliability.md."""

import resource
import subprocess
import sys

import pytest


def creative_nao(words, folder, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "creative_nao", *words],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


def finish(words, folder, **options):
    process = creative_nao(words, folder, **options)
    _, complaint = process.communicate(timeout=240)
    return process.returncode, complaint


def disk_of(n_bytes):
    """Return what makes a process unable to write more than `n_bytes` into a file, as on a full disk."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, n_bytes))


WRITERS = {
    "map": ["map", "half/0", "--resolution", "12", "--out", "out.npz"],
    "export": ["export", "half/0", "--pb", "0.3", "-0.1", "--out", "out.csv"],
    "teach": ["teach", "--out", "."],
    "train": ["train", "--n-epochs", "20", "--network.layer-sizes", "12", "6", "3", "--out", "out.safetensors"],
}
KEPT = {"map": "out.npz", "export": "out.csv", "teach": "left_jab.csv", "train": "out.safetensors"}


@pytest.mark.parametrize(
    "command", ["train", *(pytest.param(name, marks=pytest.mark.slow) for name in ("map", "export", "teach"))]
)
def test_a_full_disk_is_one_line_and_leaves_the_old_file(command, tmp_path):
    kept = tmp_path / KEPT[command]
    kept.write_text("what stood there before", encoding="utf-8")
    code, complaint = finish(WRITERS[command], tmp_path, preexec_fn=disk_of(600))

    assert code == 2, complaint
    assert complaint.count("\n") == 1
    assert "File too large" in complaint
    assert kept.read_text(encoding="utf-8") == "what stood there before"
    assert [path.name for path in tmp_path.iterdir()] == [kept.name]


@pytest.mark.parametrize("command", ["export", pytest.param("map", marks=pytest.mark.slow)])
def test_a_place_where_nothing_can_be_written_is_one_line(command, tmp_path):
    words = [*WRITERS[command][:-1], f"/proc/{KEPT[command]}"]  # no one, not even root, makes a file there
    code, complaint = finish(words, tmp_path)

    assert code == 2, complaint
    assert complaint.count("\n") == 1
    assert "/proc/" in complaint


@pytest.mark.slow
def test_two_runs_on_one_folder_leave_whole_files_of_equal_content(tmp_path):
    both = [creative_nao(WRITERS["teach"], tmp_path) for _ in range(2)]
    assert [process.communicate(timeout=240) and process.returncode for process in both] == [0, 0]
    first = {path.name: path.read_bytes() for path in tmp_path.glob("*.csv")}
    assert finish(WRITERS["teach"], tmp_path)[0] == 0

    assert len(first) == 6
    assert first == {path.name: path.read_bytes() for path in tmp_path.glob("*.csv")}
