"""One good file of every kind that a user can hand in, with its loader: what the hostile tests and the fuzzer break.

`READERS` lists every module of the package that reads a file, with the kinds that try it: a new one without an entry
fails `test_every_reader_is_tried`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from creative_nao import exchange, load_agent
from creative_nao.agents.body_sense import N_FEATURES, BodySense, SenseHeader, SenseSettings
from creative_nao.agents.bundle import BundleHeader, save_bundle
from creative_nao.agents.callbacks import read_log
from creative_nao.agents.learned_map.episodes import SimulatedEpisode, random_warp
from creative_nao.agents.learned_map.truth import MemoryTruth, memory_truth
from creative_nao.agents.resume import ResumeState as AgentState
from creative_nao.agents.resume import TrainingRecord
from creative_nao.agents.resume import load_checkpoint as load_agent_checkpoint
from creative_nao.agents.resume import save_checkpoint as save_agent_checkpoint
from creative_nao.agents.settings import check_entry, read_hyperparameters
from creative_nao.agents.training import PPOSettings
from creative_nao.demonstrations import Demonstrations, load_demonstrations, load_take, propose_cuts
from creative_nao.demonstrations.files import load_trajectory, save_trajectory
from creative_nao.demonstrations.take import LANDMARKS
from creative_nao.envs import EnvState
from creative_nao.envs.physical_map import FIGURES, PhysicalMap
from creative_nao.evaluation.jobs import Job, read_result, read_spec, write_result, write_spec
from creative_nao.evaluation.leaderboard import with_record
from creative_nao.evaluation.results import read_results, write_results
from creative_nao.evaluation.run import read_record, write_record
from creative_nao.evaluation.suites import read_suite
from creative_nao.explorer.favourites import Favourite, Session
from creative_nao.explorer.run_episodes import RunEpisodes
from creative_nao.maps import PBMap, pb_grid
from creative_nao.model import Memory, NetworkSettings, TrainingSettings, train_network
from creative_nao.model.training import TrainingState, load_checkpoint, save_checkpoint
from creative_nao.storage import write_json

NETWORK = NetworkSettings(layer_sizes=(3,), time_constants=(2.0,), n_softmax_units=2)
TRAINING = TrainingSettings(n_epochs=1)
ENV = "CreativeNao/BoxingMental-v0"
PLAN = {"env": ENV, "seed": 0}

TENSORS = ("memory", "checkpoint", "bundle", "zoo_bundle", "state", "agent_checkpoint", "truth", "body_sense")
ARCHIVES = ("map", "physical", "unfinished", "motion_npz")
JSONS = ("session", "record", "results", "published", "job", "job_result", "taught", "motion_json", "motion_ros_json")
TABLES = ("csv", "motion_csv", "episodes", "training_log")
TEXTS = (
    *JSONS, *TABLES, "yaml", "toml", "motion_ros", "motion_states", "motion_py", "motion_program", "motion_webots",
    "motion_timeline", "motion_postures", "take_csv", "take_bvh",
)  # fmt: skip
KINDS = (*TENSORS, *ARCHIVES, *TEXTS)
FOREIGN = ("motion_states", "motion_program", "motion_timeline", "motion_postures", "take_csv", "take_bvh")
"""What other programs write; no release of this one did."""
SINCE = ("truth", "body_sense")
"""Kinds that came after release 0.1.0."""

READERS = {
    "creative_nao/agents/body_sense.py": ("body_sense",),
    "creative_nao/agents/bundle.py": ("bundle", "zoo_bundle"),
    "creative_nao/agents/learned_map/truth.py": ("truth",),
    "creative_nao/agents/settings.py": ("yaml",),
    "creative_nao/agents/resume.py": ("agent_checkpoint",),
    "creative_nao/agents/callbacks.py": ("training_log",),
    "creative_nao/demonstrations/files.py": ("csv", "taught"),
    "creative_nao/demonstrations/take.py": ("take_csv", "take_bvh"),
    "creative_nao/envs/physical_map.py": ("physical", "unfinished"),
    "creative_nao/envs/state.py": ("state",),
    "creative_nao/evaluation/run.py": ("record", "published"),
    "creative_nao/evaluation/jobs.py": ("job", "job_result"),
    "creative_nao/evaluation/results.py": ("results", "published"),
    "creative_nao/evaluation/suites.py": ("toml",),
    "creative_nao/exchange/formats.py": (
        "motion_csv",
        "motion_json",
        "motion_npz",
        "motion_ros",
        "motion_states",
        "motion_py",
        "motion_program",
        "motion_webots",
        "motion_timeline",
        "motion_postures",
    ),
    "creative_nao/explorer/favourites.py": ("session",),
    "creative_nao/explorer/run_episodes.py": ("episodes",),
    "creative_nao/model/training.py": ("checkpoint",),
    "creative_nao/model/memory.py": ("memory",),
    "creative_nao/maps/map.py": ("map",),
}
"""Modules that call a reader of `storage`, `arrays` or `schema`, and the kinds that try them."""

OWN_FILES = {
    "creative_nao/agents/tuning.py": "the journal of a study, which `test_special_files.py` tries",
    "creative_nao/maps/figure_style.py": "pictures it has just drawn",
    "creative_nao/cli/dispatch.py": "the null device",
    "creative_nao/cli/doctor.py": "/proc/meminfo",
    "creative_nao/demonstrations/keyframes.py": "the punches, which ship",
    "creative_nao/envs/boxing_envs.py": "text of the environments' pages, which ships",
    "creative_nao/evaluation/oracle_sets.py": "what the oracle finds on the shipped memories, which ships",
    "creative_nao/evaluation/pages.py": "pictures it has just drawn",
    "creative_nao/evaluation/paper/claims.py": "what the paper says, which ships",
    "creative_nao/evaluation/paper/page.py": "results it has just written",
    "creative_nao/evaluation/paper/summary.py": "figures it kept, done again when they do not fit",
    "creative_nao/evaluation/runner.py": "logs of its own jobs, and what they wrote",
    "creative_nao/explorer/live_agents.py": "headers of the agents that ship",
    "creative_nao/explorer/recordings.py": "the recording it has just written",
    "creative_nao/explorer/robot_service.py": "the film it has just drawn",
    "creative_nao/explorer/server.py": "files of the page, what it has just written",
    "creative_nao/explorer/static_export.py": "files of the page",
    "creative_nao/model/memory.py": "scores that ship",
    "creative_nao/robot/postures.py": "the postures, which ship",
    "creative_nao/runtime.py": "any file, for its hash only",
}
"""Modules that open a file directly, and why no stranger's content gets in that way."""

WRITERS = (
    "creative_nao/agents/callbacks.py",
    "creative_nao/evaluation/plots.py", "creative_nao/exchange/formats.py", "creative_nao/maps/map.py",
)  # fmt: skip
"""Modules that open files to write them."""


@dataclass(frozen=True)
class Victim:
    """A good file and its loader.

    Attributes:
        path: The file.
        load: Takes a path and returns what the file holds.
        torn: Whether every shorter beginning of it is broken.
        lenient: Whether the loader returns None for a broken file, because the work is then done again.
        use: Called with what was loaded: what a file lets in has to be usable.
    """

    path: Path
    load: Callable[[Path], Any]
    torn: bool = True
    lenient: bool = False
    use: Callable[[Any], Any] = lambda loaded: None


def taught() -> Demonstrations:
    """Two short actions of one joint."""
    rise = np.linspace(0.1, 0.5, 4)[:, None]
    return Demonstrations(("rise", "fall"), [rise, rise[::-1]], 0.1, ("RElbowYaw",))


def make_victims(folder: Path) -> dict[str, Victim]:
    """Write one good file of every kind into `folder`."""
    demos = taught()
    memory = train_network(demos, TRAINING, NETWORK, command="test")
    found = {
        "memory": Victim(memory.save(folder / "memory.safetensors"), Memory.read, use=_imagine),
        "checkpoint": _checkpoint(folder / "checkpoint.safetensors", memory),
        "bundle": _bundle(folder / "bundle.safetensors"),
        "zoo_bundle": _zoo_bundle(folder / "zoo.safetensors"),
        "state": Victim(
            EnvState("Boxing", {"n": 1}, {"x": np.zeros(2)}).save(folder / "state.safetensors"), EnvState.load
        ),
        "agent_checkpoint": _agent_checkpoint(folder / "agent.safetensors"),
        "truth": Victim(
            memory_truth(memory, "rise", 4).save(folder / "rise.truth.safetensors"), MemoryTruth.load, use=_shown
        ),
        "body_sense": Victim(_sense().save(folder / "sense.safetensors"), BodySense.load, use=_refusal),
        "map": Victim(_chart().save(folder / "map.npz"), PBMap.load, use=lambda chart: chart.learned_region_pct()),
        "physical": Victim(_physical(4).save(folder / "physical.npz"), PhysicalMap.load, use=PhysicalMap.summary),
        "unfinished": Victim(
            _physical(1).save(folder / "unfinished.npz"), lambda path: PhysicalMap.load(path, unfinished=True)
        ),
        "csv": Victim(
            save_trajectory(folder / "rise.csv", demos.trajectories[0], 0.1, demos.joints),
            lambda path: load_trajectory(path, joints=demos.joints),
            torn=False,
            use=_finite,
        ),
        "taught": _taught(folder / "taught"),
        "yaml": _text(folder / "ppo.yml", YAML, lambda path: read_hyperparameters("ppo", ENV, path)),
        "toml": _text(folder / "mine.toml", TOML, read_suite),
        "session": Victim(_session(folder / "explorer.json"), lambda path: Session(path)._favourites),
        "episodes": _text(
            folder / "episodes.csv",
            EPISODES,
            lambda path: RunEpisodes(_in_place(path, "episodes.csv")).of("half/0"),
            use=lambda found: _finite(np.array([one.pb for tries in found.get("random", []) for one in tries])),
        ),
        "training_log": _text(folder / "progress.csv", "n_decisions,loss\n64,0.5\n128,0.25\n", read_log),
        **_run_folder(folder / "run"),
        **_jobs(folder / "work"),
        **_motions(folder),
        **_takes(folder),
    }
    assert set(found) == set(KINDS)
    return found


YAML = (
    f"{ENV}:\n  n_timesteps: !!float 1e4\n  n_envs: 1\n  policy: MlpPolicy\n  n_steps: 64\n  batch_size: 32\n"
    '  learning_rate: lin_0.001\n  policy_kwargs: "dict(net_arch=[8, 8], activation_fn=nn.ReLU)"\n'
)
TOML = (
    f'agents = ["random"]\nenvs = ["{ENV}"]\nmemories = ["half/0"]\nn_seeds = 2\nn_actions = 3\n[ppo]\nhidden = [8]\n'
    "[taught]\nseeds = [1]\n"
)
EPISODES = (
    "agent,env,memory,seed,step,pb_1,pb_2,outcome,reward\n"
    f"random,{ENV},half/0,0,1,0.25,-0.5,learned,0\nrandom,{ENV},half/0,0,2,0.5,0.5,unlearned,0.75\n"
)


def _shown(truth: MemoryTruth) -> None:
    episode = SimulatedEpisode(truth, random_warp(truth.form[0], np.random.default_rng(0)), np.arange(truth.form[1]))
    episode.perform_best(2, 2, np.random.default_rng(0))
    assert np.isfinite(episode.earned).all()


def _sense() -> BodySense:
    """A sense of two hidden units that has learned nothing."""
    header = SenseHeader(SenseSettings(n_hidden=2), ("half/0",), {"auc": 0.5}, {"command": "test"})
    shapes = ((N_FEATURES,), (N_FEATURES,), (N_FEATURES, 2), (2,), (2, 2), (2,), (2, 3), (3,), (3,), (3,))
    names = ("centre", "spread", "w0", "b0", "w1", "b1", "w2", "b2", "steepness", "edge")
    return BodySense(header, {name: np.ones(shape, np.float32) for name, shape in zip(names, shapes, strict=True)})


def _refusal(sense: BodySense) -> None:
    assert np.isfinite(sense.refusal(np.zeros((1, 4, 8), np.float32), 0.1)).all()


def _text(path: Path, text: str, load: Callable[[Path], Any], use: Any = lambda loaded: None) -> Victim:
    path.write_text(text, encoding="utf-8")
    return Victim(path, load, torn=False, use=use)


def _in_place(path: Path, name: str) -> Path:
    """Put a broken file of any name where its loader looks for it, and return the folder."""
    target = path.with_name(name)
    if target != path:
        target.unlink(missing_ok=True)
        target.symlink_to(path)
    return path.parent


def _imagine(memory: Memory) -> None:
    points = np.array([[-1.0, 1.0], [0.0, 0.0], [1.0, 1.0]])[:, : memory.network.n_pb]
    if points.shape[1] == memory.network.n_pb and memory.n_steps < 1_000:
        _finite(memory.generate(points))
    _finite(memory.pb)


def _finite(found: np.ndarray) -> None:
    assert np.isfinite(found).all()


def _checkpoint(path: Path, memory: Memory) -> Victim:
    n = sum(array.size for array in memory.parameters.values())
    state = TrainingState(*[np.zeros(n, dtype=np.float32)] * 4, np.ones(1), 1.0, 1)
    save_checkpoint(path, state, memory.demonstrations, NETWORK, TRAINING)
    return Victim(path, lambda path: load_checkpoint(path, memory.demonstrations, NETWORK, TRAINING))


def _act(agent: Any) -> None:
    box = agent.header.observation_space
    assert agent.header.action_space.contains(np.clip(agent.predict(box.low)[0], -1.0, 1.0))


def _bundle(path: Path) -> Victim:
    box = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    settings = PPOSettings(n_timesteps=64, n_envs=1, n_steps=64, batch_size=32, hidden=(2,))
    header = BundleHeader("ppo", settings, ENV, "half/0", 0, 64, box, box)
    return Victim(save_bundle(path, header, header.make_policy()), load_agent, use=_act)


def _zoo_bundle(path: Path) -> Victim:
    box = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    settings = check_entry("sac", {"n_timesteps": 64, "policy_kwargs": {"net_arch": [3]}}, "settings")
    header = BundleHeader("sac", settings, ENV, "half/0", 0, 64, box, box)
    return Victim(save_bundle(path, header, header.make_policy()), load_agent, use=_act)


def _agent_checkpoint(path: Path) -> Victim:
    record = TrainingRecord([10, 20], [1.0, 2.0], [0, 20], [(0.5, 1.5), (1.0, 2.0)], {"w": np.zeros(2, np.float32)})
    state = AgentState({"num_timesteps": 20}, {"last_obs": np.zeros((1, 2), np.float32)})
    save_agent_checkpoint(path, PLAN, record, state)
    return Victim(path, lambda path: load_agent_checkpoint(path, PLAN), use=lambda loaded: loaded[0].best_mean)


def _chart() -> PBMap:
    learned = np.array([[0.5, 0.5]])
    return PBMap(2, pb_grid(2), np.array(["learned"] * 4), np.zeros(4, int), np.ones(4), learned, ("rise",), {})


def _physical(n_done: int) -> PhysicalMap:
    words = np.array(["learned"] * 4)
    figures = {name: np.zeros(4, dtype=np.float32) for name in FIGURES}
    return PhysicalMap(
        resolution=2, pb=pb_grid(2), outcome=words, mental=words, fault=np.array([""] * 4), nearest=np.zeros(4, int),
        distance=np.ones(4, dtype=np.float32), figures=figures, learned_pb=np.array([[0.5, 0.5]]), names=("rise",),
        record={}, n_done=n_done, wall_s=1.0, cpu_s=1.0,
    )  # fmt: skip


def _session(path: Path) -> Path:
    Session(path).add(Favourite("abc", ((0.1, 0.2),), "a note"))
    return path


def _taught(folder: Path) -> Victim:
    save_trajectory(folder / "rise.csv", taught().trajectories[0], 0.15, ("RElbowYaw",))
    path = write_json(folder / "record.json", {"command": "teach", "seed": 1})

    def load(path: Path) -> Demonstrations:
        beside = path.with_name("rise.csv")
        if not beside.exists():
            beside.write_bytes((folder / "rise.csv").read_bytes())
        return load_demonstrations(_in_place(path, "record.json"), joints=("RElbowYaw",))

    return Victim(path, load)


def _run_folder(folder: Path) -> dict[str, Victim]:
    settings = {"suite": {"name": "quick", "n_actions": 3}, "seed": 0}
    record = {"settings": settings, "versions": {"numpy": "2", "creative-nao": "0.1.0"}, "command": "x", "seconds": 1.0}
    interval = {"mean": 1.5, "low": 1.0, "high": 2.0}
    row = {
        "agent": "random", "env": ENV, "memory": "half/0", "n_seeds": 1, "n_actions": 3, "reward": interval,
        "novelty": None, "reward_per_seed": {"0": 1.5},
    }  # fmt: skip
    versus = {"probability_of_improvement": interval, "n_memories_ahead": 1}
    entry = {
        "agent": "random", "env": ENV, "n_memories": 1, "n_seeds": 1, "n_actions_training": 0, "reward_iqm": interval,
        "reward": interval, "oracle_share": None, "versus": versus,
    }  # fmt: skip
    results = {"suite": "quick", "rows": [row], "summary": [entry], "baseline": None}
    run = write_record(folder, record)
    path = write_results(folder / "results.json", results)

    def published(path: Path) -> Any:
        beside = path.with_name("run.json")
        if not beside.exists():
            beside.write_bytes(run.read_bytes())
        return with_record(_in_place(path, "results.json"))

    return {
        "record": Victim(run, lambda path: read_record(_in_place(path, "run.json"))),
        "results": Victim(path, read_results),
        "published": Victim(path, published, use=_ranked),
    }


def _ranked(results: dict[str, Any]) -> None:
    from creative_nao.evaluation.leaderboard import leaderboard

    leaderboard({"results.json": results})


def _jobs(folder: Path) -> dict[str, Victim]:
    job = Job("play-1", "play", "judge random", {"seeds": [0]}, ("train-1",), ("a.safetensors",), ("b.npz",), 2.0)
    spec = write_spec(job, folder)
    write_result(job, folder, {"episodes": []})

    def result(path: Path) -> Any:
        place = path.parent / "held" / "jobs"
        place.mkdir(parents=True, exist_ok=True)
        target = place / "play-1.result.json"
        target.unlink(missing_ok=True)
        target.symlink_to(path)
        return read_result(job, place.parent)

    return {
        "job": Victim(spec, read_spec, use=dataclasses.asdict),
        "job_result": Victim(job.file(folder, ".result.json"), result, lenient=True),
    }


def _motions(folder: Path) -> dict[str, Victim]:
    angles = np.array([[0.1], [0.25], [0.3]])
    motion = exchange.Motion(angles, 0.15, ("RElbowYaw",), {"source": "test"})
    names = {
        "motion_csv": ("move.csv", "csv"), "motion_npz": ("move.npz", "npz"), "motion_py": ("move.py", "naoqi"),
        "motion_json": ("move.json", "json"), "motion_ros": ("move.yaml", "ros"),
        "motion_ros_json": ("ros.json", "ros"), "motion_webots": ("move.motion", "webots"),
    }  # fmt: skip
    found = {kind: (exchange.write(folder / name, motion, form).path, form) for kind, (name, form) in names.items()}
    texts = {
        "motion_states": ("states.yaml", "ros", STATES), "motion_program": ("program.py", "naoqi", PROGRAM),
        "motion_timeline": ("wave.xar", "choregraphe", TIMELINE),
        "motion_postures": ("poses.xap", "choregraphe", POSTURES),
    }  # fmt: skip
    for kind, (name, form, text) in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
        found[kind] = folder / name, form
    reading = exchange.Reading(rate=10.0)
    return {
        kind: Victim(
            path,
            lambda path, form=form, rate=reading if kind == "motion_postures" else None: exchange.read_all(
                path, joints=("RElbowYaw",), format=form, reading=rate
            ),
            torn=kind in ("motion_json", "motion_ros_json", "motion_npz", "motion_timeline", "motion_postures"),
            use=lambda recordings: [_finite(recording.motion.angles) for recording in recordings],
        )
        for kind, (path, form) in found.items()
    }


STATES = "".join(
    f"header:\n  stamp:\n    sec: 12\n    nanosec: {k}00000000\n  frame_id: ''\nname: [RElbowYaw, LElbowYaw]\n"
    f"position:\n- 0.{k}\n- -0.{k}\nvelocity: []\n---\n"
    for k in range(1, 5)
)
PROGRAM = """# -*- coding: utf-8 -*-
from naoqi import ALProxy
import almath
def wave(motion, names, times, keys):
    motion.angleInterpolation(names, keys, times, True)
names, times, keys = list(), list(), []
names.append("RElbowYaw"); times.append([0.5, 1.0, 1.5]); keys.append([0.1, 20 * almath.TO_RAD, 0.3])
try:
    motion = ALProxy("ALMotion", "robot.local", 9559)
    wave(motion, names, times, keys)
except BaseException, err:
    print err
if motion: print "again"
names = ["RElbowYaw"]
times = [[0.5, 1.0]]
keys = [[[0.1, [3, -0.1, 0], [3, 0.1, 0]], [0.4, [3, -0.1, 0], [3, 0, 0]]]]
motion.angleInterpolationBezier(names, times, keys)
"""
TIMELINE = """<?xml version="1.0" encoding="UTF-8"?>
<ChoregrapheProject xmlns="http://www.aldebaran-robotics.com/schema/choregraphe/project.xsd" xar_version="3">
<Box name="wave" id="1"><Timeline enable="1" fps="25" start_frame="1" end_frame="-1" size="40">
<ActuatorList model="nao"><ActuatorCurve name="value" actuator="RElbowYaw" mute="0" unit="0">
<Key frame="10" value="11.4"><Tangent side="right" interpType="bezier" abscissaParam="5" ordinateParam="0"/></Key>
<Key frame="25" value="-22.9"/><Key frame="40" value="0.0"/></ActuatorCurve></ActuatorList>
<BehaviorLayer name="b"/></Timeline></Box></ChoregrapheProject>
"""
POSTURES = """<?xml version="1.0"?><library>""" + "".join(
    f"<position><version>2</version><name>p{k}</name><Motors><Motor><name>RElbowYaw</name><value>0.{k}</value></Motor>"
    "</Motors></position>"
    for k in range(1, 5)
) + "</library>"  # fmt: skip


def _takes(folder: Path) -> dict[str, Victim]:
    """A body that stands and moves one forearm, as a table; and our robot as a skeleton."""
    n = 20
    places = np.tile(
        [[-0.2, 0.5, 0], [-0.25, 0.25, 0], [-0.25, 0.25, 0.25], [0.2, 0.5, 0], [0.25, 0.25, 0], [0.25, 0.25, 0.25],
         [-0.1, 0, 0], [0.1, 0, 0]], (n, 1, 1),
    )  # fmt: skip
    swing = np.sin(np.arange(n) / 4)
    places[:, 2] = places[:, 1] + 0.25 * np.stack([0 * swing, np.sin(swing), np.cos(swing)], axis=1)
    names = [f"{name}_{axis}" for name in LANDMARKS for axis in "xyz"]
    rows = np.column_stack([np.arange(n) / 30, places.reshape(n, -1)])
    np.savetxt(folder / "body.csv", rows, delimiter=",", header=",".join(["time_s", *names]), comments="", fmt="%.3f")
    angles = load_demonstrations().trajectories[0][10:20].round(3)
    body = exchange.write(folder / "body.bvh", exchange.Motion(angles, 0.1), unsafe="keep").path
    return {
        "take_csv": Victim(folder / "body.csv", load_take, torn=False, use=_usable),
        "take_bvh": Victim(body, load_take, torn=False, use=_usable),
    }


def _usable(take: Any) -> None:
    _finite(take.lowpass())
    propose_cuts(take)
