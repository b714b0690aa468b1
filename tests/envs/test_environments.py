"""Every registered environment passes the same tests."""

import warnings
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

import creative_nao
from creative_nao.envs import ENVIRONMENTS
from creative_nao.envs.observation import split
from creative_nao.errors import NotFoundError, SettingsError, ShapeError
from creative_nao.measures import reward_scale
from creative_nao.measures.outcome import ALL_OUTCOMES
from creative_nao.model import SPLITS, shipped_memories, split_memories, split_of
from creative_nao.robot import Renderer

NAMES = tuple(name for name in ENVIRONMENTS if name not in ("CreativeNao/Boxing-v1", "CreativeNao/BoxingModulation-v1"))
"""All but two that differ from their -v0 in the observation alone, as BoxingMental-v1 does."""
DRAWN = tuple(name for name in NAMES if name[-3:] == "-v0")
BOXING, MENTAL, REHEARSAL = (f"CreativeNao/Boxing{name}-v0" for name in ("", "Mental", "Rehearsal"))


@pytest.fixture(params=NAMES)
def name(request):
    return request.param


@pytest.fixture
def env(name):
    with gym.make(name) as env:
        yield env


def play(env, seed, n_actions):
    """Play random PB points, `n_actions` movements long; return all that came back."""
    rng = np.random.default_rng(seed)
    found = [env.reset(seed=seed)]
    for _ in range(n_actions * env.unwrapped.n_decisions):
        found.append(env.step(action_of(env, rng.uniform(-1, 1, 2))))
    return found


def action_of(env, pb):
    """Return the action that performs a PB point; in rehearsal it has to commit."""
    return np.ones(env.action_space.shape, np.float32) * [*pb, 1.0][: env.action_space.shape[0]]


def throw(env, pb):
    """Hold a PB point for a whole movement; return what came of it."""
    for _ in range(env.unwrapped.n_decisions):
        found = env.step(action_of(env, pb))
    return found


def test_gymnasium_finds_nothing_to_remark(name):
    """All render modes are tried, too. A human's window opens with the first action, so none is needed here."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*out of date", DeprecationWarning)  # what Gymnasium says of every -v0
        env = gym.make(name)
        check_env(env.unwrapped)
        env.close()


def test_stable_baselines3_finds_nothing_to_remark(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*out of date", DeprecationWarning)  # what Gymnasium says of every -v0
        env = gym.make(name)
        check_env_of_sb3(env)
        env.close()


def test_it_can_be_made_by_module_prefix(name):
    gym.make(f"creative_nao:{name}").close()


def test_equal_seeds_give_equal_episodes_in_two_environments_and_in_one_played_again(name):
    with gym.make(name) as one, gym.make(name) as other:
        first = play(one, 3, 3)
        assert data_equivalence(first, play(other, 3, 3), exact=True)
        assert data_equivalence(first, play(one, 3, 3), exact=True)


def test_an_episode_has_thirty_actions_and_ends_with_the_three_measures(name):
    with gym.make(name, n_actions=4) as env:
        steps = play(env, 0, 4)[1:]

    assert [step[3] for step in steps] == [False] * (len(steps) - 1) + [True]
    assert not any(step[2] for step in steps)
    assert set(steps[-1][4]["episode_measures"]) == {"appropriateness_pct", "novelty", "diversity"}
    assert not any(steps[-2][4].get("episode_measures", {}).values()), "zeros until then, or nothing"
    assert gym.make(name).unwrapped.n_actions == 30


def kinds(info):
    return {
        name: kinds(value) if isinstance(value, dict) else (type(value), np.shape(value), np.asarray(value).dtype.kind)
        for name, value in info.items()
    }


def test_where_each_step_is_a_movement_all_infos_are_alike(attempt, name):
    """Minari and others store them as arrays; elsewhere the terms of a movement come with the movement."""
    if not name.startswith((BOXING[:-1], MENTAL[:-1])):
        return
    attempt(
        "infos", "recorded as arrays (Minari): keys, types and shapes of `reset` and `step`", "always the same", n=4
    )
    with gym.make(name, n_actions=3) as env:
        infos = [found[-1] for found in play(env, 0, 3)]
    assert all(kinds(info) == kinds(infos[0]) for info in infos)
    assert {info["memory"] for info in infos} == {"half/0"}
    assert infos[0]["outcome"] == ""


def test_measures_that_are_none_are_nan_at_the_end():
    with gym.make(MENTAL, n_actions=1) as env:
        measures = play(env, 0, 1)[1][4]["episode_measures"]
    assert np.isnan(measures["diversity"])


def test_every_reward_term_is_in_info(env):
    finished = [step for step in play(env, 1, 4)[1:] if "outcome" in step[4]]
    assert len(finished) == 4
    accepted = [step[4]["trajectory"] for step in finished if step[4]["appropriate"]]
    assert np.array_equal(env.unwrapped.repertoire, accepted)
    for observation, reward, _, _, info in finished:
        scale = reward_scale(env.unwrapped.memory.demonstrations)
        assert env.observation_space.contains(observation)
        assert info["outcome"] in ALL_OUTCOMES
        assert info["appropriate"] == (info["outcome"] in ("learned", "unlearned"))
        assert reward == info["reward_novelty"]
        assert reward == (info["known_distance"] / scale if info["appropriate"] else 0.0)
        assert info["known_distance"] <= info["distance"]
        assert info["trajectory"].shape == (50, 8)


def test_the_same_point_earns_nothing_the_second_time(env):
    """It is known by then; on the robot the encoders read exactly the same angles again."""
    env.reset()
    pb = env.unwrapped.memory.pb[3].astype(np.float32)
    first, second = throw(env, pb), throw(env, pb)

    assert first[4]["appropriate"]
    assert first[1] > 0.0
    assert second[1] == 0.0
    assert second[4]["repertoire_size"] == 2


@pytest.mark.parametrize("name", DRAWN)
def test_rgb_array_shows_the_robot(name):
    with gym.make(name, render_mode="rgb_array") as env:
        env.reset()
        guard = env.render()
        throw(env, env.unwrapped.memory.pb[1].astype(np.float32))
        punch = env.render()

    assert guard.shape == punch.shape == (480, 640, 3)
    assert guard.std() > 20
    assert np.abs(punch.astype(int) - guard).max() > 100


def test_frames_have_the_size_and_camera_asked_for():
    with gym.make(MENTAL, render_mode="rgb_array", width=64, height=48, camera_name="side") as env:
        env.reset()
        side = env.render()
    with gym.make(MENTAL, render_mode="rgb_array", width=64, height=48) as env:
        env.reset()
        close = env.render()
    assert side.shape == close.shape == (48, 64, 3)
    assert not np.array_equal(side, close)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"width": 0}, SettingsError, "`width` should be at least 1"),
        ({"height": 2.5}, SettingsError, "`height` should be a whole number"),
        ({"width": 10**6}, SettingsError, "`width` should be at most 4096"),
        ({"camera_name": "sied"}, NotFoundError, r"no camera `sied` \(did you mean `side`\?\)"),
    ],
)
def test_sizes_and_cameras_that_cannot_be_are_named(arguments, error, message):
    with pytest.raises(error, match=message):
        gym.make(MENTAL, **arguments)


@pytest.mark.parametrize("name", DRAWN)
def test_rgb_array_list_is_a_film_of_what_was_performed(name, monkeypatch):
    drawn, pixel = [], np.zeros((1, 1, 3), np.uint8)
    monkeypatch.setattr(Renderer, "frame", lambda renderer, snapshot, camera: drawn.append(snapshot) or pixel)
    with gym.make(name, render_mode="rgb_array_list") as env:
        env.reset()
        throw(env, np.zeros(2, np.float32))
        film = env.render()
        again = env.render()

    assert len(film) == len(drawn) - 1 == 148  # 49 ticks of 0.15 s in frames of 0.05 s, both ends shown
    assert max(np.abs(snapshot - drawn[0]).max() for snapshot in drawn) > 0.5, "the arms move"
    assert len(again) == 1, "the guard: what was shown is not shown again"


def test_depth_array_tells_distances():
    with gym.make(BOXING, render_mode="depth_array") as env:
        env.reset()
        guard = env.render()
        throw(env, env.unwrapped.memory.pb[1].astype(np.float32))
        punch = env.render()

    assert guard.shape == punch.shape == (480, 640)
    assert guard.dtype == np.float32
    assert 0.3 < guard.min() < np.median(guard) < 20, "metres"
    assert np.abs(punch - guard).max() > 0.05, "the arm is nearer or farther now"


def test_a_caption_is_drawn_only_if_asked_for():
    frames = []
    for overlay in (False, True):
        with gym.make(MENTAL, render_mode="rgb_array", overlay=overlay) as env:
            env.reset()
            throw(env, env.unwrapped.memory.pb[1].astype(np.float32))
            frames.append(env.render())
    clean, told = frames

    assert np.array_equal(clean[:448], told[:448]), "the caption is at the lower edge"
    assert not np.array_equal(clean, told)


def test_over_the_bank_every_episode_draws_a_memory_by_seed():
    with gym.make(MENTAL, memory="train") as env:
        drawn = [env.reset(seed=4 if k == 0 else None)[1]["memory"] for k in range(12)]
        again = [env.reset(seed=4 if k == 0 else None)[1]["memory"] for k in range(12)]
        named = env.reset(options={"memory": drawn[0]})[1]["memory"]

    assert drawn == again
    assert len(set(drawn)) > 1
    assert set(drawn) <= set(split_memories("train"))
    assert named == drawn[0]


def test_no_memory_of_the_test_split_is_in_another():
    parts = {split: set(split_memories(split)) for split in SPLITS}

    assert sum(map(len, parts.values())) == len(set.union(*parts.values())) == len(shipped_memories(None))
    assert {split: len(names) for split, names in parts.items() if "pb" in split} == {
        f"{split}-{n_pb}pb": n for n_pb in (4, 8) for split, n in (("train", 10), ("validation", 2), ("test", 4))
    }
    assert all(split_of(name) == split for split, names in parts.items() for name in names)


@pytest.mark.parametrize("n_pb", [4, 8])
@pytest.mark.parametrize("name", ["CreativeNao/BoxingMental-v1", "CreativeNao/BoxingModulation-v1", REHEARSAL])
def test_more_pb_units_and_a_hundred_movements_are_played_alike(name, n_pb):
    """Alone, imagined, and in a vector environment over the bank."""
    arguments = {"memory": f"test-{n_pb}pb", "n_actions": 100, "n_imagined": 200}
    rng = np.random.default_rng(0)
    with gym.make(name, **arguments) as env, closing(gym.make_vec(name, 2, **arguments)) as envs:
        n = n_pb + (name == REHEARSAL)
        assert env.action_space.shape == (n,)
        env.reset(seed=3)
        memory = envs.reset(seed=3)[1]["memory"][0]
        assert memory in split_memories(f"test-{n_pb}pb")
        assert env.unwrapped.memory.pb.shape == (6, n_pb)
        for _ in range(12):
            actions = rng.uniform(-1, 1, (2, n)).astype(np.float32)
            if name != REHEARSAL:
                imagined = env.unwrapped.imagine(actions[0, :n_pb])
            observation, reward, *_, info = env.step(actions[0])
            seen, rewards, *_ = envs.step(actions)
            assert np.array_equal(observation, seen[0])
            assert reward == rewards[0]
            assert observation in env.observation_space
            if "Mental" in name:
                assert reward == imagined["reward_novelty"]
                assert np.array_equal(imagined["trajectory"], info["trajectory"])
        assert env.spec.max_episode_steps == {"Mental-v1": 100, "Modulation-v1": 1000, "Rehearsal-v0": 200}[name[18:]]


def test_cells_of_eight_units_are_refused():
    with pytest.raises(
        SettingsError, match=r'"cells" has 8 cells a PB unit, 8\^8 for this memory of 8 units; take a -v1'
    ):
        gym.make(MENTAL, memory="half-8pb/0")


def test_in_an_episode_of_a_hundred_movements_every_one_is_observed():
    with gym.make("CreativeNao/BoxingMental-v1", n_actions=100) as env:
        last = play(env, 0, 100)[-1][0]
        parts = split(last, env.unwrapped.observation_parts, env.unwrapped.try_columns)
        assert parts["tries"].shape == (100, 19)
        assert parts["tries"][:, 0].all()
        assert len(env.unwrapped.repertoire) > 40


def test_a_memory_of_another_part_is_refused():
    with gym.make(MENTAL, memory="train") as env, pytest.raises(NotFoundError, match="half/15"):
        env.reset(options={"memory": "half/15"})


@pytest.mark.parametrize("wrong", ["size", "nan"])
def test_an_action_that_is_no_pb_vector_is_named(env, wrong):
    env.reset()
    n = env.action_space.shape[0]
    action = np.zeros(n + 1, np.float32) if wrong == "size" else np.full(n, np.nan, np.float32)

    with pytest.raises(ShapeError, match=rf"`action` should be a finite PB vector of shape \({n},\)"):
        env.unwrapped.step(action)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"memory": "hlf/0"}, NotFoundError, "did you mean `half/0`"),
        ({"n_actions": 0}, SettingsError, "`n_actions` should be at least 1, but is 0"),
    ],
)
def test_bad_arguments_are_named(name, arguments, error, message):
    with pytest.raises(error, match=message):
        gym.make(name, **arguments)


def test_an_unknown_render_mode_is_named(name):
    with pytest.raises(SettingsError, match=r"`render_mode` should be one of human, rgb_array, .* but is 'ansi'"):
        gym.envs.registration.load_env_creator(ENVIRONMENTS[name])(render_mode="ansi")


def test_importing_the_package_loads_neither_torch_nor_mujoco():
    import subprocess
    import sys

    code = "import sys, gymnasium, creative_nao; print(sorted({'torch', 'mujoco', 'numba'} & set(sys.modules)))"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert answer.stdout.strip() == "[]"


def test_public_names_are_there():
    for public in creative_nao.__all__:
        assert getattr(creative_nao, public) is not None
