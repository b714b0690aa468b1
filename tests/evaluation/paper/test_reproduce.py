"""A whole reproduction with tiny networks: what it writes, that it repeats, continues, refuses and is told truly."""

import csv
import dataclasses
import json
import shutil
import threading

import pytest
from publish_results import publish_paper

from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.evaluation.paper import run as run_module
from creative_nao.evaluation.paper.bank import PaperSettings, paper_settings, shipped_bank, train_bank
from creative_nao.evaluation.paper.claims import TABLE_I
from creative_nao.evaluation.paper.page import make_page, mean_cell, read_content
from creative_nao.evaluation.paper.run import reproduce
from creative_nao.model import NetworkSettings, shipped_memories

TINY = PaperSettings("quick", n_seeds=2, n_epochs=60, resolution=12, network=NetworkSettings(layer_sizes=(12, 6, 3)))
RESULTS = ("results.json", "claims.json", "networks.csv", "figures.json")


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory):
    """A finished run by two workers, made once."""
    folder = tmp_path_factory.mktemp("paper") / "run"
    return reproduce(TINY, folder, n_workers=2, command="creative-nao evaluate paper --quick")


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out the drawing, most of the time of a tiny run."""

    def save(drawn, path):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"not drawn")
        return path

    monkeypatch.setattr("creative_nao.evaluation.paper.figures.save", save)


def strict(path):
    found = json.loads(path.read_text(encoding="utf-8"), parse_constant=lambda name: pytest.fail(f"{name} in {path}"))
    assert len(found.pop("sha256")) == 64
    return found


def contents(folder):
    return {name: (folder / name).read_bytes() for name in RESULTS}


def test_results_follow_the_schema(reproduced):
    found = strict(reproduced.folder / "results.json")
    assert found == reproduced.results
    assert found["suite"] == "paper"
    assert [(row["memory"], row["closed_loop_ratio"]) for row in found["rows"]] == [
        ("open", 0.0), ("half", 0.5), ("closed", 1.0),
    ]  # fmt: skip
    for row in found["rows"]:
        assert (row["agent"], row["env"], row["n_seeds"], row["n_actions"]) == ("supervised", "grid", 2, 144)
        for field in ("unlearned_pct", "learned_pct", "appropriateness_pct", "fluctuating_pct", "non_moving_pct"):
            assert row[field]["low"] <= row[field]["mean"] <= row[field]["high"]
        for field in ("novelty", "diversity", "reward", "oracle_share"):
            assert row[field] is not None or row[f"{field}_reason"]


def test_means_are_those_of_the_networks(reproduced):
    with open(reproduced.folder / "networks.csv", encoding="utf-8") as stream:
        networks = list(csv.DictReader(stream))
    assert [one["name"] for one in networks] == [f"{c}/{s}" for c in ("open", "half", "closed") for s in (0, 1)]
    for row in reproduced.results["rows"]:
        mine = [float(one["appropriateness_pct"]) for one in networks if one["condition"] == row["memory"]]
        assert row["appropriateness_pct"]["mean"] == pytest.approx(sum(mine) / 2)
        assert row["spread"]["appropriateness_pct"] == {"smallest": min(mine), "largest": max(mine)}


def test_one_worker_gives_the_same_bytes_as_two(reproduced, tmp_path, undrawn):
    reproduce(TINY, tmp_path / "alone", n_workers=1, command="creative-nao evaluate paper --quick")
    assert contents(tmp_path / "alone") == contents(reproduced.folder)


def test_a_finished_run_is_continued_without_doing_anything_twice(reproduced, tmp_path, monkeypatch, undrawn):
    monkeypatch.setattr("creative_nao.evaluation.paper.summary.pb_map", lambda *_: pytest.fail("measured again"))
    monkeypatch.setattr("creative_nao.model.training.train_network", lambda *_, **__: pytest.fail("trained again"))
    folder = shutil.copytree(reproduced.folder, tmp_path / "run")
    for name in RESULTS:
        (folder / name).unlink()
    reproduce(TINY, folder, resume=True, n_workers=1, command="creative-nao evaluate paper --quick")
    assert contents(folder) == contents(reproduced.folder)


def test_an_interrupted_run_ends_with_the_same_bytes(reproduced, tmp_path, monkeypatch, undrawn):
    folder = tmp_path / "run"
    done = []

    def interrupted(entry, *rest):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(entry.name)
        return original(entry, *rest)

    original = run_module.measure_entry
    with monkeypatch.context() as patch:
        patch.setattr(run_module, "measure_entry", interrupted)
        with pytest.raises(KeyboardInterrupt):
            reproduce(TINY, folder, n_workers=1, command="creative-nao evaluate paper --quick")
    assert not (folder / "results.json").exists()
    reproduce(TINY, folder, n_workers=1, resume=True, command="creative-nao evaluate paper --quick")
    assert contents(folder) == contents(reproduced.folder)


def test_training_that_is_stopped_goes_on_from_its_checkpoints(reproduced, tmp_path):
    longer = dataclasses.replace(TINY, n_seeds=1, n_epochs=300)
    stop = threading.Event()
    with pytest.raises(KeyboardInterrupt):
        train_bank(tmp_path / "a", longer, n_workers=1, stop=stop, report=lambda *_: stop.set())
    assert list((tmp_path / "a" / "memories").glob("*.checkpoint"))
    one, _ = train_bank(tmp_path / "a", longer, n_workers=1)
    other, _ = train_bank(tmp_path / "b", longer, n_workers=2)
    assert [entry.load().best_loss for entry in one] == [entry.load().best_loss for entry in other]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"seed": 1}, "was started with seed 0, not 1"),
        ({"resolution": 13}, "was started with resolution 12, not 13"),
        ({"source": "retrain"}, "was started with source quick, not retrain"),
    ],
)
def test_another_run_is_not_continued(reproduced, changes, text):
    with pytest.raises(SettingsError, match=text):
        reproduce(dataclasses.replace(TINY, **changes), reproduced.folder, resume=True)


def test_networks_that_changed_are_not_mixed(reproduced, tmp_path):
    record = strict(reproduced.folder / "run.json")
    record["memories"]["half/0"] = "0" * 64
    (tmp_path / "run.json").write_text(json.dumps(record))
    with pytest.raises(SettingsError, match="started with other networks"):
        reproduce(TINY, tmp_path, resume=True)


def test_a_folder_with_something_in_it_is_refused(tmp_path):
    (tmp_path / "mine.txt").touch()
    with pytest.raises(SettingsError, match="exists and is not empty"):
        reproduce(TINY, tmp_path)


def test_there_has_to_be_something_to_resume(tmp_path):
    with pytest.raises(NotFoundError, match="nothing to resume"):
        reproduce(TINY, tmp_path / "none", resume=True)


def test_the_page_follows_from_the_files_alone(reproduced):
    page = make_page(read_content(reproduced.folder))
    assert page == (reproduced.folder / "reproduction.md").read_text(encoding="utf-8")
    assert "This is a quick look" in page
    for row in reproduced.results["rows"]:
        for field in ("unlearned_pct", "learned_pct", "appropriateness_pct", "novelty", "diversity"):
            assert f"| {mean_cell(row[field])}<br>" in page
    for measure in TABLE_I:
        assert all(f"{value:.2f}" in page for value in measure.paper.values())


def test_the_report_shows_every_picture_of_the_page(reproduced):
    page = (reproduced.folder / "reproduction.md").read_text(encoding="utf-8")
    report = (reproduced.folder / "report.html").read_text(encoding="utf-8")
    pictures = sorted((reproduced.folder / "images").glob("*.png"))
    assert len(pictures) == 7
    assert all(f"(images/{picture.name})" in page and picture.with_suffix(".svg").is_file() for picture in pictures)
    assert report.count("data:image/png;base64,") == len(pictures)
    assert "src=" not in report.replace('src="data:', "")


def test_publishing_brings_page_pictures_and_results(reproduced, tmp_path):
    publish_paper(reproduced.folder, tmp_path)
    page = (tmp_path / "reproduction.md").read_text(encoding="utf-8")
    assert "(results/paper/results.json)" in page
    assert (tmp_path / "results/paper/results.json").read_bytes() == (reproduced.folder / "results.json").read_bytes()
    assert "hashes" not in strict(tmp_path / "results/paper/run.json")
    assert len(list((tmp_path / "images").glob("paper_*.png"))) == 7
    with pytest.raises(SettingsError, match="--docs should name the folder"):
        publish_paper(reproduced.folder, tmp_path / "none")


def test_the_record_names_every_network_and_the_hash_of_every_result(reproduced):
    record = strict(reproduced.folder / "run.json")
    assert len(record["memories"]) == 6
    assert {"results.json", "claims.json", "report.html", "reproduction.md"} <= set(record["hashes"])
    assert not any(str(reproduced.folder) in text for text in (json.dumps(record), json.dumps(reproduced.claims)))


def test_the_shipped_bank_is_taken_as_it_is():
    assert tuple(entry.name for entry in shipped_bank()) == shipped_memories()
    assert shipped_bank()[0].load().name == shipped_memories()[0]


def test_quick_and_retrain_exclude_each_other():
    assert (paper_settings(quick=True).n_seeds, paper_settings(retrain=True).n_epochs) == (3, 100_000)
    with pytest.raises(SettingsError, match="--quick trains its own few networks"):
        paper_settings(quick=True, retrain=True)
