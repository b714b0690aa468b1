"""Training: decided by its seed, resumable bit for bit, never on test memories; bundles replay their score."""

import dataclasses
import json
import re
import threading

import numpy as np
import pytest

from creative_nao.agents import BundleHeader, TrainedPolicy, load_agent, make_agent, save_bundle
from creative_nao.agents.bundle import replay
from creative_nao.agents.play import evaluate_agent, evaluate_policy
from creative_nao.agents.resume import KIND, PRIVATE_NAMES, ResumeState, load_checkpoint, restore, save_checkpoint
from creative_nao.agents.settings import AUGMENTATION, CELL_POLICY, CELL_SAC_POLICY, check_entry
from creative_nao.agents.training import TrainingPlan, make_model, train_agent
from creative_nao.arrays import load_tensors, save_tensors
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError

ENV = "CreativeNao/BoxingMental-v0"
ON = {"n_timesteps": 240, "n_envs": 2, "n_steps": 30, "batch_size": 30, "n_epochs": 2}
OFF = {
    "n_timesteps": 120,
    "n_envs": 2,
    "learning_starts": 30,
    "batch_size": 16,
    "buffer_size": 200,
    "learning_rate": 0.01,
}
NETS = {"net_arch": [8]}
ENTRIES = {
    "ppo": {**ON, "policy_kwargs": NETS, "learning_rate": "lin_0.01"},
    "sac": {**OFF, "policy_kwargs": NETS},
    "td3": {**OFF, "policy_kwargs": NETS, "noise_type": "normal", "noise_std": 0.3},
    "recurrent_ppo": {**ON, "policy_kwargs": {**NETS, "lstm_hidden_size": 4}},
    "tqc": {**OFF, "policy_kwargs": {**NETS, "n_quantiles": 5}},
    "crossq": {**OFF, "policy_kwargs": NETS},
}
CELLS = {"policy_kwargs": {"width": 4, "n_layers": 1}, "vec_env_wrapper": AUGMENTATION}
CELL_ENTRIES = {
    "ppo": {**ON, **CELLS, "policy": CELL_POLICY, "learning_rate": "lin_0.01"},
    "sac": {**OFF, **CELLS, "policy": CELL_SAC_POLICY},
}


def plan(algorithm, entries=ENTRIES, **changes):
    chosen = check_entry(algorithm, entries[algorithm], "test")
    values = {"evaluation_interval": 60, "checkpoint_interval": 60, "judged_seeds": (0,), "judged_memory": "half/10"}
    return TrainingPlan(chosen, env=ENV, judged_env=ENV, memory="train", **{**values, **changes})


def interrupted(chosen, checkpoint, at):
    """Train until `at` decisions are made, as Ctrl-C would end it."""
    stop = threading.Event()

    def watch(_, done):
        if done >= at:
            stop.set()

    with pytest.raises(KeyboardInterrupt):
        train_agent(chosen, checkpoint=checkpoint, progress=watch, stop=stop)


def state_of(path):
    header, arrays = load_tensors(path, kind=KIND)
    header["state"]["episodes"] = [one[:2] for one in header["state"]["episodes"]]  # the third is the time of day
    return header, arrays


EVERYDAY = ("ppo", "sac over cells, augmented")
"""An on-policy and an off-policy algorithm; the others of `CASES` are trained nightly."""
CASES = [
    pytest.param(name, entries, id=label, marks=() if label in EVERYDAY else pytest.mark.slow)
    for entries, ending in ((ENTRIES, ""), (CELL_ENTRIES, " over cells, augmented"))
    for name in entries
    for label in (name + ending,)
]


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """A tiny PPO, trained once: its policy, record and checkpoint."""
    checkpoint = tmp_path_factory.mktemp("trained") / "checkpoint"
    return *train_agent(plan("ppo"), checkpoint=checkpoint), checkpoint


@pytest.mark.parametrize(("algorithm", "entries"), CASES)
def test_a_resumed_training_equals_an_uninterrupted_one_bit_for_bit(algorithm, entries, tmp_path):
    chosen = plan(algorithm, entries)
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    straight, record = train_agent(chosen, checkpoint=whole)
    interrupted(chosen, broken, at=90)
    stopped_at = state_of(broken)[0]["state"]["num_timesteps"]
    assert 0 < stopped_at < chosen.hyperparameters.n_timesteps

    resumed, again = train_agent(chosen, checkpoint=broken, resume=True)

    assert again.evaluations == record.evaluations
    assert again.episode_rewards == record.episode_rewards
    for name, tensor in straight.state_dict().items():
        assert np.array_equal(tensor, resumed.state_dict()[name]), name
    one, other = state_of(whole), state_of(broken)
    assert one[0] == other[0]
    assert one[1].keys() == other[1].keys()
    for name, array in one[1].items():
        assert np.array_equal(array, other[1][name]), name


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_what_resuming_reads_of_stable_baselines3_is_there(algorithm):
    chosen = check_entry(algorithm, ENTRIES[algorithm], "test")
    model = make_model(chosen, ENV, seed=0, env_kwargs={"memory": "half/10"})
    assert [name for name in PRIVATE_NAMES if not hasattr(model, name)] == []
    model.get_env().close()


@pytest.mark.slow
def test_state_dependent_noise_is_resumed_too(tmp_path):
    entry = {**ENTRIES["ppo"], "use_sde": True}
    chosen = dataclasses.replace(plan("ppo"), hyperparameters=check_entry("ppo", entry, "test"))
    _, record = train_agent(chosen)
    interrupted(chosen, tmp_path / "broken", at=90)
    assert train_agent(chosen, checkpoint=tmp_path / "broken", resume=True)[1].episode_rewards == record.episode_rewards


def test_the_seed_decides_the_training(trained):
    """That the same seed gives the same training is what the test of resuming shows."""
    assert train_agent(plan("ppo", seed=1))[1].episode_rewards != trained[1].episode_rewards


def test_the_best_weights_are_kept(trained):
    policy, record, _ = trained
    best = 1 + int(np.argmax([np.mean(one) for one in record.evaluations[1:]]))
    assert best > 0
    from creative_nao.agents import PolicyAgent

    played = evaluate_agent(PolicyAgent(policy, deterministic=False), ENV, ["half/10"], [0])
    assert (played[0].reward,) == record.evaluations[best]


def test_a_checkpoint_of_another_plan_is_refused_by_name(trained):
    path = trained[2]
    with pytest.raises(SettingsError, match="of a training with another `seed`; give the same settings"):
        train_agent(plan("ppo", seed=7), checkpoint=path, resume=True)


def test_a_checkpoint_of_release_0_1_0_names_its_policy_otherwise(trained):
    """The released name of a policy over cells is that of the present one: the plans are the same."""
    told, state = load_checkpoint(trained[2], plan("ppo").as_json())
    chosen = plan("ppo", CELL_ENTRIES).as_json()
    path = trained[2].with_name("released")
    released = {**chosen["hyperparameters"], "policy": "creative_nao.agents.cell_policy.CellPolicy"}
    save_checkpoint(path, {**chosen, "hyperparameters": released}, told, state)
    assert load_checkpoint(path, chosen)[0].episode_rewards == told.episode_rewards


def test_a_damaged_checkpoint_is_named(trained, tmp_path):
    header, arrays = load_tensors(trained[2], kind=KIND)
    del arrays["state.env.1.observation"]
    path = tmp_path / "damaged"
    save_tensors(path, kind=KIND, header=header, tensors=arrays)
    with pytest.raises(FileFormatError, match="training state: its environments do not fit this training"):
        train_agent(plan("ppo"), checkpoint=path, resume=True)


def torch_place(place, left):
    def change(values, arrays):
        arrays["random.torch"][8:12] = np.array([left], np.int32).view(np.uint8)
        arrays["random.torch"][16:24] = np.array([place], np.uint64).view(np.uint8)

    return change


def groups(values):
    """Return the settings of the optimiser as the checkpoint packs them: a list of pairs."""
    packed = dict(values["parameters"]["items"])["policy.optimizer"]
    return dict(packed["items"])["param_groups"]["list"][0]["items"]


def moments_of_another_shape(values, arrays):
    name = next(name for name in sorted(arrays) if name.endswith("exp_avg") and arrays[name].ndim == 2)
    arrays[name] = arrays[name][:, :1]


def pcg(**changes):
    return lambda v, a: v["random"]["action_space"].update(changes)


WILD = {
    "numpy's place": lambda v, a: v["random"]["numpy"].__setitem__(1, 10**9),
    "numpy's place, just beyond": lambda v, a: v["random"]["numpy"].__setitem__(1, 625),
    "numpy's place, negative": lambda v, a: v["random"]["numpy"].__setitem__(1, -1),
    "numpy's kind": lambda v, a: v["random"]["numpy"].__setitem__(0, "PCG64"),
    "numpy's key": lambda v, a: a.update({"random.numpy": a["random.numpy"][:-1]}),
    "numpy's key of another type": lambda v, a: a.update({"random.numpy": a["random.numpy"].astype(np.uint64)}),
    "Python's place": lambda v, a: a["random.python"].__setitem__(624, 10**6),
    "Python's key": lambda v, a: a.update({"random.python": a["random.python"][:100]}),
    "torch's place": torch_place(625, 1),
    "torch's place and rest": torch_place(624, 624),
    "torch's rest": torch_place(0, -5),
    "torch's state": lambda v, a: a.update({"random.torch": a["random.torch"][:100]}),
    "PCG64's state": pcg(state={"state": 2**128, "inc": 1}),
    "PCG64's state, negative": pcg(state={"state": -1, "inc": 1}),
    "PCG64's increment": pcg(state={"state": 1, "inc": 2}),
    "PCG64's half": pcg(uinteger=2**32),
    "PCG64's flag": pcg(has_uint32=7),
    "PCG64's kind": pcg(bit_generator="MT19937"),
    "the last observation": lambda v, a: a["last_obs"].__setitem__((0, 0), 1e9),
    "the number of copies": lambda v, a: a.update(last_obs=a["last_obs"][:1]),
    "an observation of an environment": lambda v, a: a["env.0.observation"].__setitem__(0, 1e9),
    "moments of an optimiser": moments_of_another_shape,
    "a counter": lambda v, a: v.update(num_timesteps=10**18),
    "settings of an optimiser": lambda v, a: groups(v)[0].__setitem__(1, {"value": "fast"}),  # last: it stays in
}  # fmt: skip


def test_a_wild_number_of_a_checkpoint_reaches_no_library(trained, attempt):
    attempt("a checkpoint of an agent", "wild states of generators, optimisers, environments, counters",
            "refused by the name of the part", len(WILD))  # fmt: skip
    chosen = plan("ppo")
    model = make_model(chosen.hyperparameters, ENV, seed=0, env_kwargs={"memory": "train"})
    told = {}
    for name, change in WILD.items():
        state = load_checkpoint(trained[2], chosen.as_json())[1]
        restore(model, state)
        values, arrays = json.loads(json.dumps(state.values)), {key: one.copy() for key, one in state.arrays.items()}
        change(values, arrays)
        try:
            restore(model, ResumeState(values, arrays))
        except FileFormatError as error:
            told[name] = str(error)
    model.get_env().close()
    assert list(told) == list(WILD)
    assert [
        one for one in told.values() if not re.match(r"training state: its .* do not fit this training: ", one)
    ] == []


@pytest.mark.parametrize("memory", ["test", "half/12"])
def test_no_training_sees_a_test_memory(memory):
    with pytest.raises(SettingsError, match=f"`memory` should not be of the test part of the bank, but is `{memory}`"):
        dataclasses.replace(plan("ppo"), memory=memory)
    with pytest.raises(SettingsError, match="`judged_memory` should not be of the test part"):
        dataclasses.replace(plan("ppo"), judged_memory=memory)


@pytest.mark.parametrize(("algorithm", "entries"), CASES)
def test_a_bundle_replays_its_recorded_score_exactly(algorithm, entries, tmp_path):
    chosen = plan(algorithm, entries)
    policy, _ = train_agent(chosen)
    header = BundleHeader(
        algorithm, chosen.hyperparameters, ENV, "train", 0, 240, policy.observation_space, policy.action_space,
        command="the command",
    )  # fmt: skip
    score = evaluate_policy(TrainedPolicy(header, policy), ENV, ("half/10", "open/10"), (0, 1), deterministic=False)
    path = save_bundle(tmp_path / "agent", dataclasses.replace(header, score=score), policy)

    loaded = load_agent(path)
    assert loaded.header.score is not None
    assert loaded.header.command == "the command"
    assert loaded.header.settings.augment == (entries is CELL_ENTRIES)
    assert replay(loaded) == loaded.header.score
    agent = make_agent(loaded.header.agent, path)
    assert make_agent(str(path)).name == agent.name == loaded.header.agent
    assert not agent.deterministic
    loaded.policy.load_state_dict({name: tensor + 0.5 for name, tensor in loaded.policy.state_dict().items()})
    assert replay(loaded) != loaded.header.score, "the replay can fail"


def test_a_bundle_without_a_score_says_so(trained, tmp_path):
    chosen, policy = plan("ppo"), trained[0]
    spaces = policy.observation_space, policy.action_space
    path = save_bundle(
        tmp_path / "a", BundleHeader("ppo", chosen.hyperparameters, ENV, "train", 0, 240, *spaces), policy
    )
    with pytest.raises(SettingsError, match="this bundle records no score to replay"):
        replay(load_agent(path))


def test_a_wrong_shipped_name_brings_what_ships():
    with pytest.raises(NotFoundError, match=r"no agent bundle file at ppo/BoxingMetal-v0.*shipped are"):
        make_agent("ppo/BoxingMetal-v0")


def centre():
    class Centre:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.zeros(2, np.float32), None

    return Centre()


def test_a_factory_of_one_s_own_plays(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "my_agents", sys.modules[__name__])
    agent = make_agent("my_agents:centre")
    assert agent.name == "my_agents:centre"
    assert evaluate_agent(agent, ENV, ["half/10"], [0])[0].reward >= 0.0
    with pytest.raises(NotFoundError, match="agent `my_agents:corner`: `my_agents` has no `corner`"):
        make_agent("my_agents:corner")
    with pytest.raises(SettingsError, match="an agent should be an `Agent`, an object with `predict`"):
        make_agent("builtins:dict")


def test_an_unknown_environment_brings_the_nearest():
    with pytest.raises(NotFoundError, match=r"no environment `CreativeNao/Boxin-v0` \(did you mean"):
        evaluate_agent(make_agent("random"), "CreativeNao/Boxin-v0", ["half/10"], [0])
