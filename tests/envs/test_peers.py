"""What other libraries and their test suites do to an environment, done to all of ours; every night.

Their packages hold Gymnasium's `env_checker`, `env_match` and `performance` and SB3's checker, which are run as they
are (dm_env's and dm_control's: `test_boxing_task.py`). The rest are our own versions of what the tests and the loops of
Gymnasium, Stable-Baselines3, Shimmy, cleanrl, pyribs, torchrl and Minari do. What is left out: docs/reliability.md.
"""

import copy
import os
import pickle
import subprocess
import sys
import sysconfig
import venv
import warnings
from contextlib import closing
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import performance
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as vector_wrappers
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    SubprocVecEnv,
    VecCheckNan,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
    VecVideoRecorder,
)

from creative_nao.envs import ENVIRONMENTS, SB3VecEnv

pytestmark = pytest.mark.slow
MENTAL = "CreativeNao/BoxingMental-v0"
SMALL = {"width": 32, "height": 24}
STARTS = [method for method in ("fork", "spawn", "forkserver") if hasattr(os, "fork") or method == "spawn"]


@pytest.fixture(params=ENVIRONMENTS)
def name(request):
    return request.param


def arguments(name):
    """Short episodes: two movements, or eight imagined ones."""
    return {"n_actions": 2, **({"n_imagined": 8} if "Rehearsal" in name else {})}


def made(name, **more):
    return gym.make(f"creative_nao:{name}", **arguments(name), **more)


def play(env, n_episodes=2, seed=0):
    """Play random episodes to their ends; return all that came back."""
    env.action_space.seed(seed)
    found = []
    for _ in range(n_episodes):
        found.append(env.reset(seed=seed))
        ended = False
        while not ended:
            found.append(env.step(env.action_space.sample()))
            ended = found[-1][2] or found[-1][3]
    return found


# What their packages hold.


def test_gymnasiums_checker_as_made(attempt, name):
    attempt("peers' suites", "Gymnasium: env_checker", "no remark", n=2)
    for env in (made(name), gym.make(name, disable_env_checker=True)):  # a warning is an error in all our tests
        check_env(env.unwrapped)
        env.close()


def test_two_environments_match(attempt, name):
    attempt("peers' suites", "Gymnasium: env_match, two environments, one remade from its spec", "equal", n=2)
    with made(name, render_mode="rgb_array", **SMALL) as one, made(name, render_mode="rgb_array", **SMALL) as other:
        remade = gym.make(EnvSpec.from_json(one.spec.to_json()))
        one_episode = 2 * one.unwrapped.n_decisions
        for two in (other, remade):
            check_environments_match(one, two, one_episode - 1)
            # Gymnasium holds NaN for unlike NaN, and measures of an episode may be undefined at its end.
            check_environments_match(one, two, 2 * one_episode + 1, info_comparison="keys-equivalence")
        remade.close()


def test_gymnasiums_measurements_run(attempt, name):
    attempt("peers' suites", "Gymnasium: performance (step, vector step, init, render)", "measured", n=4)
    with made(name, render_mode="rgb_array", **SMALL) as env:
        assert performance.benchmark_step(env, target_duration=0.3, seed=0) > 0
        assert performance.benchmark_render(env, target_duration=0.3) > 0
    assert performance.benchmark_init(lambda: made(name), target_duration=0.3) > 0
    with closing(gym.make_vec(name, 2, **arguments(name))) as envs:
        assert performance.benchmark_vector_step(envs, target_duration=0.3, seed=0) > 0


def test_sb3s_checker_as_made_and_wrapped(attempt, name):
    attempt("peers' suites", "Stable-Baselines3: check_env, also in Monitor", "no remark", n=2)
    for env in (made(name, render_mode="rgb_array", **SMALL), Monitor(made(name))):
        check_env_of_sb3(env)
        env.close()


# Gymnasium: wrappers one by one, vector wrappers, processes.

ON_IMAGES = {"AtariPreprocessing", "GrayscaleObservation", "ResizeObservation"}
LEFT_OUT = {
    *ON_IMAGES,
    "FilterObservation",  # of dictionaries
    "HumanRendering",  # opens a window
    "RecordVideo",  # below, in an environment of its own
    "ArrayConversion",
    "JaxToNumpy",
    "JaxToTorch",  # for environments that compute in JAX
    "vector",
}
WRAPPERS = {
    "DelayObservation": {"delay": 1},
    "DtypeObservation": {"dtype": np.float64},
    "DiscretizeObservation": {"bins": 3, "multidiscrete": True},
    "FlattenObservation": {},
    "FrameStackObservation": {"stack_size": 3},
    "TransformObservation": {"func": lambda seen: seen, "observation_space": None},
    "MaxAndSkipObservation": {"skip": 2},
    "NormalizeObservation": {},
    "AddRenderObservation": {"render_only": True},
    "ReshapeObservation": {"shape": (-1, 1)},
    "RescaleObservation": {"min_obs": 0, "max_obs": 1},
    "TimeAwareObservation": {},
    "ClipAction": {},
    "DiscretizeAction": {"bins": 3, "multidiscrete": True},
    "TransformAction": {"func": lambda action: action, "action_space": None},
    "RescaleAction": {"min_action": 0, "max_action": 1},
    "StickyAction": {"repeat_action_probability": 0.5},
    "RepeatAction": {"num_repeats": 2},
    "ClipReward": {"min_reward": 0, "max_reward": 1},
    "TransformReward": {"func": lambda reward: 2 * reward},
    "NormalizeReward": {},
    "TimeLimit": {"max_episode_steps": 2},
    "Autoreset": {},
    "PassiveEnvChecker": {},
    "OrderEnforcing": {},
    "RecordEpisodeStatistics": {},
    "AddWhiteNoise": {"probability_of_noise_per_pixel": 0.5},
    "ObstructView": {"obstructed_pixels_ratio": 0.5, "obstruction_width": 4},
    "RenderCollection": {},
    "NumpyToTorch": {},
}


def test_every_wrapper_is_tried_or_left_out_with_a_reason():
    assert set(wrappers.__all__) == set(WRAPPERS) | LEFT_OUT


OVERFLOW = pytest.mark.filterwarnings("ignore:overflow encountered in cast")  # DtypeObservation's bounds


@OVERFLOW
@pytest.mark.parametrize("wrapper", WRAPPERS)
def test_a_wrapper_plays_and_is_copied(attempt, wrapper):
    case = f"Gymnasium: {len(WRAPPERS)} wrappers around each environment, played to the end"
    attempt("peers' suites", case, "spaces hold, copies agree", n=len(ENVIRONMENTS))
    for name in ENVIRONMENTS:
        play_wrapped(name, wrapper)


def play_wrapped(name, wrapper):
    settings = dict(WRAPPERS[wrapper])
    inner = made(name, render_mode="rgb_array", **SMALL)
    if wrapper == "ReshapeObservation":
        settings["shape"] = (inner.observation_space.shape[0], 1)
    env = getattr(wrappers, wrapper)(inner, **settings)
    if wrapper == "NumpyToTorch":
        import torch

        observation, _ = env.reset(seed=0)
        stepped = env.step(torch.zeros(inner.action_space.shape))
        assert observation.shape == stepped[0].shape == inner.observation_space.shape
        env.close()
        return
    for found in play(env):
        assert env.observation_space.contains(found[0]), (name, wrapper)
        assert isinstance(found[-1], dict)
    twin = copy.deepcopy(env)
    action = env.action_space.sample()
    if wrapper not in ("StickyAction", "AddWhiteNoise", "ObstructView", "NormalizeObservation"):
        env.reset(seed=1)
        twin.reset(seed=1)
        assert np.array_equal(env.step(action)[0], twin.step(action)[0])
    twin.close()
    env.close()


VECTOR_LEFT_OUT = {
    *(ON_IMAGES - {"AtariPreprocessing"}),
    "FilterObservation",
    "HumanRendering",
    "RecordVideo",
    "ArrayConversion",
    "JaxToNumpy",
    "JaxToTorch",
}
VECTOR_WRAPPERS = {
    "VectorizeTransformObservation": {"wrapper": wrappers.FlattenObservation},
    "VectorizeTransformAction": {"wrapper": wrappers.ClipAction},
    "VectorizeTransformReward": {"wrapper": wrappers.ClipReward, "min_reward": 0, "max_reward": 1},
    "DictInfoToList": {},
    "TransformObservation": {"func": lambda seen: seen},
    "FlattenObservation": {},
    "ReshapeObservation": {"shape": None},
    "RescaleObservation": {"min_obs": 0, "max_obs": 1},
    "DtypeObservation": {"dtype": np.float64},
    "NormalizeObservation": {},
    "TransformAction": {"func": lambda actions: actions},
    "ClipAction": {},
    "RescaleAction": {"min_action": 0, "max_action": 1},
    "TransformReward": {"func": lambda rewards: 2 * rewards},
    "ClipReward": {"min_reward": 0, "max_reward": 1},
    "NormalizeReward": {},
    "RecordEpisodeStatistics": {},
    "NumpyToTorch": {},
}


def test_every_vector_wrapper_is_tried_or_left_out_with_a_reason():
    assert set(vector_wrappers.__all__) == set(VECTOR_WRAPPERS) | VECTOR_LEFT_OUT


@OVERFLOW
@pytest.mark.parametrize(
    ("wrapper", "mode"),
    [
        (wrapper, mode)
        for wrapper in VECTOR_WRAPPERS
        for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)
        if mode is AutoresetMode.NEXT_STEP or "Observation" not in wrapper  # Gymnasium refuses those itself
    ],
)
def test_a_vector_wrapper_plays(attempt, wrapper, mode):
    case = f"Gymnasium: {len(VECTOR_WRAPPERS)} vector wrappers around each, through ends of episodes"
    attempt("peers' suites", case, "spaces hold", n=len(ENVIRONMENTS))
    for name in ENVIRONMENTS:
        play_vector_wrapped(name, wrapper, mode)


def play_vector_wrapped(name, wrapper, mode):
    made_vector = gym.make_vec(name, 2, autoreset_mode=mode, **arguments(name))
    settings = dict(VECTOR_WRAPPERS[wrapper])
    if wrapper == "ReshapeObservation":
        settings["shape"] = (made_vector.single_observation_space.shape[0], 1)
    envs = getattr(vector_wrappers, wrapper)(made_vector, **settings)
    envs.action_space.seed(0)
    observations, _ = envs.reset(seed=0)
    ended = 0
    for _ in range(12 if made_vector.n_decisions == 1 else 44):
        actions = envs.action_space.sample()
        if wrapper == "NumpyToTorch":
            import torch

            actions = torch.from_numpy(actions)
        observations, _, _, truncated, infos = envs.step(actions)
        ended += int(truncated.sum())
        if wrapper == "NumpyToTorch":
            observations = observations.numpy()
        assert envs.observation_space.contains(observations)
        assert isinstance(infos, list if wrapper == "DictInfoToList" else dict)
    assert ended >= 2
    envs.close()


@pytest.mark.parametrize("start", STARTS)
def test_gymnasiums_processes(attempt, name, start, same):
    attempt("peers' suites", f"Gymnasium: AsyncVectorEnv by {start}", "the results of SyncVectorEnv")
    found = []
    for mode, kwargs in (("sync", {}), ("async", {"context": start, "shared_memory": start != "spawn"})):
        envs = gym.make_vec(f"creative_nao:{name}", 2, vectorization_mode=mode, vector_kwargs=kwargs, **arguments(name))
        envs.action_space.seed(0)
        found.append([envs.reset(seed=1), *(envs.step(envs.action_space.sample()) for _ in range(5))])
        assert len(envs.call("get_state")) == 2
        envs.close()
    assert same(*found)


# Stable-Baselines3: vector environments, wrappers, a whole life.


@pytest.mark.parametrize("start", STARTS)
def test_sb3s_processes(attempt, start):
    attempt("peers' suites", f"Stable-Baselines3: SubprocVecEnv by {start}", "the results of DummyVecEnv")
    rewards = []
    for kind, kwargs in ((DummyVecEnv, {}), (SubprocVecEnv, {"start_method": start})):
        env = make_vec_env(
            f"creative_nao:{MENTAL}", 2, seed=1, vec_env_cls=kind, vec_env_kwargs=kwargs, env_kwargs=arguments(MENTAL)
        )
        env.reset()
        rewards.append([env.step(np.full((2, 2), 0.3 * k, np.float32))[1] for k in range(3)])
        env.close()
    np.testing.assert_allclose(*rewards, rtol=1e-6)  # one of them keeps float32


@pytest.mark.parametrize("native", [True, False])
def test_a_life_in_sb3(attempt, name, native, tmp_path):
    attempt("peers' suites", "Stable-Baselines3: wrapped, trained, saved, loaded, evaluated", "works", n=1)
    kwargs = arguments(name)
    envs = VecMonitor(SB3VecEnv(name, 2, **kwargs)) if native else make_vec_env(name, 2, env_kwargs=kwargs)
    envs = VecNormalize(VecFrameStack(VecCheckNan(envs, raise_exception=True), 2))
    model = PPO("MlpPolicy", envs, n_steps=16, batch_size=16, n_epochs=1, device="cpu", seed=0)
    model.learn(64)
    assert model.ep_info_buffer
    model.save(tmp_path / "model.zip")
    envs.save(str(tmp_path / "normal.pkl"))
    again = PPO.load(tmp_path / "model.zip", env=envs, device="cpu")
    observation = envs.reset()
    assert np.array_equal(
        again.predict(observation, deterministic=True)[0], model.predict(observation, deterministic=True)[0]
    )
    mean, _ = evaluate_policy(again, envs, n_eval_episodes=2)
    assert np.isfinite(mean)
    envs.close()


# Loops of other libraries.


def test_a_loop_of_cleanrl(attempt, name):
    attempt("peers' suites", "cleanrl: its stack of wrappers in a SyncVectorEnv, returns of episodes read", "works")

    def thunk():
        env = wrappers.RecordEpisodeStatistics(wrappers.FlattenObservation(made(name)))
        env = wrappers.NormalizeObservation(wrappers.ClipAction(env))
        env = wrappers.TransformObservation(env, lambda seen: np.clip(seen, -10, 10), env.observation_space)
        return wrappers.TransformReward(wrappers.NormalizeReward(env), lambda reward: np.clip(reward, -10, 10))

    with closing(gym.vector.SyncVectorEnv([thunk] * 2)) as envs:
        envs.reset(seed=1)
        told = []
        for _ in range(22):
            infos = envs.step(envs.action_space.sample())[4]
            if "episode" in infos:
                told += infos["episode"]["r"][infos["_episode"]].tolist()
        assert told
        assert np.isfinite(told).all()


def test_a_scheduler_loop_of_pyribs(attempt):
    attempt("peers' suites", "pyribs: an archive filled by a scheduler from a vector environment", "works")
    archives = pytest.importorskip("ribs.archives")
    from ribs.emitters import EvolutionStrategyEmitter
    from ribs.schedulers import Scheduler

    archive = archives.GridArchive(solution_dim=2, dims=(10, 10), ranges=[(0.0, 40.0), (0.0, 40.0)])
    scheduler = Scheduler(
        archive, [EvolutionStrategyEmitter(archive, x0=[0.0, 0.0], sigma0=0.5, batch_size=16, seed=0)]
    )
    with closing(gym.make_vec(MENTAL, 16)) as envs:
        envs.reset(seed=0)
        for _ in range(5):
            points = np.clip(scheduler.ask(), -1, 1).astype(np.float32)
            _, rewards, _, _, infos = envs.step(points)
            scheduler.tell(rewards, np.stack([infos["distance"], infos["known_distance"]], axis=1))
    assert archive.stats.num_elites > 0


def test_tensors_of_torchrl(attempt, name):
    attempt(
        "peers' suites", "torchrl: everything numeric becomes a tensor of the declared kind, rollouts repeat", "works"
    )
    import torch

    rollouts = []
    for _ in range(2):
        with made(name) as env:
            steps = play(env, n_episodes=1, seed=3)
            rollouts.append(torch.stack([torch.from_numpy(found[0]) for found in steps]))
            for found in steps:
                tensor = torch.from_numpy(found[0])  # warns, which is an error here, if it may not be written to
                assert tensor.dtype == torch.float32
                numeric = {k: v for k, v in found[-1].items() if isinstance(v, np.ndarray) and v.dtype.kind in "fiub"}
                assert all(torch.as_tensor(value).shape == value.shape for value in numeric.values())
    assert torch.equal(*rollouts)


def test_columns_of_minari(attempt, name):
    attempt("peers' suites", "Minari: an episode as columns of arrays, infos where each step is a movement", "recorded")
    with made(name) as env:
        steps = play(env, n_episodes=1)
    assert np.stack([found[0] for found in steps]).dtype == np.float32
    if "Modulation" in name or "Rehearsal" in name:
        return
    for key, value in steps[0][-1].items():
        column = [found[-1][key] for found in steps]
        if not isinstance(value, dict):
            assert np.asarray(column).dtype.kind in "fiubU", key


def test_minari_itself_records_an_episode(attempt, monkeypatch, tmp_path):
    for module in ("minari", "h5py", "jax"):
        pytest.importorskip(module)
    attempt("peers' suites", "Minari: DataCollector with infos", "recorded")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    from minari import DataCollector

    env = DataCollector(made(MENTAL), record_infos=True)
    play(env)
    env.reset(options={"minari_autoseed": False})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dataset = env.create_dataset(
            "creative/boxing-v0", algorithm_name="random", code_permalink="x", author="x", author_email="a@b.c",
            description="x",
        )  # fmt: skip
    assert [len(episode.rewards) for episode in dataset] == [2, 2]
    assert dataset[0].infos["trajectory"].shape == (3, 50, 8)


def test_shimmys_view_of_the_dm_control_task(attempt):
    """Shimmy turns specs into spaces, seeds the generator of the environment and renders its physics."""
    pytest.importorskip("dm_control", reason="pip cannot install it on Python 3.13")
    attempt("peers' suites", "Shimmy: the dm_control task behind Gymnasium's interface", "spaces hold, seeds repeat")
    from creative_nao.envs import load

    env = load("boxing", start_noise_rad=0.05)
    spec = env.action_spec()
    actions = gym.spaces.Box(spec.minimum, spec.maximum, spec.shape, spec.dtype)
    spaces = gym.spaces.Dict(
        {name: gym.spaces.Box(-np.inf, np.inf, one.shape, one.dtype) for name, one in env.observation_spec().items()}
    )
    seen = []
    for _ in range(2):
        env.random_state.seed(4)
        actions.seed(4)
        steps = [env.reset(), *(env.step(actions.sample()) for _ in range(20))]
        assert all(spaces.contains(dict(step.observation)) for step in steps)
        seen.append(np.concatenate([step.observation["nao/joint_positions"] for step in steps]))
    assert np.array_equal(*seen)
    assert env.physics.render(24, 32, camera_id=0).shape == (24, 32, 3)


def test_saved_and_loaded_wrapped_environments_go_on_alike(attempt, name, tmp_path):
    attempt(
        "peers' suites", "pickle, cloudpickle and deepcopy of a wrapped environment in an episode", "goes on alike", n=3
    )
    import cloudpickle

    env = wrappers.RecordEpisodeStatistics(made(name))
    env.reset(seed=2)
    env.step(env.action_space.sample())
    path = tmp_path / "state.safetensors"
    env.unwrapped.get_state().save(path)
    copies = [pickle.loads(pickle.dumps(env)), pickle.loads(cloudpickle.dumps(env)), copy.deepcopy(env)]
    action = env.action_space.sample()
    expected = env.step(action)[0]
    for other in copies:
        assert np.array_equal(other.step(action)[0], expected)
        other.close()
    assert path.stat().st_size > 0
    env.close()


VIDEO = """
import sys, gymnasium as gym, numpy as np, creative_nao
from gymnasium.wrappers import RecordVideo, vector
from stable_baselines3.common.vec_env import VecVideoRecorder
from creative_nao.envs import SB3VecEnv
out, name, small = sys.argv[1], "CreativeNao/BoxingMental-v0", {"width": 64, "height": 48, "n_actions": 3}
env = RecordVideo(gym.make(name, render_mode="rgb_array", **small), out + "/one")
envs = gym.make_vec(name, 2, render_mode="rgb_array", **small)
envs = vector.RecordVideo(envs, out + "/many", episode_trigger=lambda k: True)
for each, n in ((env, 3), (envs, 5)):
    each.reset(seed=0)
    for _ in range(n):
        each.step(each.action_space.sample())
    each.close()
sb3 = VecVideoRecorder(
    SB3VecEnv(name, 2, render_mode="rgb_array", **small), out + "/sb3", lambda k: k == 0, video_length=5
)
sb3.reset()
for _ in range(6):
    sb3.step(np.zeros((2, 2), np.float32))
sb3.close()
"""


def test_videos_are_recorded_with_the_documented_install_line(attempt, tmp_path):
    """In an environment of its own, beside the packages of this one: moviepy asks for an older pillow."""
    attempt(
        "peers' suites", "RecordVideo, its vector form and VecVideoRecorder after `pip install moviepy`", "MP4 files"
    )
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python"
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    folder = subprocess.run([python, "-c", ask], capture_output=True, text=True, check=True).stdout.strip()
    root = Path(__file__).parents[2]
    (Path(folder) / "zz_these.pth").write_text(
        f"{sysconfig.get_path('purelib')}\n{root}\n"
    )  # after what moviepy brings
    subprocess.run([python, "-m", "pip", "install", "-q", "moviepy"], check=True, capture_output=True)
    done = subprocess.run([python, "-c", VIDEO, str(tmp_path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    films = {path.parent.name for path in tmp_path.glob("*/*.mp4") if path.read_bytes()[4:8] == b"ftyp"}
    assert films == {"one", "many", "sb3"}


def test_without_moviepy_gymnasium_says_so(monkeypatch, tmp_path):
    """The docs name our own way beside this very message."""
    monkeypatch.setitem(sys.modules, "moviepy", None)
    with made(MENTAL, render_mode="rgb_array") as env:
        with pytest.raises(gym.error.DependencyNotInstalled, match="moviepy is not installed"):
            wrappers.RecordVideo(env, str(tmp_path))
        with pytest.raises(gym.error.DependencyNotInstalled, match="MoviePy is not installed"):
            VecVideoRecorder(SB3VecEnv(MENTAL, 1, render_mode="rgb_array"), str(tmp_path), lambda step: True)
    faq = (Path(__file__).parents[2] / "docs" / "faq.md").read_text(encoding="utf-8")
    assert "moviepy is not installed" in faq
    assert "write_mp4" in faq
