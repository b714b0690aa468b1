"""Suites are files: the shipped ones are whole, a user's mistakes are named with the nearest right word."""

import dataclasses
import json

import pytest

from creative_nao.agents.bundle import shipped_agents
from creative_nao.agents.registry import UNTRAINED, make_agent
from creative_nao.agents.training import PPOSettings
from creative_nao.demonstrations import Demonstrations, load_demonstrations, save_demonstrations
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.evaluation.jobs import plan
from creative_nao.evaluation.runner import LocalExecutor
from creative_nao.evaluation.suites import SUITE_NAMES, Taught, find_suite, suite_from_values
from creative_nao.model import TrainingSettings, load_memory, split_memories

GOOD = 'agents = ["random"]\nenvs = ["CreativeNao/BoxingMental-v0"]\nmemories = ["half/0"]\n'


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return str(path)

    return write


def test_quick_shows_what_drawing_spreading_imagining_and_training_find():
    quick = find_suite("quick")
    assert quick.agents == ("supervised", "random", "spread", "imagine", "ppo")
    assert quick.envs == ("CreativeNao/Boxing-v0", "CreativeNao/BoxingMental-v0")
    assert (quick.memories, quick.n_seeds, quick.n_actions) == (("half/0",), 5, 30)
    assert quick.training_env == "CreativeNao/BoxingMental-v0"
    assert quick.oracle_envs == ("CreativeNao/BoxingMental-v0",)
    assert (quick.ppo, quick.resolution, quick.seeds_per_job) == (PPOSettings(), 200, 5)


def test_the_suites_of_the_benchmark_ship():
    assert SUITE_NAMES[0] == "quick"
    assert set(SUITE_NAMES) >= {"quick", "search", "physical", "modulation", "transfer"}
    assert all(find_suite(name).name == name and find_suite(name).about for name in SUITE_NAMES)


def test_search_judges_on_memories_that_no_training_sees():
    search = find_suite("search")
    assert search.memories == split_memories("test")
    assert not set(search.memories) & {*split_memories("train"), *split_memories("validation")}
    assert search.n_seeds >= 10


def test_search_lets_all_agents_play_but_the_slow_one_and_the_one_that_knows_the_map():
    agents = set(find_suite("search").agents)
    imagining = {name for name in UNTRAINED if make_agent(name).imagines or make_agent(name).n_candidates > 1}
    hand_rules = {"lattice", "spread", "spread_points"}  # which `frontier` compares, as those that imagine
    assert set(UNTRAINED) - agents == {"bayesian", "oracle"} | imagining | hand_rules
    assert agents - set(UNTRAINED) == {name for name in shipped_agents() if name.endswith("/BoxingMental-v0")}


def test_physical_lets_the_policies_play_that_were_shipped_for_the_body():
    shipped = {name for name in shipped_agents() if name.endswith("/Boxing-v0")}
    assert shipped <= set(find_suite("physical").agents)


def test_a_user_s_file_is_a_suite_named_after_it(write):
    mine = find_suite(write(GOOD))
    assert (mine.name, mine.agents, mine.n_seeds, mine.n_actions) == ("mine", ("random",), 10, 30)
    assert mine.oracle_envs == ("CreativeNao/BoxingMental-v0",)


@pytest.mark.parametrize(
    ("text", "error", "said"),
    [
        (GOOD + "n_seed = 3", SettingsError, r"mine.toml: no key `n_seed` \(did you mean `n_seeds`\?\); there are: "),
        (GOOD + 'n_seeds = "3"', SettingsError, r"`n_seeds` should be a whole number, but is '3'"),
        (GOOD + "n_seeds = true", SettingsError, r"`n_seeds` should be a whole number, but is True"),
        (GOOD + "n_seeds = 0", SettingsError, r"`n_seeds` should be at least 1, but is 0"),
        (GOOD.replace('["random"]', '"random"'), SettingsError, r"`agents` should be a list, but is 'random'"),
        (GOOD.replace('["random"]', "[3]"), SettingsError, r"`agents`, entry 1 should be text, but is 3"),
        (GOOD.replace('["random"]', "[]"), SettingsError, r"`agents` should be a list of at least 1 entries"),
        (GOOD.replace('["random"]', '["random", "random"]'), SettingsError, r"a list that has `random` only once"),
        (GOOD.replace("random", "randon"), NotFoundError, r"no agent `randon` \(did you mean `random`\?\)"),
        (GOOD.replace("Mental", "Metal"), NotFoundError, r"no environment .* \(did you mean `CreativeNao/BoxingM"),
        (GOOD.replace("half/0", "hlaf/0"), NotFoundError, r"no memory `hlaf/0` \(did you mean `half/0`\?\)"),
        (GOOD + "[ppo]\nlearning_rat = 1", SettingsError, r"`ppo`: no key `learning_rat` \(did you mean"),
        (GOOD + "[taught]\nepochs = 1", SettingsError, r"`taught`: no key `epochs` \(did you mean `n_epochs`"),
        (GOOD + "[taught]\nseeds = []", SettingsError, r"`taught`: `seeds` should be a list of at least 1"),
        (GOOD + "[taught]\nn_epochs = 5", SettingsError, r"`taught`: `seeds` is missing"),
        (GOOD.replace("agents", "agent"), SettingsError, r"no key `agent` \(did you mean `agents`\?\)"),
        ("agents = [", FileFormatError, r"mine.toml: not TOML"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_file_is_named(write, text, error, said):
    with pytest.raises(error, match=said):
        find_suite(write(text))


def test_a_file_that_is_not_there_is_said():
    with pytest.raises(NotFoundError, match=r"no suite at nowhere.toml"):
        find_suite("nowhere.toml")


@pytest.mark.parametrize("name", SUITE_NAMES)
def test_a_suite_comes_back_from_its_record(name):
    suite = find_suite(name)
    recorded = json.loads(json.dumps(dataclasses.asdict(suite)))
    assert suite_from_values(recorded, where="record") == suite


def test_memories_of_other_demonstrations_are_trained_before_they_are_searched():
    jobs = plan(find_suite("transfer"), base_seed=0)
    teachings = {job.name: job for job in jobs if job.kind == "teach"}
    assert [job.spec["memory"] for job in teachings.values()] == ["taught/0", "taught/1", "taught/2"]
    for job in jobs:
        if job.kind != "teach":
            needed = [teachings[name] for name in job.needs]
            assert needed
            assert set(job.reads) == {file for teaching in needed for file in teaching.writes}


def test_other_demonstrations_make_another_job(tmp_path):
    transfer = find_suite("transfer")
    taught = dataclasses.replace(transfer.taught, demonstrations=str(tmp_path))
    ours, theirs = (plan(s, base_seed=0) for s in (transfer, dataclasses.replace(transfer, taught=taught)))
    assert all(
        one.described() != other.described() for one, other in zip(ours, theirs, strict=True) if one.kind != "chart"
    )


def test_a_memory_of_a_user_s_recordings_is_trained_in_the_run_folder(tmp_path):
    recordings = tmp_path / "mine"
    save_demonstrations(recordings, load_demonstrations())
    taught = Taught(seeds=(3,), demonstrations=str(recordings), n_epochs=50)
    suite = dataclasses.replace(find_suite("transfer"), taught=taught, memories=taught.names)
    job = next(job for job in plan(suite, base_seed=0) if job.kind == "teach")
    done = LocalExecutor(1).run([job], tmp_path)[job.name]
    memory = load_memory(tmp_path / job.writes[0])
    assert done["memory"] == "taught/3"
    assert done["loss"] == min(memory.loss_history)
    assert memory.demonstrations.names == load_demonstrations().names


def test_folders_of_many_recordings_are_dealt_out_to_disjoint_sets(tmp_path):
    demos = load_demonstrations()
    names = tuple(f"gesture_{k:02}" for k in range(13))
    many = Demonstrations(names, [demos.trajectories[k % 6] for k in range(13)], demos.dt_s, demos.joints)
    save_demonstrations(tmp_path / "robot", many)
    save_demonstrations(tmp_path / "person", demos)
    taught = find_suite("gestures").taught.on([tmp_path / "robot", tmp_path / "person"])

    assert [one.name for one in taught.sets] == ["boxing", "robot-1", "robot-2", "person"]
    assert sorted(taught.sets[1].actions + taught.sets[2].actions) == list(names)
    assert sorted(taught.sets[3].actions) == sorted(demos.names)
    assert len(taught.names) == 4 * len(taught.conditions) * len(taught.seeds)
    with pytest.raises(SettingsError, match="folders of different names"):
        taught.on([tmp_path / "robot"])
    with pytest.raises(SettingsError, match="one folder for this suite; `gestures` takes several"):
        find_suite("transfer").taught.on([tmp_path / "robot", tmp_path / "person"])


def test_conditions_begin_with_a_network_of_which_controls_take_the_points():
    with pytest.raises(SettingsError, match="should begin with a network, but begins with vae"):
        Taught(seeds=(0,), conditions=("vae", "auto"))


def test_a_set_is_taught_under_every_condition_and_its_figures_are_told(tmp_path):
    taught = Taught(seeds=(4,), conditions=("half", "interpolation"), n_epochs=20)
    suite = dataclasses.replace(find_suite("gestures"), taught=taught, memories=taught.names, resolution=10)
    jobs = plan(suite, base_seed=0)
    assert [job.name for job in jobs if job.kind == "teach-set"] == ["teach-set-boxing-4"]
    assert all(job.needs == ("teach-set-boxing-4",) for job in jobs if job.kind in ("play", "chart"))
    done = LocalExecutor(1).run(jobs[:1], tmp_path)[jobs[0].name]

    half, control = done["memories"]
    assert load_memory(tmp_path / "memories/boxing-half-4.safetensors").training == TrainingSettings(
        n_epochs=20, seed=4
    )
    assert (half["memory"], control["memory"]) == suite.memories
    assert max(control["reproduction_dtw"].values()) < 0.2 < min(half["reproduction_dtw"].values())
    for one in (half, control):
        assert one["learned_pct"] + one["unlearned_pct"] == pytest.approx(one["appropriate_pct"])
