"""A job's own process, started by `runner.start_process` with file and run folder of the job; what it does by kind."""

from __future__ import annotations

import dataclasses
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box

from creative_nao import storage
from creative_nao.agents.bundle import BundleHeader, save_bundle
from creative_nao.agents.play import check_env, make_env
from creative_nao.agents.training import PPOSettings, train_ppo
from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.errors import CreativeNaoError
from creative_nao.evaluation.jobs import PARENT, read_spec, write_result
from creative_nao.evaluation.oracle_sets import find_oracle_set, shipped_oracle_set
from creative_nao.evaluation.protocol import play
from creative_nao.evaluation.statistics import seed_sequence
from creative_nao.evaluation.suites import TaughtSet, resolve_agent
from creative_nao.maps import pb_map
from creative_nao.maps.grid import pb_grid
from creative_nao.measures import OUTCOMES, table
from creative_nao.model import Memory, TrainingSettings, condition_settings, reproduction, train_network
from creative_nao.model.controls import CONTROLS, control_memory
from creative_nao.schema import dump, parse

Report = Callable[[float], None]
"""Takes the share of the work that is done."""
REPORT_EVERY_S = 0.5


def train_memory(spec: dict[str, Any], folder: Path, report: Report) -> dict[str, Any]:
    """Train a memory on other demonstrations and write it; return how well it learned."""
    start = time.perf_counter()
    training = TrainingSettings(**{name: spec[name] for name in ("closed_loop_ratio", "n_epochs", "seed")})
    if spec["demonstrations"] is not None:
        demonstrations = load_demonstrations(spec["demonstrations"])
    else:  # the six actions again, by a hand with another seed
        from creative_nao.demonstrations import teaching  # loads MuJoCo

        demonstrations = teaching.as_demonstrations(teaching.teach(np.random.default_rng(spec["teaching_seed"])))
    memory = train_network(
        demonstrations,
        training,
        progress=lambda _, state: report(state.epoch / training.n_epochs),
        command=f"creative-nao evaluate (memory {spec['memory']})",
    )
    memory.save(folder / spec["file"])
    return {"memory": spec["memory"], "loss": float(min(memory.loss_history)), "seconds": time.perf_counter() - start}


def train_set(spec: dict[str, Any], folder: Path, report: Report) -> dict[str, Any]:
    """Train the memories of all conditions on one set with one seed, map them, and return their figures.

    Each of `memories` tells how well its basic actions come back (DTW distance by name [rad]), the paper's four figures
    over its map, and how long it took.
    """
    taught = parse(TaughtSet, spec["set"], "set")
    basic = load_demonstrations(taught.demonstrations)
    names = taught.actions or basic.names
    trajectories = [basic.trajectory(name) for name in names]
    basic = Demonstrations(names, trajectories, basic.dt_s, basic.joints, basic.record)
    told, network = [], None
    for place, (condition, memory) in enumerate(spec["memories"].items()):
        start = time.perf_counter()
        if condition in CONTROLS:
            assert network is not None
            made = control_memory(network, condition, spec["seed"])
        else:
            chosen = condition_settings(condition, {})
            n_epochs = spec["n_epochs"] * (3 if condition == "auto" else 1)  # the second attempt takes twice as long
            training = TrainingSettings(seed=spec["seed"], n_epochs=n_epochs, **chosen)
            command = f"creative-nao evaluate (memory {memory['name']})"
            made = network = train_network(basic, training, command=command)
            made.save(folder / memory["file"])
        seconds = time.perf_counter() - start
        told.append({
            "memory": memory["name"], "set": taught.name, "condition": condition, "seed": spec["seed"],
            "reproduction_dtw": dict(zip(names, reproduction(made), strict=True)),
            "attempts": [one["n_epochs"] for one in getattr(made, "record", {}).get("attempts", [])],
            **_paper_figures(made, spec["resolution"], spec["seed"]), "seconds": seconds,
        })  # fmt: skip
        report((place + 1) / len(spec["memories"]))
    return {"memories": told}


def _paper_figures(memory: Any, resolution: int, seed: int) -> dict[str, float | None]:
    found = table(memory.generate(pb_grid(resolution)), memory.demonstrations, rng=seed)
    shares = {f"{name}_pct": getattr(found, f"{name}_pct") for name in ("appropriate", *OUTCOMES)}
    draws = {"novelty": found.novelty, "diversity": found.diversity}
    return {**shares, **{name: None if drawn is None else drawn.mean for name, drawn in draws.items()}}


def _memory_of(memory: dict[str, Any], folder: Path) -> Any:
    """Return the name or file by which an environment finds a memory of a spec, or a control itself."""
    if "control" in memory:
        control = control_memory(Memory.read(folder / memory["file"]), memory["control"], memory["seed"])
        return dataclasses.replace(control, name=memory["name"])
    return memory["name"] if memory["file"] is None else str(folder / memory["file"])


def train_agent(spec: dict[str, Any], folder: Path, report: Report) -> dict[str, Any]:
    """Train an agent, write its bundle and return its training curve."""
    start = time.perf_counter()
    settings = parse(PPOSettings, spec["settings"], "settings of PPO")
    seed = int(seed_sequence(spec["base_seed"], spec["seed"]).generate_state(1)[0] % 2**31)
    policy, curve = train_ppo(
        spec["env"],
        settings=settings,
        seed=seed,
        env_kwargs={"memory": _memory_of(spec["memory"], folder)},
        progress=lambda done, planned: report(done / planned),
    )
    assert isinstance(policy.observation_space, Box)
    assert isinstance(policy.action_space, Box)
    header = BundleHeader(
        agent=spec["agent"],
        settings=settings,
        env=spec["env"],
        memory=spec["memory"]["name"],
        seed=seed,
        n_actions_training=settings.n_generated,
        observation_space=policy.observation_space,
        action_space=policy.action_space,
    )
    save_bundle(folder / spec["bundle"], header, policy)
    return {
        "seed": spec["seed"],
        "n_actions": list(curve.n_actions),
        "reward": list(curve.reward),
        "seconds": time.perf_counter() - start,
    }


def play_episodes(spec: dict[str, Any], folder: Path, report: Report) -> dict[str, Any]:
    """Let an agent play one episode per environment, memory and seed; return the episodes."""
    episodes = []
    total = len(spec["envs"]) * len(spec["memories"]) * len(spec["seeds"])
    for env_id in spec["envs"]:
        check_env(env_id)  # finds the module of one's own
        for first, memory in enumerate(spec["memories"]):
            places = range(first * len(spec["seeds"]), (first + 1) * len(spec["seeds"]))
            bundles = [folder / spec["bundles"][place] if spec["bundles"] else None for place in places]
            first_agent = resolve_agent(spec["agent"], bundles[0])
            env = make_env(env_id, _memory_of(memory, folder), first_agent, spec["n_actions"])
            try:
                oracle_set = _oracle_movements(memory, env, spec["n_actions"])
                for bundle, seed in zip(bundles, spec["seeds"], strict=True):
                    agent = resolve_agent(spec["agent"], bundle)
                    counts = {name: spec[name] for name in ("base_seed", "n_actions")}
                    episode = play(
                        agent, env, env_id=env_id, memory=memory["name"], seed=seed, oracle_set=oracle_set, **counts
                    )
                    episodes.append(dump(episode))
                    report(len(episodes) / total)
            finally:
                env.close()
    return {"episodes": episodes}


def _oracle_movements(memory: dict[str, Any], env: gym.Env, n_actions: int) -> np.ndarray | None:
    """Return the movements that the oracle would choose, (n, n_steps, n_joints); None where that does not ship."""
    found = None if memory["file"] is not None else shipped_oracle_set(memory["name"], n_actions)
    return None if found is None else env.unwrapped.memory.generate(found.pb)  # pyright: ignore[reportAttributeAccessIssue]


def score_map(spec: dict[str, Any], folder: Path, report: Report) -> dict[str, Any]:
    """Score the map of a memory, write it, and return what the greedy oracle chooses, where that does not ship.

    `oracle_pb` (n, n_pb) is what the oracle chose, `oracle_rewards` (n,) what each choice earned, `shares_pct` the
    share of each outcome on the map.
    """
    start = time.perf_counter()
    check_env(spec["env"])
    env = gym.make(spec["env"], memory=_memory_of(spec["memory"], folder))
    try:
        memory: Memory = env.unwrapped.memory  # pyright: ignore[reportAttributeAccessIssue]
    finally:
        env.close()
    found: dict[str, Any] = {}
    if spec["oracle"] == "shipped":
        scored = pb_map(memory, resolution=spec["resolution"]) if memory.pb.shape[1] == 2 else None
    else:
        best, scored = find_oracle_set(memory, spec["n_actions"], spec["resolution"])
        rewards = best.rewards.tolist()
        found = {"oracle_pb": best.pb.tolist(), "oracle_rewards": rewards, "shares_pct": best.shares_pct}
    if scored is not None:
        scored.save(folder / spec["chart"])
    else:
        storage.write_bytes(folder / spec["chart"], b"")  # more than two PB units have no picture
    return {**found, "seconds": time.perf_counter() - start}


HANDLERS: dict[str, Callable[[dict[str, Any], Path, Report], dict[str, Any]]] = {
    "teach": train_memory,
    "teach-set": train_set,
    "train": train_agent,
    "play": play_episodes,
    "chart": score_map,
}


def main(arguments: list[str]) -> int:
    """Do the job described in the file `arguments[0]` for the run folder `arguments[1]`; return the exit code."""
    _end_with_the_runner()
    job, folder = read_spec(Path(arguments[0])), Path(arguments[1])
    try:
        write_result(job, folder, HANDLERS[job.kind](job.spec, folder, _reporter(job.file(folder, ".progress"))))
    except (CreativeNaoError, OSError) as error:
        is_ours = isinstance(error, CreativeNaoError)
        if not is_ours and error.errno not in storage.DISK_FAULTS:
            raise
        sys.stderr.write(f"{error}\n" if is_ours else f"{error.filename}: {error.strerror}\n")
        return 2
    return 0


def _reporter(path: Path) -> Report:
    """Return what writes the share that is done, not oftener than it is read."""
    last = 0.0

    def report(share: float) -> None:
        nonlocal last
        if time.monotonic() - last >= REPORT_EVERY_S:
            last = time.monotonic()
            storage.write_text(path, f"{share:.4f}")

    return report


def _end_with_the_runner() -> None:
    """End this process when its runner is gone: nobody would collect the result, and the core is wanted elsewhere."""
    runner = os.environ.get(PARENT)
    if runner is None:
        return

    def watch() -> None:
        while os.getppid() == int(runner):
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
