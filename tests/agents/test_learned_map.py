"""The learned map: taught by the truth of memories, resumable bit for bit, never by test memories; it plays."""

import dataclasses
import threading

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box

from creative_nao.agents import BundleHeader, TrainedPolicy, load_agent, make_agent, save_bundle
from creative_nao.agents.learned_map.agent import LOCAL_SIGMA, LearnedMapAgent, LearnedMapSettings, refined
from creative_nao.agents.learned_map.episodes import SimulatedEpisode, random_warp
from creative_nao.agents.learned_map.training import (
    Simulator,
    SupervisedMap,
    judge,
    learning_rate,
    train_map,
    untrained_map,
)
from creative_nao.agents.learned_map.truth import (
    KIND,
    MemoryTruth,
    kept_truth,
    memory_truth,
    read_truths,
    refuse_test_memories,
    spread_points,
)
from creative_nao.agents.play import evaluate_agent, play_episode
from creative_nao.agents.settings import check_entry, read_hyperparameters
from creative_nao.agents.training import TrainingPlan, train_agent
from creative_nao.agents.tuning import TuningPlan
from creative_nao.arrays import load_tensors, save_tensors
from creative_nao.cli.dispatch import main
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, ShapeError
from creative_nao.measures import dtw, reward_scale
from creative_nao.model import load_memory

ENV, MODULATED = "CreativeNao/BoxingMental-v1", "CreativeNao/BoxingModulation-v1"
NET = {"width": 8, "n_heads": 2, "n_layers": 1, "n_asked": 36, "n_refined": 16}
OWN = {"own_interval": 1, "own_size": 2, "imagined_share": 0.5, "swapped_actions": [1, 0, 3, 2, 5, 4]}
ENTRY = {"n_timesteps": 12, "batch_size": 4, "n_queries": 8, **OWN, "policy_kwargs": NET}


def plan(**changes):
    chosen = check_entry("learned_map", {**ENTRY, **changes}, "test")
    return TrainingPlan(
        chosen, env=ENV, judged_env=ENV, judged_seeds=(0, 1), evaluation_interval=8, checkpoint_interval=8
    )


@pytest.fixture(scope="module")
def truths():
    """The truth of a memory to learn from, and of one to be judged on, at 36 points."""
    return [memory_truth(load_memory(name), n_points=36) for name in ("half/0", "open/10")]


@pytest.fixture(scope="module")
def trained(truths, tmp_path_factory):
    """A learned map after three steps: the policy, its record, and its folder."""
    folder = tmp_path_factory.mktemp("learned")
    return *train_map(plan(), truths[:1], truths[1:], checkpoint=folder / "checkpoint", logs=folder), folder


@pytest.fixture(scope="module")
def bundle(trained):
    policy, _, folder = trained
    spaces = policy.observation_space, policy.action_space
    header = BundleHeader("learned_map", plan().hyperparameters, ENV, "train", 0, 36, *spaces)
    return save_bundle(folder / "agent.safetensors", header, policy)


def observations(n, memory="half/10"):
    """Those of a random episode, after 0 to n - 1 tries."""
    env = gym.make(ENV, memory=memory)
    seen = [env.reset(seed=0)[0]]
    rng = np.random.default_rng(0)
    while len(seen) < n:
        seen.append(env.step(rng.uniform(-1.0, 1.0, 2).astype(np.float32))[0])
    env.close()
    return np.stack(seen)


def test_a_truth_is_what_the_memory_generates(truths, tmp_path):
    memory, truth = load_memory("half/0"), truths[0]
    moves, unit = memory.generate(truth.pb[[3, 20]].astype(np.float64)), reward_scale(memory.demonstrations)
    assert truth.gaps[3, 20] == truth.gaps[20, 3] == pytest.approx(dtw(*moves) / unit, rel=2e-3)
    assert truth.distances[3, 1] == pytest.approx(dtw(moves[0], memory.demonstrations.trajectories[1]) / unit, rel=1e-5)
    assert truth.form == (2, 6)
    path = truth.save(tmp_path / "one.truth.safetensors")
    (again,) = read_truths(tmp_path)
    for name in ("name", "pb", "outcome", "distances", "gaps", "learned_pb", "basic_gaps"):
        assert np.array_equal(getattr(again, name), getattr(truth, name)), name
    assert kept_truth(memory, path, n_points=36).name == "half/0"
    assert kept_truth(memory, path, "made again", n_points=16).name == "made again"
    assert len(spread_points(4, 20)) == 20


@pytest.mark.parametrize(
    ("name", "change", "told"),
    [
        ("pb", lambda a: a * 2.0, "`pb` should hold numbers from -1 to 1"),
        ("outcome", lambda a: a + np.int8(9), "`outcome` should hold numbers from 0 to 8"),
        ("gaps", lambda a: a[:, 1:].copy(), r"`gaps` should have shape \(36, 36\)"),
        ("distances", lambda a: a * np.float32(np.nan), "`distances` should hold finite numbers"),
        ("more", lambda _: np.zeros(1), "`more` belongs to no part of it"),
    ],
)
def test_a_damaged_truth_is_refused(truths, tmp_path, name, change, told):
    path = truths[0].save(tmp_path / "one.truth.safetensors")
    header, arrays = load_tensors(path, kind=KIND)
    save_tensors(path, kind=KIND, header=header, tensors={**arrays, name: change(arrays.get(name))})
    with pytest.raises(FileFormatError, match=told):
        MemoryTruth.load(path)


def test_a_folder_without_truths_names_the_command(tmp_path):
    with pytest.raises(NotFoundError, match="creative-nao agent memories --out"):
        read_truths(tmp_path)


def test_no_test_memory_is_learned_from_whatever_its_name(truths):
    hidden = dataclasses.replace(truths[0], name="mine", learned_pb=load_memory("half/12").pb.astype(np.float32))
    with pytest.raises(SettingsError, match="should not hold a test memory of the bank, but `mine` is half/12"):
        train_map(plan(), [truths[0], hidden], truths[1:])
    refuse_test_memories(truths, "these")


def test_no_memory_is_learned_from_and_judged_on(truths):
    with pytest.raises(SettingsError, match="validation memory `half/0` is among those that are trained on"):
        train_map(plan(), truths, truths[:1])


def test_a_simulated_episode_keeps_the_books_of_the_environment(truths):
    """Its rows and rewards are those that the environment tells of the same points."""
    truth, rng = truths[0], np.random.default_rng(0)
    episode = SimulatedEpisode(truth, lambda pb: pb, np.arange(6))
    episode.perform_best(20, 2, rng)
    rows, performed = episode.rows()
    assert performed.all()
    env = gym.make(ENV, memory="half/0")
    observation, _ = env.reset(seed=0)
    earned = []
    for place in episode.performed:
        observation, reward, *_ = env.step(truth.pb[place])
        earned.append(reward)
    seen = observation[12 : 12 + rows.size].reshape(rows.shape)
    np.testing.assert_allclose(rows, seen, atol=2e-3)  # gaps are kept in half precision
    np.testing.assert_allclose(episode.earned, earned, atol=2e-3)
    env.close()


def test_what_was_imagined_is_worth_what_performing_it_would_earn_now(truths):
    order = np.array([1, 0, 3, 2, 5, 4])
    for seed in range(10):
        episode = SimulatedEpisode(truths[0], lambda pb: -pb, order)
        episode.perform_planned(seed, np.random.default_rng(seed))
        assert len(episode.performed) == seed
        assert not set(episode.imagined) & set(episode.performed)
        rows, performed = episode.rows()
        assert performed.sum() == seed
        worth = rows[~performed, 12] / (1.0 - rows[~performed, 12])
        np.testing.assert_allclose(worth, episode.worth(episode.imagined), rtol=1e-4, atol=1e-6)
        np.testing.assert_array_equal(rows[~performed, 1:3], -truths[0].pb[episode.imagined])
        far = truths[0].distances[episode.imagined][:, order]
        np.testing.assert_allclose(rows[~performed, 13:], far / (far + 1.0), rtol=1e-5)


@pytest.mark.parametrize("n_pb", [1, 2, 4])
def test_a_warp_maps_the_space_onto_itself_and_keeps_its_corners(n_pb):
    rng = np.random.default_rng(1)
    warp, turn = random_warp(n_pb, rng, 0.06), random_warp(n_pb, rng)
    points = rng.uniform(-1.0, 1.0, (50, n_pb))
    assert np.abs(warp(points)).max() <= 1.0
    corners = rng.choice([-1.0, 1.0], (8, n_pb))
    np.testing.assert_allclose(np.abs(warp(corners)), 1.0, atol=1e-6)
    lengths = np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(np.linalg.norm(turn(points), axis=1), lengths, rtol=1e-5)


def test_a_batch_shows_episodes_of_all_kinds(truths):
    recipe = SupervisedMap(**plan().hyperparameters.arguments)
    simulator = Simulator(truths, recipe)
    simulator.own = np.tile(np.arange(31), (3, 1)) % 2
    seen = set()
    for seed in range(12):
        (points, rows, performed), (pb, usable, far, basic) = simulator.batch(np.random.default_rng(seed))
        b, n = performed.shape
        shapes = [tuple(one.shape) for one in (points, rows, pb, usable, far, basic)]
        assert shapes == [(b, 6, 2), (b, n, 19), (b, 8, 2), (b, 8), (b, 8), (b, 8, 6)]
        assert (performed <= rows[..., 0]).all()
        seen.add(b)
    assert seen == {2, 4}  # half as many where what was imagined is shown
    assert learning_rate(recipe, 0, 100) < learning_rate(recipe, 10, 100) > learning_rate(recipe, 99, 100)


def test_training_is_decided_by_its_seed_and_resumed_bit_for_bit(truths, trained, tmp_path):
    straight, record, folder = trained
    assert record.evaluation_ends == [0, 8, 12]
    stop, checkpoint = threading.Event(), tmp_path / "checkpoint"
    with pytest.raises(KeyboardInterrupt):
        train_map(
            plan(), truths[:1], truths[1:], checkpoint=checkpoint, logs=tmp_path, stop=stop,
            progress=lambda _, done: stop.set() if done >= 4 else None,
        )  # fmt: skip
    resumed, again = train_map(plan(), truths[:1], truths[1:], checkpoint=checkpoint, resume=True, logs=tmp_path)
    assert again.evaluations == record.evaluations
    for name, tensor in straight.state_dict().items():
        assert np.array_equal(tensor, resumed.state_dict()[name]), name
    for name in ("checkpoint", "progress.csv", "evaluations.csv"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name
    with pytest.raises(SettingsError, match=r"another `hyperparameters\.arguments\.n_queries`"):
        train_map(plan(n_queries=9), truths[:1], truths[1:], checkpoint=checkpoint, resume=True)


def test_training_learns(truths, tmp_path):
    """The loss falls, and the reward of the weights kept is the one recorded."""
    chosen = dataclasses.replace(plan(n_timesteps=120, learning_rate=0.02, own_interval=0), evaluation_interval=60)
    policy, record = train_map(chosen, truths[:1], truths[1:], logs=tmp_path)
    first, last = ([*map(float, row.split(","))] for row in (tmp_path / "progress.csv").read_text().split()[1:])
    assert last[1] < first[1] - 0.1
    assert record.best_mean == np.mean(judge(policy, truths[1:], (0, 1)))


def test_a_bundle_predicts_from_the_observation_alone(trained, bundle):
    policy, agent, seen = trained[0], load_agent(bundle), observations(6)
    chosen, state = agent.predict(seen, state="mine")
    assert (chosen.shape, chosen.dtype, state) == ((6, 2), np.float32, "mine")
    for one, row in zip(chosen, seen, strict=True):
        alone, _ = agent.predict(row)
        assert np.array_equal(one, alone)
        assert np.array_equal(one, policy.predict(row)[0])
    assert agent.track == "trajectories"
    with pytest.raises(ShapeError, match="`observation` should end in"):
        agent.predict(seen[:, 1:])


def test_movements_of_several_pb_vectors_are_predicted_and_played():
    """Each PB vector is held for two decisions of ten; what the network is told is the same for agent and policy."""
    truth = memory_truth(load_memory("half/0"), n_points=16, n_segments=5)
    chosen = check_entry("learned_map", {**ENTRY, "policy_kwargs": {**NET, "n_segments": 5}}, "test")
    of_modulation = dataclasses.replace(plan(), hyperparameters=chosen, env=MODULATED, judged_env=MODULATED)
    with pytest.raises(SettingsError, match="`n_segments` of the policy is 1, but 5"):
        untrained_map(truth, plan().hyperparameters, SupervisedMap(), of_modulation)
    policy = untrained_map(truth, chosen, SupervisedMap(), of_modulation)
    policy.set_training_mode(False)
    header = BundleHeader("learned_map", chosen, MODULATED, "train", 0, 16, policy.observation_space, Box(-1, 1, (2,)))
    agent, told, env = (
        LearnedMapAgent(TrainedPolicy(header, policy)),
        [],
        Watched(gym.make(MODULATED, memory="half/10")),
    )
    played = play_episode(agent, env, seed=0, rng=np.random.default_rng(0))
    steps = [next(played) for _ in range(30)]
    played.close()
    expect = policy.expect
    policy.expect = lambda points, rows, performed: told.append(rows) or expect(points, rows, performed)
    assert env.action_space.contains(policy.predict(env.seen)[0])
    np.testing.assert_allclose(told[0], agent.rows()[0], rtol=1e-6)
    assert [len(told[0]), sum("outcome" in step.info for step in steps)] == [3, 3]
    seen, _ = env.reset(seed=0)
    taken = []
    for _ in range(10):
        taken.append(policy.predict(seen)[0])
        assert np.array_equal(policy.predict(seen[None])[0][0], taken[-1])
        seen = env.step(taken[-1])[0]
    assert np.array_equal(taken[::2], taken[1::2])
    assert len(np.unique(taken, axis=0)) == 5
    assert len(told) == 2 * 5 + 1
    env.close()


def test_drawn_actions_follow_the_generator_of_torch(bundle):
    import torch

    agent, (seen,) = load_agent(bundle), observations(1)
    drawn = []
    for seed in (0, 0, 1, 2, 3):
        torch.manual_seed(seed)
        drawn.append(agent.predict(seen, deterministic=False)[0].tolist())
    assert drawn[0] == drawn[1]
    assert len({tuple(one) for one in drawn}) > 1


def test_a_damaged_bundle_is_refused(bundle, tmp_path):
    header, arrays = load_tensors(bundle, kind="agent bundle")
    path = tmp_path / "agent.safetensors"
    name = "head.1.weight"
    for changed, told in (
        ({name: arrays[name][:2].copy()}, rf"the array `{name}` should have shape \(9, 8\)"),
        ({name: arrays[name] * np.float32(np.nan)}, "should hold finite numbers"),
        ({"more": arrays[name]}, "`more` belongs to no part"),
    ):
        save_tensors(path, kind="agent bundle", header=header, tensors={**arrays, **changed})
        with pytest.raises(FileFormatError, match=told):
            load_agent(path)
    for kwargs, told in (({"width": 10}, "a layer of 10 units"), ({"n_heads": 3}, "`n_heads` should divide `width` 8")):
        settings = {**header["settings"], "policy_kwargs": {**NET, **kwargs}}
        save_tensors(path, kind="agent bundle", header={**header, "settings": settings}, tensors=arrays)
        with pytest.raises(FileFormatError, match=told):
            load_agent(path)


@pytest.mark.parametrize("ending", ["", "@4"])
def test_the_agent_plays_and_its_seed_decides(bundle, ending):
    agent = make_agent(f"{bundle}{ending}")
    one, other = evaluate_agent(agent, ENV, ["half/10"], [0, 1])
    assert one.reward > 0.0
    assert one.n_imagined == (120 if ending else 0)
    assert evaluate_agent(make_agent(f"{bundle}{ending}"), ENV, ["half/10"], [1]) == (other,)


class Watched(gym.ObservationWrapper):
    """Keeps the last observation."""

    def observation(self, observation):
        self.seen = observation
        return observation


def test_the_agent_tells_the_network_what_the_observation_holds(bundle):
    """Its rows are those of the -v1 observation, and movements imagined stand before them."""
    agent, env = make_agent(str(bundle)), Watched(gym.make(ENV, memory="half/10", n_imagined=60))
    agent.n_candidates = 2
    for step in play_episode(agent, env, seed=0, rng=np.random.default_rng(0)):
        rows, performed = agent.rows()
        n = int(performed.sum())
        seen = env.seen[12 : 12 + 19 * n].reshape(n, 19)
        np.testing.assert_allclose(rows[performed], seen, rtol=1e-6)
        assert not performed[: len(rows) - n].any()
        assert len(rows) <= step.n_imagined + n
    env.close()


def test_beyond_n_expected_it_imagines_around_the_best_movement(bundle):
    agent = LearnedMapAgent(load_agent(bundle), LearnedMapSettings(n_expected=3))
    agent.n_candidates = 8
    env = gym.make(ENV, memory="half/10", n_imagined=240)
    for step in play_episode(agent, env, seed=0, rng=np.random.default_rng(0)):
        if step.n_imagined == 80 and agent.best() is not None:
            found, best = agent.where(8), agent._pool_pb[agent.best()]
            gaps = np.abs(found - best).max(axis=1)
            assert found.shape == (8, 2)
            assert (gaps[3:] < 5.0 * LOCAL_SIGMA).all()
            assert gaps[3:].min() < LOCAL_SIGMA
            assert len(agent.where(3)) == 3
            break
    else:
        pytest.fail("no movement was left to imagine around")
    env.close()


@pytest.mark.parametrize(("n_actions", "share", "n_first"), [(30, 0.5, 2), (31, 0.5, 31 + 1), (31, 0.0, 2)])
def test_in_long_episodes_half_of_the_budget_is_spread_first(bundle, n_actions, share, n_first):
    agent = LearnedMapAgent(load_agent(bundle), LearnedMapSettings(long_first_share=share))
    agent.n_candidates = 2
    env = gym.make(ENV, memory="half/10", n_imagined=2 * n_actions, n_actions=n_actions)
    step = next(play_episode(agent, env, seed=0, rng=np.random.default_rng(0)))
    assert step.n_imagined == n_first
    env.close()


def test_the_agent_refuses_memories_of_another_form(bundle):
    with pytest.raises(SettingsError, match=r"shape \(6, 2\), but these are \(6, 4\)"):
        evaluate_agent(make_agent(str(bundle)), ENV, ["half-4pb/10"], [0])


def test_the_best_candidate_is_refined_and_improvement_is_what_is_expected_beyond_the_best():
    def ask(pb):
        return np.full(len(pb), 0.5), 2.0 - np.abs(pb - 0.6).sum(axis=1), np.full(len(pb), 0.1)

    candidates = spread_points(2, 16).astype(np.float32)
    pb, value = refined(ask, candidates, 25)
    assert len(pb) == len(value) == 16 + 25
    assert value.max() > value[:16].max()
    np.testing.assert_allclose(pb[value.argmax()], [0.6, 0.6], atol=0.17)
    far, better = (refined(ask, candidates, 0, best)[1] for best in (5.0, 1.0))
    assert far.max() < 1e-6
    distance = ask(candidates)[1].max()
    assert better.max() == pytest.approx(0.5 * (distance - 1.0), rel=0.1)


def test_the_hyperparameters_ship_and_name_no_environment():
    found = read_hyperparameters("learned_map", ENV)
    assert check_entry("learned_map", found.as_zoo(), "again") == found
    assert SupervisedMap(**found.arguments).swapped_actions == (1, 0, 3, 2, 5, 4)
    for entry, told in (
        ({"n_envs": 2}, "`n_envs` is for learning in environments"),
        ({"noise_type": "normal", "noise_std": 0.1}, "`noise_type` is for learning in environments"),
        ({"gamma": 0.5}, "no setting `gamma`.* of SupervisedMap"),
        ({"policy_kwargs": {"n_head": 2}}, r"no setting `n_head` \(did you mean `n_heads`\?\)"),
    ):
        with pytest.raises(SettingsError, match=told):
            check_entry("learned_map", {**ENTRY, **entry}, "test")
    with pytest.raises(SettingsError, match="learned_map learns from memories, not in an environment"):
        train_agent(plan())
    with pytest.raises(SettingsError, match="learned_map has no search"):
        TuningPlan("learned_map", ENV)


@pytest.mark.slow
def test_memories_are_made_trained_on_and_the_score_replays(tmp_path, capsys):
    made = ["agent", "memories", "--n-memories", "3", "--n-epochs", "200", "--n-points", "64"]
    assert main([*made, "--out", str(tmp_path / "a"), "--n-workers", "2"]) == 0
    assert main([*made, "--out", str(tmp_path / "b"), "--n-workers", "1"]) == 0
    for one, other in zip(read_truths(tmp_path / "a"), read_truths(tmp_path / "b"), strict=True):
        assert np.array_equal(one.gaps, other.gaps)
    assert main([*made, "--out", str(tmp_path / "a")]) == 2
    assert "--resume" in capsys.readouterr().err
    assert main([*made, "--out", str(tmp_path / "a"), "--resume"]) == 0
    (tmp_path / "tiny.yml").write_text(f"{ENV}: {{n_timesteps: 12, batch_size: 4, policy_kwargs: {NET}}}")
    train = ["agent", "train", "learned_map", "--out", str(tmp_path / "out"), "--memories", str(tmp_path / "a")]
    train += ["--memory", "open/0", "--validation-memory", "half/10", "--conf-file", str(tmp_path / "tiny.yml")]
    assert main([*train, "--score-seeds", "1"]) == 0
    assert main(["agent", "run", str(tmp_path / "out" / "agent.safetensors"), "--replay"]) == 0


def test_a_command_with_what_means_nothing_is_refused(tmp_path, capsys):
    assert main(["agent", "train", "learned_map", "--out", str(tmp_path / "x"), "--augment", "True"]) == 2
    assert "--augment means nothing to learned_map" in capsys.readouterr().err
    assert main(["agent", "train", "ppo", "--out", str(tmp_path / "x"), "--memories", str(tmp_path)]) == 2
    assert "--memories means nothing to ppo" in capsys.readouterr().err
    assert main(["agent", "memories", "--out", str(tmp_path / "x"), "--seed", "12"]) == 2
    assert "--seed should be at least 16" in capsys.readouterr().err
