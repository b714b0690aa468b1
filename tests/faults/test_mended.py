"""What strikes found and was mended, each in the small."""

import errno
import os

import pytest

from creative_nao import storage
from creative_nao.demonstrations import files, save_demonstrations
from creative_nao.errors import NotFoundError
from creative_nao.evaluation import job_handlers as worker
from creative_nao.evaluation.job_handlers import HANDLERS
from creative_nao.evaluation.jobs import Job, write_spec
from creative_nao.evaluation.run import open_folder
from creative_nao.explorer.favourites import Favourite, Session
from creative_nao.model import NetworkSettings, TrainingSettings, checkpoint_of, train_many


def test_a_worker_tells_of_a_full_disk_as_of_a_user_s_mistake(tmp_path, monkeypatch, capsys):
    def fill(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "maps/half-0.npz")

    monkeypatch.setitem(HANDLERS, "chart", fill)
    spec = write_spec(Job("chart", "chart", "chart", {}), tmp_path)

    assert worker.main([str(spec), str(tmp_path)]) == 2
    assert capsys.readouterr().err == "maps/half-0.npz: No space left on device\n"


def test_a_folder_without_record_is_not_recommended_in_circles(tmp_path):
    (tmp_path / "mine.txt").touch()
    with pytest.raises(NotFoundError, match=r"it has no run.json; choose another folder"):
        open_folder(tmp_path, {"suite": {"name": "quick"}}, resume=True)


def test_two_explorers_of_one_file_lose_no_favourite(tmp_path):
    one, other = Session(tmp_path / "s.json"), Session(tmp_path / "s.json")
    kept = [Favourite("a" * 24, ((x, 0.0),)) for x in (0.1, 0.2, 0.3)]
    for session, favourite in zip((one, other, one), kept, strict=True):
        session.add(favourite)
    other.remove(kept[0])

    assert Session(tmp_path / "s.json").favourites("a" * 24) == kept[1:]


def test_favourites_outlive_their_file(tmp_path):
    session = Session(tmp_path / "s.json")
    kept = [Favourite("a" * 24, ((x, 0.0),)) for x in (0.1, 0.2)]
    session.add(kept[0])
    (tmp_path / "s.json").unlink()
    session.add(kept[1])

    assert Session(tmp_path / "s.json").favourites("a" * 24) == kept


def test_actions_that_vanish_while_others_are_written_are_missed(tmp_path, waves, monkeypatch):
    def vanishing(path, *rest):
        (tmp_path / "first.csv").unlink(missing_ok=True)
        return storage.write_text(path, "")

    monkeypatch.setattr(files, "save_trajectory", vanishing)
    with pytest.raises(NotFoundError, match=r"first.csv vanished while the others were written; write them again"):
        save_demonstrations(tmp_path, waves)


def test_a_memory_that_is_ready_needs_its_checkpoint_no_more(tmp_path, waves):
    path, wanted = tmp_path / "m", [TrainingSettings(n_epochs=2)]
    small = NetworkSettings(layer_sizes=(3,), time_constants=(2.0,), n_softmax_units=3)
    train_many(waves, wanted, small, out=lambda _: path)
    checkpoint_of(path).write_bytes(b"of a run killed between the two")
    (again,) = train_many(waves, wanted, small, out=lambda _: path, resume=True)

    assert again.memory is not None
    assert not checkpoint_of(path).exists()
