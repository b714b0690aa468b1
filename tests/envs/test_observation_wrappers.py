"""The tries of an episode as an image and as rows: what stands where, alone, in vectors and for Stable-Baselines3."""

import warnings
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

from creative_nao.envs import (
    GridObservation,
    GridVectorObservation,
    SB3VecEnv,
    SetObservation,
    SetVectorObservation,
)
from creative_nao.errors import SettingsError

MENTAL, MODULATION, REHEARSAL = (f"CreativeNao/Boxing{name}" for name in ("Mental-v1", "Modulation-v1", "Rehearsal-v0"))
PAIRS = {GridObservation: GridVectorObservation, SetObservation: SetVectorObservation}


REMARKS = ".*(different from the unwrapped version|unconventional shape|is an image|image is 36x36)"
"""That these are wrappers, that rows are no vector, and that the image holds numbers from 0 to 1."""


@pytest.mark.parametrize(
    ("wrapper", "name"),
    [(wrapper, name) for wrapper in PAIRS for name in (MENTAL, REHEARSAL)] + [(SetObservation, MODULATION)],
)
def test_both_checkers_find_nothing_else_to_remark(wrapper, name):
    with warnings.catch_warnings(), wrapper(gym.make(name, n_actions=3)) as env:
        warnings.filterwarnings("ignore", REMARKS)
        check_env(env, skip_render_check=True)
        check_env_of_sb3(env)


def test_the_image_shows_every_try_where_it_lies():
    """PB (0.5, -1) is column 24 of row 0 of 33."""
    with GridObservation(gym.make(MENTAL), resolution=33) as env:
        image, _ = env.reset()
        channel = {name: k for k, name in enumerate(env.view.channels)}
        points = np.argwhere(image[channel["points"]])
        assert image.shape == (11, 33, 33) == (len(channel), 33, 33)
        assert points.tolist() == sorted(np.rint((env.unwrapped.memory.pb[:, ::-1] + 1) * 16).astype(int).tolist())
        assert not image[:9].any()
        assert not image[channel["step"]].any()
        pb = np.array([0.5, -1.0], np.float32)
        image, reward, *_, info = env.step(pb)
        scale = env.unwrapped._batch.archive.scale[0]

    assert np.argwhere(image[0]).tolist() == [[0, 24]]
    assert image[channel["appropriate"], 0, 24] == info["appropriate"]
    assert image[channel["reward"], 0, 24] == pytest.approx(reward / (reward + 1.0))
    distances = info["basic_distances"] / scale
    np.testing.assert_allclose(image[channel["distances_0"] :][:6, 0, 24], distances / (distances + 1.0), rtol=1e-6)
    assert (image[channel["step"]] == np.float32(1 / 30)).all()


def test_the_track_decides_the_channels():
    channels = {
        track: GridObservation(gym.make(MENTAL, observation=track)).view.channels for track in ("outcomes", "points")
    }

    assert channels["outcomes"] == ["tried", "appropriate", "reward", "step"]
    assert channels["points"] == ["tried", "appropriate", "reward", "points", "step"]


@pytest.mark.parametrize("name", [MENTAL, REHEARSAL, MODULATION])
def test_rows_are_those_of_the_flat_observation(name):
    with SetObservation(gym.make(name, n_actions=2)) as env, gym.make(name, n_actions=2) as flat:
        env.reset(seed=0)
        flat.reset(seed=0)
        for k in range(3):
            action = np.full(env.action_space.shape, 0.1 * k, np.float32)
            rows, plain = env.step(action)[0], flat.step(action)[0]
            if env.unwrapped.n_decisions == 1 and k == 1:
                break
        parts = {part.name: plain[part.start : part.stop] for part in env.unwrapped.observation_parts}

    assert rows.keys() - {"mask"} == parts.keys()
    assert all(np.array_equal(rows[name].ravel(), parts[name]) for name in parts)
    assert np.array_equal(rows["mask"], rows["tries"][:, 0])
    assert rows["points"].shape == (6, 2)


@pytest.mark.parametrize("single", PAIRS)
def test_vectors_show_what_single_ones_do(single, same):
    """Also at the end of an episode, in `final_obs`."""
    envs = gym.make_vec(REHEARSAL, 2, n_actions=2, n_imagined=5, autoreset_mode="SameStep")
    alone = single(gym.make(REHEARSAL, n_actions=2, n_imagined=5))
    with closing(PAIRS[single](envs)) as many, alone as env:
        assert many.single_observation_space == env.observation_space
        rng, ends = np.random.default_rng(0), 0
        seen, _ = many.reset(seed=4)
        one, _ = env.reset(seed=5)
        for _ in range(12):
            assert seen in many.observation_space
            last = {name: array[1] for name, array in seen.items()} if isinstance(seen, dict) else seen[1]
            assert same(last, one)
            actions = rng.uniform(-1, 1, (2, 3)).astype(np.float32)
            seen, _, _, over, infos = many.step(actions)
            one, *_ = env.step(actions[1])
            if over[1]:
                assert same(infos["final_obs"][1], one)
                one, ends = env.reset()[0], ends + 1

    assert ends >= 2


@pytest.mark.slow
def test_stable_baselines3_trains_on_rows_and_images():
    from stable_baselines3 import PPO

    envs = [gym.make_vec(REHEARSAL, 2, n_imagined=6, autoreset_mode="SameStep") for _ in range(2)]
    arguments = {"n_steps": 8, "batch_size": 8, "n_epochs": 1, "device": "cpu"}
    with closing(SB3VecEnv(SetVectorObservation(envs[0]))) as env:
        PPO("MultiInputPolicy", env, **arguments).learn(16)
    with closing(SB3VecEnv(GridVectorObservation(envs[1], resolution=36))) as env:
        PPO("CnnPolicy", env, policy_kwargs={"normalize_images": False}, **arguments).learn(16)


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("CreativeNao/BoxingMental-v0", {}, "`env` should observe every try"),
        ("CartPole-v1", {}, "`env` should observe every try"),
        (MODULATION, {}, "this environment has 10 PB vectors a movement"),
        (MENTAL, {"memory": "half-4pb/0"}, "this environment has 4 PB units"),
    ],
)
def test_what_cannot_be_drawn_is_refused(name, arguments, message):
    with gym.make(name, **arguments) as env, pytest.raises(SettingsError, match=message):
        GridObservation(env)


@pytest.mark.parametrize("resolution", [1, 2.5, 1001, None])
def test_a_resolution_is_a_whole_number(resolution):
    with gym.make(MENTAL) as env, pytest.raises(SettingsError, match="`resolution` should be"):
        GridObservation(env, resolution=resolution)


def test_what_is_no_environment_is_named():
    with pytest.raises(SettingsError, match="`env` should be of the class"):
        GridObservation("CreativeNao/BoxingMental-v1")
