"""How fast are the environments?

    python benchmarks/environments.py [--rounds 7] [--only mental|boxing|modulation|imagining]

All in one process, by turns; printed are medians over the rounds. Speeds of one environment are per second of CPU time,
since wall time depends on what else the machine does. Vector environments use threads: their wall time is compared with
that of one environment, and how much CPU time they take says what they would gain on a quiet machine. Measured with 30
accepted movements beside the six basic actions: the most that an episode of thirty actions can know.
"""

import argparse
import statistics
import time

import gymnasium as gym
import mujoco
import numpy as np

import creative_nao  # noqa: F401 - registers the environments

N_KNOWN = 30
MENTAL, BOXING, MODULATION = (f"CreativeNao/{name}-v0" for name in ("BoxingMental", "Boxing", "BoxingModulation"))


def clocks(call) -> tuple[float, float]:
    """Return wall and CPU seconds of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - wall, time.process_time() - cpu


def fill(archive) -> None:
    """Let every robot know 36 movements, none of which is new."""
    env_ids = np.arange(len(archive.sizes))
    rng = np.random.default_rng(0)
    while archive.sizes.min() < 6 + N_KNOWN:
        movement = np.cumsum(rng.normal(0, 0.1, (1, 50, 8)), axis=1).repeat(len(env_ids), axis=0)
        archive.accept(env_ids, np.ones(len(env_ids), bool), movement, archive.compare(env_ids, movement))


class Player:
    """Steps an environment, single or vectorised, always at 36 known movements.

    Accepting is undone by resetting the sizes, which takes a microsecond.
    """

    def __init__(self, env, n_envs: int | None = None) -> None:
        self.env, self.n = env, n_envs or 1
        self._inner = env.unwrapped
        env.reset(seed=0)
        shape = (400, 2) if n_envs is None else (400, n_envs, 2)
        self._actions = np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)
        self._archive = self._inner._batch.archive
        fill(self._archive)

    def play(self, n_steps: int) -> None:
        for k in range(n_steps):
            self._archive.sizes[:] = 6 + N_KNOWN
            self._inner.step(self._actions[k % 400])


def compare(single: Player, vector: Player, rounds: int, n_steps: tuple[int, int], what: str) -> float:
    """Print the speeds of one environment and of many; return actions per CPU second of one environment."""
    for player, n in zip((single, vector), n_steps, strict=True):
        player.play(max(1, n // 5))  # compiles, starts threads
    times = {player: [] for player in (single, vector)}
    for _ in range(rounds):
        for player, n in zip((single, vector), n_steps, strict=True):
            times[player].append([seconds / (n * player.n) for seconds in clocks(lambda p=player, n=n: p.play(n))])
    (one_wall, one_cpu), (many_wall, many_cpu) = (np.median(times[player], axis=0) for player in (single, vector))
    ratio = statistics.median(a[0] / b[0] for a, b in zip(times[single], times[vector], strict=True))
    cpu_ratio = statistics.median(a[1] / b[1] for a, b in zip(times[single], times[vector], strict=True))
    n_threads = vector.env._batch.threads.n_threads
    print(f"{what}, one environment: {1 / one_cpu:,.0f} actions per CPU second ({1 / one_wall:,.0f} per wall second)")
    print(
        f"{what}, {vector.n} sub-environments on {n_threads} threads: {ratio:.2f} times one environment in wall time "
        f"({1 / many_wall:,.0f} per second), {cpu_ratio:.2f} times in CPU time, "
        f"{many_cpu / many_wall:.2f} processors busy: at least {cpu_ratio * n_threads:.2f} if all were free"
    )
    return 1 / one_cpu


def mental(rounds: int) -> None:
    single = Player(gym.make(MENTAL, n_actions=10**9))
    vector = Player(make_vec(MENTAL, 64), 64)
    compare(single, vector, rounds, (400, 20), "BoxingMental-v0")


def modulation(rounds: int) -> None:
    single = Player(gym.make(MODULATION, n_actions=10**9))
    vector = Player(make_vec(MODULATION, 64), 64)
    compare(single, vector, rounds, (1000, 50), "BoxingModulation-v0 (decisions)")


def imagining(rounds: int) -> None:
    """Print what a movement imagined costs, one at a time and many at once, beside 36 known ones."""
    player = Player(gym.make(MENTAL, n_actions=10**9, n_imagined=10**9))
    player._archive.sizes[:] = 6 + N_KNOWN
    for n in (1, 8, 64, 512):
        points, n_calls = np.random.default_rng(0).uniform(-1, 1, (n, 2)), max(1, 256 // n)

        def imagine(points=points, n_calls=n_calls) -> None:
            for _ in range(n_calls):
                player._inner.imagine(points)

        imagine()
        cpu = statistics.median(clocks(imagine)[1] for _ in range(rounds)) / n / n_calls
        print(f"imagining, {n} at once: {1e3 * cpu:.3f} ms of CPU time a movement")


def boxing(rounds: int) -> None:
    single = Player(gym.make(BOXING, n_actions=10**9))
    vector = Player(make_vec(BOXING, 16), 16)
    compare(single, vector, rounds, (8, 1), "Boxing-v0")
    env = single._inner
    performer = env.performer
    actions = single._actions[:8].astype(float)
    plans = []
    for trajectory in env.memory.generate(actions):
        targets, _ = performer._targets(trajectory, env.memory.dt_s, round(env.memory.dt_s / 0.01))
        plans.append(controls(performer, targets))

    def raw() -> None:
        """The same physics steps with the same commands, in a bare loop over mj_step."""
        model, data = performer.scene.model, performer.data
        for plan in plans:
            performer.reset()
            for control in plan:
                data.ctrl[:] = control
                mujoco.mj_step(model, data)

    def nothing_but_steps() -> None:
        """As many physics steps in one call: no command ever changes."""
        model, data = performer.scene.model, performer.data
        for plan in plans:
            performer.reset()
            mujoco.mj_step(model, data, nstep=len(plan))

    ratios, bare = [], []
    for _ in range(rounds):
        _, cpu = clocks(lambda: single.play(8))
        ratios.append(clocks(raw)[1] / cpu)
        bare.append(clocks(nothing_but_steps)[1] / cpu)
    n_steps = sum(map(len, plans)) / len(plans)
    print(
        f"Boxing-v0 against raw mj_step, {n_steps:.0f} physics steps an action: {statistics.median(ratios):.2f} of its "
        f"speed with the same commands, {statistics.median(bare):.2f} of that of as many steps standing still"
    )


def controls(performer, targets: np.ndarray) -> np.ndarray:
    """Return the command of every physics step."""
    from creative_nao.robot import interpolation

    control = np.repeat(performer._control[None], len(targets) * performer._substeps, axis=0)
    ramped = interpolation.ramp(performer.guard, targets, performer._substeps)
    control[:, performer.scene.index.arm_actuator] = ramped
    return control


def make_vec(name: str, n: int):
    return gym.make_vec(name, n, vectorization_mode="vector_entry_point", n_actions=10**9)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7, help="rounds; the median is printed")
    parser.add_argument("--only", choices=["mental", "boxing", "modulation", "imagining"], help="one of them")
    options = parser.parse_args()
    for measure in (mental, boxing, modulation, imagining):
        name = measure.__name__
        if options.only in (None, name):
            measure(options.rounds)


if __name__ == "__main__":
    main()
