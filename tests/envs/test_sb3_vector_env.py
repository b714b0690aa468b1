"""`SB3VecEnv` answers copy by copy, as Stable-Baselines3's own `DummyVecEnv` does with the single environments."""

from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from creative_nao.envs import SB3VecEnv
from creative_nao.errors import NotFoundError, SettingsError

MENTAL = "CreativeNao/BoxingMental-v0"


@pytest.fixture
def both():
    """Three copies that draw their memories: ours, and those of Stable-Baselines3."""
    with (
        closing(SB3VecEnv(MENTAL, 3, memory="train", n_actions=2)) as ours,
        closing(make_vec_env(MENTAL, 3, env_kwargs={"memory": "train", "n_actions": 2})) as theirs,
    ):
        yield ours, theirs


@pytest.mark.parametrize(
    "options",
    [
        [{"memory": "open/3"}, {"memory": "closed/4"}, {"memory": "half/2"}],
        [{}, {"memory": "half/6"}, {}],
        {"memory": "open/2"},
        None,
    ],
)
def test_options_and_seeds_go_to_the_copy_they_are_for(attempt, both, options):
    attempt("SB3VecEnv", "`set_options` and `seed`, one for each copy", "each copy gets its own", n=3)
    found = []
    for env in both:
        env.seed(7)
        env.set_options(options)
        env.reset()
        found.append([info["memory"] for info in env.reset_infos])
        env.reset()
        found[-1] += [info["memory"] for info in env.reset_infos]
    assert found[0] == found[1], "also what is drawn after options and seeds are used up"


def test_options_that_do_not_fit_are_named(both):
    ours, _ = both
    ours.set_options([{"memory": "open/3"}])
    with pytest.raises(SettingsError, match="`options` should be 3, one a copy, but are 1"):
        ours.reset()
    ours.set_options([{}, {"memory": "hlf/0"}, {}])
    with pytest.raises(NotFoundError, match="no memory `hlf/0`"):
        ours.reset()


def test_attributes_and_methods_are_those_of_each_copy(attempt, both, same):
    attempt("SB3VecEnv", "`get_attr`, `env_method`, `set_attr` with and without `indices`", "as in DummyVecEnv", n=6)
    found = []
    for env in both:
        env.seed(3)
        env.reset()
        env.step(np.zeros((3, 2), np.float32))
        (state,) = env.env_method("get_state", indices=[1])
        env.env_method("set_state", state, indices=0)
        env.set_attr("note", "x", indices=[2])
        found.append(
            {
                "memories": [memory.name for memory in env.get_attr("memory", indices=[0, 2])],
                "sizes": [len(repertoire) for repertoire in env.get_attr("repertoire")],
                "states": [state.values for state in env.env_method("get_state")],
                "observed": [env.env_method("get_state", indices=k)[0].arrays["observation"] for k in (0, 1)],
                "note": env.get_attr("note", indices=2),
                "has": (env.has_attr("repertoire"), env.has_attr("nothing"), env.has_attr("note")),
                "began": env.env_method("reset", seed=5, options={"memory": "half/3"}, indices=[1])[0][1]["memory"],
                "class": [type(one).__name__ for one in env.get_attr("unwrapped")],
            }
        )
    assert same(found[0], found[1])
    assert np.array_equal(*found[0]["observed"]), "the state of copy 1 went to copy 0"


def test_wrappers_are_not_claimed(both):
    ours, _ = both
    assert ours.env_is_wrapped(RecordEpisodeStatistics) == [False] * 3


def test_the_end_of_an_episode_is_told_in_its_last_step(attempt, same):
    attempt("SB3VecEnv", "`episode` of RecordEpisodeStatistics", "in the info of the step that ended", n=2)
    made = gym.make_vec(MENTAL, 2, n_actions=2, autoreset_mode=AutoresetMode.SAME_STEP)
    plain = SB3VecEnv(MENTAL, 2, n_actions=2)
    wrapped = SB3VecEnv(RecordEpisodeStatistics(made, stats_key="told"))
    for env in (plain, wrapped):
        env.seed(0)
        env.reset()
        rewards, actions = np.zeros(2), np.array([[0.5, -0.5], [-0.3, 0.7]], np.float32)
        for k in range(2):
            _, reward, done, infos = env.step(actions * (k + 1) / 2)
            rewards += reward
        assert done.all()
        for k, info in enumerate(infos):
            assert info["episode"]["r"] == pytest.approx(rewards[k], rel=1e-6)
            assert info["episode"]["l"] == 2
            assert info["episode_measures"]["appropriateness_pct"] >= 0
            assert info["TimeLimit.truncated"]
            assert env.reset_infos[k]["memory"] == "half/0"
            assert "told" not in env.reset_infos[k]
        env.step(actions)
        _, _, done, after = env.step(actions)
        assert done.all()
        assert after[0]["episode"]["l"] == 2, "counted anew"
    assert infos[0]["told"]["r"] == infos[0]["episode"]["r"]
    wrapped.close()
    plain.close()


def test_the_end_of_a_rehearsal_is_none_of_a_time_limit():
    """Else PPO would add the value that it expects there, and an agent would commit early to get it."""
    with closing(SB3VecEnv("CreativeNao/BoxingRehearsal-v0", 2, n_imagined=2)) as env:
        env.reset()
        for _ in range(2):
            _, _, done, infos = env.step(np.full((2, 3), -0.5, np.float32))
        assert done.all()
        assert [info["TimeLimit.truncated"] for info in infos] == [False, False]


def test_the_mean_return_is_logged_without_a_monitor():
    with closing(SB3VecEnv(MENTAL, 2, n_actions=2)) as env:
        model = PPO("MlpPolicy", env, n_steps=4, batch_size=4, n_epochs=1, device="cpu", seed=0)
        model.learn(8)
        assert len(model.ep_info_buffer) == 4
        assert all(one["l"] == 2 for one in model.ep_info_buffer)


def test_gymnasiums_own_vector_environments_are_taken_too():
    kwargs = {"autoreset_mode": AutoresetMode.SAME_STEP}
    made = gym.make_vec(MENTAL, 2, vectorization_mode="sync", vector_kwargs=kwargs, memory="train", n_actions=2)
    with closing(SB3VecEnv(made)) as env:
        env.set_options([{"memory": "half/4"}, {}])
        env.reset()
        assert env.reset_infos[0]["memory"] == "half/4"
        assert [memory.name for memory in env.get_attr("memory")] == [info["memory"] for info in env.reset_infos]
        assert env.env_is_wrapped(gym.wrappers.OrderEnforcing) == [True, True]
