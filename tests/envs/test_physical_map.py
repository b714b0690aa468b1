"""The physical map is what the environment would say, point by point, and survives being killed."""

import dataclasses
import json
from contextlib import closing

import numpy as np
import pytest

from creative_nao.cli import main
from creative_nao.envs import BoxingEnv
from creative_nao.envs import physical_map as module
from creative_nao.envs.executors import PhysicsPool, SharedScene, ThreadPool
from creative_nao.envs.physical_map import FIGURES, PhysicalMap, physical_map
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.maps import pb_map
from creative_nao.measures import Criteria
from creative_nao.model import NetworkSettings, TrainingSettings, load_memory, train_network
from creative_nao.robot import Performer, PhysicalLimits

ARRAYS = ("pb", "outcome", "mental", "fault", "nearest", "distance", "learned_pb")


@pytest.fixture(scope="module")
def memory():
    return load_memory("half/0")


@pytest.fixture(scope="module")
def chart(memory):
    return physical_map(memory, 4, n_threads=2)


def equal(one, other):
    same = all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ARRAYS)
    return same and all(np.array_equal(one.figures[name], other.figures[name]) for name in FIGURES)


def test_robots_side_by_side_perform_bit_for_bit_like_one_alone_in_the_whole_scene(memory):
    trajectories = memory.generate(np.random.default_rng(4).uniform(-1, 1, (6, 2)))
    alone = Performer()
    with closing(ThreadPool(2)) as threads:
        found = PhysicsPool(threads, SharedScene(bare=True)).perform(trajectories, [memory.dt_s] * 6)
        for trajectory, (done, _) in zip(trajectories, found, strict=True):
            expected = alone.perform(trajectory, memory.dt_s)
            for field in dataclasses.fields(expected):
                assert np.array_equal(getattr(done, field.name), getattr(expected, field.name)), field.name


def test_every_point_is_what_the_environment_says_of_it(chart, memory):
    env = BoxingEnv(memory)
    env.reset()
    for row, pb in enumerate(chart.pb):
        info = env.step(pb)[4]
        assert info["outcome"] == chart.outcome[row]
        assert info["nearest"] == chart.nearest[row]
        assert np.float32(info["distance"]) == chart.distance[row]
        for name in set(FIGURES) - {"limit_excess"}:
            assert np.float32(info[name]) == chart.figures[name][row], name


def test_it_tells_beside_what_the_mind_says(chart, memory):
    assert np.array_equal(chart.mental, pb_map(memory, 4).outcome)


def test_stricter_criteria_and_limits_reach_every_point(memory, chart):
    strict = physical_map(memory, 2, limits=PhysicalLimits(tracking_error_rad=0.0), n_threads=1)
    assert set(strict.outcome) <= {"fluctuating", "tracking_error"}
    assert set(strict.fault) == {"tracking_error"}
    still = physical_map(memory, 2, criteria=Criteria(speed_factor=0.0), n_threads=1)
    assert set(still.outcome) == {"fluctuating"}
    assert set(chart.outcome) & {"learned", "unlearned"}


def test_a_killed_run_goes_on_to_the_same_bits(chart, memory, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "BLOCK", 5)
    path = tmp_path / "map.part.npz"
    seen = []

    def dies_after_two_blocks(done, total):
        seen.append((done, total))
        if done >= 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        physical_map(memory, 4, progress=dies_after_two_blocks, checkpoint=path)
    assert seen == [(0, 16), (5, 16), (10, 16)]
    with pytest.raises(FileFormatError, match="10 of 16 points are performed; finish it with"):
        PhysicalMap.load(path)
    went_on = []
    finished = physical_map(memory, 4, progress=lambda done, _: went_on.append(done), checkpoint=path)

    assert went_on == [10, 15, 16]
    assert equal(finished, chart)
    assert equal(PhysicalMap.load(path), chart)


@pytest.mark.parametrize("change", [{"resolution": 3}, {"criteria": Criteria(learned_threshold=5.0)}])
def test_a_checkpoint_of_other_settings_is_refused(memory, tmp_path, change):
    path = tmp_path / "map.part.npz"
    physical_map(memory, 2, checkpoint=path)
    with pytest.raises(SettingsError, match=f"was begun with {next(iter(change))} ="):
        physical_map(memory, **{"resolution": 2, **change}, checkpoint=path)


def test_a_checkpoint_of_another_memory_of_the_same_name_is_refused(memory, tmp_path):
    path = tmp_path / "map.part.npz"
    physical_map(memory, 2, checkpoint=path)
    parameters = {name: array + (name == "rho") for name, array in memory.parameters.items()}
    with pytest.raises(SettingsError, match="was begun with sha256 ="):
        physical_map(dataclasses.replace(memory, parameters=parameters), 2, checkpoint=path)


def test_a_saved_map_comes_back(chart, tmp_path):
    back = PhysicalMap.load(chart.save(tmp_path / "map.npz"))

    assert equal(back, chart)
    assert back.summary() == chart.summary()
    assert back.record == chart.record


@pytest.mark.parametrize("name", ["map.safetensors", "map", "map.NPZ"])
def test_a_physical_map_is_written_to_an_npz_file_only(chart, memory, tmp_path, name, capsys):
    with pytest.raises(SettingsError, match=r"`path` should end in \.npz, the format of physical maps, but is"):
        chart.save(tmp_path / name)
    with pytest.raises(SettingsError, match=r"`checkpoint` should end in \.npz"):
        physical_map(memory, 2, checkpoint=tmp_path / name)
    assert main(["map", "half/0", "--physical", "--out", str(tmp_path / name)]) == 2
    assert "--out should end in .npz, but is" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("path", [3, None, b"map.npz"])
def test_what_is_no_path_is_refused(chart, memory, path):
    mental = pb_map(memory, 3)
    for use in (chart.save, mental.save, PhysicalMap.load, type(mental).load):
        with pytest.raises(SettingsError, match="`path` should be text, but is"):
            use(path)
    if path is not None:
        for drawn in (chart, mental):
            with pytest.raises(SettingsError, match="`path` should be text, but is"):
                drawn.plot(path)


def test_a_torn_map_is_refused_wherever_it_is_cut(chart, tmp_path):
    content = chart.save(tmp_path / "map.npz").read_bytes()
    path = tmp_path / "torn.npz"
    for length in range(0, len(content), 311):
        path.write_bytes(content[:length])
        with pytest.raises(FileFormatError, match=r"torn\.npz"):
            PhysicalMap.load(path)


def test_a_mental_map_is_no_physical_one(memory, tmp_path):
    with pytest.raises(FileFormatError, match="not a physical PB map"):
        PhysicalMap.load(pb_map(memory, 3).save(tmp_path / "map.npz"))
    with pytest.raises(NotFoundError, match="creative-nao map MEMORY --physical --out"):
        PhysicalMap.load(tmp_path / "none.npz")


def test_the_summary_counts_what_the_body_refuses_of_what_the_mind_allows(chart):
    faulty = dataclasses.replace(chart, outcome=chart.outcome.copy(), fault=chart.fault.copy())
    allowed = np.flatnonzero(chart.mentally_appropriate & chart.appropriate)
    faulty.outcome[allowed[0]] = faulty.fault[allowed[0]] = "fell"
    n = int(chart.mentally_appropriate.sum())

    before, after = chart.summary(), faulty.summary()
    assert after["physical_of_mental_pct"] == pytest.approx(before["physical_of_mental_pct"] - 100 / n)
    assert after["refused_of_mental_pct"]["fell"] == pytest.approx(100 / n)
    assert after["fell_pct"] == pytest.approx(100 / 16)
    assert sum(after[f"{name}_pct"] for name in ("learned", "unlearned", "fluctuating", "fell")) <= 100


def test_the_picture_names_what_only_a_body_adds(chart, tmp_path):
    refused = dataclasses.replace(chart, outcome=chart.outcome.copy())
    refused.outcome[0] = "self_collision"
    figure = refused.plot(tmp_path / "map.png")
    labels = [text.get_text() for legend in figure.legends for text in legend.get_texts()]

    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert any(label.startswith("self-collision  (6.2 %)") for label in labels)
    assert not any(label.startswith("fell") for label in labels)


def test_other_joints_or_units_are_refused(waves):
    settings = NetworkSettings(layer_sizes=(4, 3), time_constants=(2, 4))
    with pytest.raises(
        SettingsError, match="a physical map needs a memory with n_pb = 2 and the joints RShoulderPitch"
    ):
        physical_map(train_network(waves, TrainingSettings(n_epochs=1), settings), 2)
    with pytest.raises(SettingsError, match="`n_threads` should be at least 1, but is 0"):
        physical_map(load_memory("half/0"), 2, n_threads=0)


def test_the_command_makes_map_and_picture_and_goes_on_when_told(capsys, tmp_path, memory):
    out = tmp_path / "physical.npz"
    assert main(["map", "half/0", "--physical", "--resolution", "2", "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["n_performed"] == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["physical.npz", "physical.png"]

    physical_map(memory, 2, checkpoint=tmp_path / "physical.part.npz")
    assert main(["map", "half/0", "--physical", "--resolution", "2", "--out", str(out)]) == 2
    assert "holds an unfinished map; go on with --resume" in capsys.readouterr().err
    assert main(["map", "half/0", "--physical", "--resolution", "2", "--out", str(out), "--resume"]) == 0
    assert "2 x 2 movements performed" in capsys.readouterr().out
    assert equal(PhysicalMap.load(out), physical_map(memory, 2))


@pytest.mark.parametrize(
    ("flags", "message"),
    [(["--resume"], "go with --physical"), (["--physical", "--resume"], "there is no map.part.npz to go on with")],
)
def test_flags_that_do_not_fit_are_told(flags, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["map", "half/0", *flags]) == 2
    assert message in capsys.readouterr().err
