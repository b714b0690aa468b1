"""Pipes, devices, sockets and links in the place of files: nothing waits for them, nothing is written through them."""

import json
import os
import shutil
import signal
import socket
import time

import pytest
from victims import ENV

from creative_nao import storage
from creative_nao.agents import tuning
from creative_nao.cli import main
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.evaluation.run import input_hashes, only_plain_files
from creative_nao.evaluation.runner import LocalExecutor, _LocalQueue
from creative_nao.evaluation.suites import suite_from_values
from creative_nao.runtime import sha256

LONGEST_S = 20


@pytest.fixture(autouse=True)
def no_waiting():
    """End a test that waits for a pipe."""

    def late(*_):
        raise TimeoutError("it waits")

    signal.signal(signal.SIGALRM, late)
    signal.alarm(LONGEST_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)


def unix_socket(path):
    here = os.getcwd()
    os.chdir(path.parent)  # the name of a socket is short
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(path.name)
    os.chdir(here)


SPECIAL = {
    "a pipe": os.mkfifo,
    "a socket": unix_socket,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    "a link": lambda path: path.symlink_to(path.with_name("elsewhere")),
}


@pytest.mark.parametrize("what", SPECIAL)
def test_what_is_no_plain_file_is_neither_read_nor_written(what, tmp_path, attempt):
    attempt("what opens files", f"{what} in the place of a file", "an error at once; nothing is written through it", 4)
    SPECIAL[what](path := tmp_path / "file")
    with pytest.raises((FileFormatError, NotFoundError), match=str(path)):
        storage.read_bytes(path, "suite", follow=False)
    with pytest.raises((FileFormatError, NotFoundError), match=str(path)):
        sha256(path)
    with pytest.raises(OSError, match="file"):
        storage.read_end(path, 100)
    with pytest.raises(OSError, match="file"):
        storage.open_plain(path, "ab", follow=False)
    assert not (tmp_path / "elsewhere").exists()
    storage.write_text(path, "whole")  # takes its place
    assert storage.read_text(path, "text") == "whole"
    assert not path.is_symlink()


@pytest.mark.parametrize("what", SPECIAL)
def test_a_leftover_of_a_writer_is_not_waited_for(what, tmp_path, attempt):
    attempt("what opens files", f"{what} named like a leftover of a killed writer", "left where it is")
    name = tmp_path / f".x{storage._MARK}{storage._MACHINE}-0"
    SPECIAL[what](name)
    storage.write_text(tmp_path / "x", "new")
    assert name.is_symlink() or name.exists()


@pytest.mark.parametrize("what", SPECIAL)
@pytest.mark.parametrize("place", ["jobs/play.log", "jobs/play.progress", ".a.writing-0", "maps/half-0.npz"])
def test_a_run_folder_with_more_than_files_is_not_continued(what, place, tmp_path, attempt):
    attempt("evaluate --resume", f"{what} inside the run folder", "refused by its name")
    (tmp_path / place).parent.mkdir(exist_ok=True)
    only_plain_files(tmp_path)
    SPECIAL[what](tmp_path / place)
    with pytest.raises(SettingsError, match=f"{place} is (a link|no plain file): a run that is continued"):
        only_plain_files(tmp_path)


@pytest.mark.parametrize("what", SPECIAL)
def test_the_demonstrations_of_a_suite_are_plain_files(what, tmp_path, attempt):
    attempt("a suite", f"{what} in its folder of demonstrations", "refused by its name")
    SPECIAL[what](tmp_path / "a.csv")
    taught = {"seeds": [1], "demonstrations": str(tmp_path)}
    suite = suite_from_values({"name": "s", "agents": ["random"], "envs": [ENV], "taught": taught}, where="s")
    with pytest.raises((FileFormatError, NotFoundError), match=r"a\.csv"):
        input_hashes(suite)


class Work:
    """Stands for a job: all that the queue asks of one here is where its files are."""

    name = "play"
    seconds = 1.0

    def file(self, folder, suffix):
        return folder / f"play{suffix}"


def test_only_the_end_of_a_log_is_read(tmp_path, attempt):
    attempt("evaluate", "a log and a progress file of 20 GB", "only the end is read", 2)
    queue = _LocalQueue((), tmp_path, lambda _: None, LocalExecutor(1))
    queue.started["play"] = time.monotonic()
    for suffix in (".log", ".progress"):
        with Work().file(tmp_path, suffix).open("wb") as stream:
            stream.truncate(20_000_000_000)
            stream.seek(0, 2)
            stream.write(b"\nthe last line \xff\n")
    assert queue._last_line(Work()).startswith("the last line \N{REPLACEMENT CHARACTER} (log: ")
    assert 0.0 <= queue.share(Work()) <= 0.9
    Work().file(tmp_path, ".progress").write_text("7.5")
    assert queue.share(Work()) == 1.0
    Work().file(tmp_path, ".log").unlink()
    os.mkfifo(Work().file(tmp_path, ".log"))
    assert queue._last_line(Work()).startswith("it could say nothing")


PLAN = tuning.TuningPlan("ppo", ENV, n_trials=2, n_timesteps=64)


def _stand_in(trial, plan, start, first):
    return float(tuning.suggest(trial, start).noise_std is None)


@pytest.fixture(scope="module")
def journal(tmp_path_factory):
    """A study of two trials, whose trainings are left out."""
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuning, "_reward", _stand_in)
        tuning.tune(PLAN, folder)
    return folder / "study.journal"


def test_a_study_goes_on_from_its_journal_without_a_torn_last_line(journal, tmp_path):
    shutil.copy(journal, tmp_path)
    with (tmp_path / "study.journal").open("ab") as stream:
        stream.write(b'{"op_code": 4, "torn')
    assert tuning.tune(PLAN, tmp_path, resume=True).n_trials == 2
    assert b'"torn' not in (tmp_path / "study.journal").read_bytes()


@pytest.mark.parametrize("what", SPECIAL)
def test_a_study_is_not_read_or_written_through(what, journal, tmp_path, attempt):
    attempt("agent tune --resume", f"{what} as study.journal", "refused by its name; nothing is written through it")
    SPECIAL[what](tmp_path / "study.journal")
    with pytest.raises((FileFormatError, NotFoundError), match=r"study\.journal"):
        tuning.tune(PLAN, tmp_path, resume=True)
    with pytest.raises(SettingsError, match="left from an earlier search"):
        tuning.tune(PLAN, tmp_path)
    assert not (tmp_path / "elsewhere").exists()


def test_a_link_to_a_good_study_is_not_followed(journal, tmp_path):
    before = journal.read_bytes()
    (tmp_path / "study.journal").symlink_to(journal)
    with pytest.raises(FileFormatError, match=r"study\.journal: the journal of a study cannot be read"):
        tuning.tune(PLAN, tmp_path, resume=True)
    assert journal.read_bytes() == before


def with_distribution(line, text):
    return {**line, "distribution": text} if "distribution" in line else line


JOURNALS = {
    "text": lambda lines: ["time for tea"],
    "lists": lambda lines: [[1]],
    "no operation": lambda lines: [{"a": 1}],
    "an unknown operation": lambda lines: [{"op_code": 10**30}],
    "operations without their values": lambda lines: [{"op_code": place} for place in range(10)],
    "depth": lambda lines: ["[" * 100_000],
    "a trial of nothing": lambda lines: [*lines, {"op_code": 4, "worker_id": "x", "study_id": 0}],
    "too many lines": lambda lines: [{"op_code": 5}] * 60_000,
    "a number that is not finite": lambda lines: [json.dumps(lines[0])[:-1] + ', "a": NaN}'],
    "settings that are a list": lambda lines: [
        {**one, "user_attr": {"about": [1]}} if "about" in one.get("user_attr", ()) else one for one in lines
    ],
    "parameters out of their range": lambda lines: [
        {**one, "param_value_internal": 1e9} if one.get("param_name") == "learning_rate" else one for one in lines
    ],
    "an unknown distribution": lambda lines: [
        with_distribution(one, '{"name": "os.system", "attributes": {"command": "touch ran"}}') for one in lines
    ],
}


@pytest.mark.parametrize("name", JOURNALS)
def test_a_journal_that_is_no_study_of_ours_is_named(name, journal, tmp_path, attempt):
    attempt("agent tune --resume", "a study.journal of another kind", "refused by its name")
    lines = JOURNALS[name]([json.loads(line) for line in journal.read_text().splitlines()])
    text = "".join(f"{line if isinstance(line, str) else json.dumps(line)}\n" for line in lines)
    (tmp_path / "study.journal").write_text(text)
    with pytest.raises((FileFormatError, SettingsError), match=r"study\.journal"):
        tuning.tune(PLAN, tmp_path, resume=True)
    assert not (tmp_path / "ran").exists()


def test_the_command_ends_in_one_line(tmp_path, capsys):
    os.mkfifo(tmp_path / "study.journal")
    words = ["agent", "tune", "ppo", "--trials", "1", "--out", str(tmp_path), "--resume"]
    assert main(words) == 2
    assert "no journal of a study at" in capsys.readouterr().err
