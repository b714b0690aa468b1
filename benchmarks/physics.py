"""Why the servos, the step and the solver of the robot are what they are, and how hard it punches.

    python benchmarks/physics.py [servos] [gains] [step] [robots] [boxing] [pool]

Prints the tables of docs/robot.md, one a word; without a word, all of them, in about two minutes of one core.

- servos: a step of 0.3 rad at each joint of the right arm, in the guard, standing free.
- gains: the six basic actions with other gains, armatures and friction of the arms, at their speed and at 1.5 times it.
- step: the six basic actions with other steps, integrators and solvers, against steps of 0.5 ms.
- robots: the six basic actions on 40 robots drawn from `VariationRanges`.
- boxing: hits on the bag, impulse, peak force, fist speed and reach of each basic action.
- pool: what a performance costs in the ways in which many can be performed.
"""

import sys
import time
from collections.abc import Callable, Iterable
from contextlib import closing

import mujoco
import mujoco.rollout
import numpy as np

from creative_nao import load_demonstrations
from creative_nao.envs.boxing_envs import VariationRanges
from creative_nao.envs.executors import PhysicsPool, SharedScene, ThreadPool
from creative_nao.joints import JOINTS
from creative_nao.robot import (
    Performance,
    Performer,
    PlaybackSettings,
    Scene,
    ServoSettings,
    bare_scene,
    failures,
    first_failure,
    interpolation,
)

DEMOS = load_demonstrations()
STEP_RAD = 0.3
FAST = 1.5


def table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    heads = list(heads)
    print("| " + " | ".join(heads) + " |")
    print("|" + " --- |" * len(heads))
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |")
    print(flush=True)


def perform_all(performer: Performer, speed: float = 1.0) -> list[Performance]:
    """All six, `speed` times as fast; 1.5 makes 0.10 s of the tick of 0.15 s."""
    return [performer.perform(trajectory, round(DEMOS.dt_s / speed, 2)) for trajectory in DEMOS.trajectories]


def step_response(performer: Performer, joint: str, sign: float) -> list[str]:
    """Rise (10 to 90 %), overshoot, settling (to 2 %), rest error and peak torque of a step of one joint."""
    scene, step_s = performer.scene, performer.scene.model.opt.timestep
    performer.reset()
    data, row, motor = performer.data, scene.index.qpos[joint], scene.index.actuator[joint]
    start = float(data.qpos[row])
    data.ctrl[motor] += sign * STEP_RAD
    goal = float(data.ctrl[motor])
    angle, torque = [], []
    for _ in range(round(1.5 / step_s)):
        mujoco.mj_step(scene.model, data)
        angle.append(data.qpos[row])
        torque.append(data.actuator_force[motor])
    rest = float(np.mean(angle[-20:]))
    share = (np.array(angle) - start) / (rest - start)
    rise = (np.argmax(share >= 0.9) - np.argmax(share >= 0.1)) * step_s
    outside = np.flatnonzero(np.abs(share - 1) > 0.02)
    peak = float(np.abs(torque).max())
    settled = (outside[-1] + 1) * step_s
    effort = float(scene.index.arm_effort_nm[JOINTS.index(joint)])
    full = float(np.sum(np.abs(torque) >= 0.999 * effort)) * step_s
    return [
        joint, f"{1000 * rise:.0f}", f"{100 * max(0.0, share.max() - 1):.1f}", f"{1000 * settled:.0f}",
        f"{1000 * abs(goal - rest):.0f}", f"{peak:.2f} of {effort:g}", f"{1000 * full:.0f}",
    ]  # fmt: skip


def servos() -> None:
    performer = Performer(bare_scene())
    rows = [step_response(performer, joint, sign) for joint, sign in zip(JOINTS[:4], (-1, -1, 1, -1), strict=True)]
    table(
        ["joint", "rise ms", "overshoot %", "settled ms", "rest error mrad", "peak torque N m", "at the limit ms"], rows
    )


def gain_row(label: str, settings: ServoSettings, armature: float = 1.0) -> list[str]:
    scene = bare_scene(servos=settings)
    scene.model.dof_armature[[scene.index.dof[joint] for joint in JOINTS]] *= armature
    mujoco.mj_setConst(scene.model, mujoco.MjData(scene.model))
    performer = Performer(scene)
    cells = [label]
    for speed in (1.0, FAST):
        done = perform_all(performer, speed)
        error = max(one.mean_error_rad.max() for one in done)
        saturated = max(one.saturated_share.max() for one in done)
        refused = sum(first_failure(one) is not None for one in done)
        cells += [f"{error:.3f}", f"{100 * saturated:.1f}", f"{6 - refused} of 6"]
    return cells


def gains() -> None:
    ours = ServoSettings()
    rows = [
        gain_row(f"kp {kp:g}, kd {kd:g}" + (" (chosen)" if (kp, kd) == (ours.arm_kp, ours.arm_kd) else ""),
                 ServoSettings(arm_kp=kp, arm_kd=kd))
        for kp in (10.0, 20.0, 30.0, 40.0) for kd in (0.2, 0.4, 0.8)
    ]  # fmt: skip
    rows += [gain_row(f"armature x {factor:g}", ours, factor) for factor in (0.5, 2.0, 5.0, 15.0)]
    rows += [gain_row(f"damping {value:g}", ServoSettings(damping=value)) for value in (0.1, 0.5)]
    heads = ["arms", "worst mean error rad", "worst time at the limit %", "pass"]
    table(heads + [f"{head} at {FAST} x" for head in heads[1:]], rows)


def ticks_of(performer: Performer) -> np.ndarray:
    """Joint angles at every tick of all six, before the encoders count them."""
    found = []
    for trajectory in DEMOS.trajectories:
        done = performer.perform(trajectory, DEMOS.dt_s, keep_frames=True)
        assert done.frames is not None
        found.append(done.frames[:: round(DEMOS.dt_s / done.frame_dt_s), performer.scene.index.arm_qpos])
    return np.array(found)


def stepped(step_s: float, change: Callable[[mujoco.MjModel], None] | None = None) -> tuple[np.ndarray, float]:
    """Return the angles at the ticks, and the CPU time of a performance [ms]."""
    scene = bare_scene()
    scene.model.opt.timestep = step_s
    if change is not None:
        change(scene.model)
    performer = Performer(scene, PlaybackSettings(frame_dt_s=DEMOS.dt_s))
    found = ticks_of(performer)
    costs = []
    for _ in range(3):
        began = time.thread_time()
        perform_all(performer)
        costs.append((time.thread_time() - began) / 6)
    return found, 1000 * min(costs)


def step() -> None:
    def integrator(kind: mujoco.mjtIntegrator) -> Callable[[mujoco.MjModel], None]:
        return lambda model: setattr(model.opt, "integrator", kind)

    def elliptic(model: mujoco.MjModel) -> None:
        model.opt.cone, model.opt.noslip_iterations = mujoco.mjtCone.mjCONE_ELLIPTIC, 5

    def solver(kind: mujoco.mjtSolver) -> Callable[[mujoco.MjModel], None]:
        return lambda model: setattr(model.opt, "solver", kind)

    reference, _ = stepped(0.0005)
    cases: list[tuple[str, float, Callable[[mujoco.MjModel], None] | None]] = [
        ("1 ms, implicitfast", 0.001, None),
        ("2 ms, implicitfast", 0.002, None),
        ("5 ms, implicitfast (chosen)", 0.005, None),
        ("10 ms, implicitfast", 0.010, None),
        ("5 ms, Euler", 0.005, integrator(mujoco.mjtIntegrator.mjINT_EULER)),
        ("5 ms, implicit", 0.005, integrator(mujoco.mjtIntegrator.mjINT_IMPLICIT)),
        ("5 ms, elliptic cones, 5 no-slip passes", 0.005, elliptic),
        ("5 ms, solver CG", 0.005, solver(mujoco.mjtSolver.mjSOL_CG)),
    ]
    rows = []
    for label, step_s, change in cases:
        found, cost = stepped(step_s, change)
        error = np.abs(found - reference)
        rows.append(
            [label, f"{np.median(error):.4f}", f"{np.percentile(error, 99):.4f}", f"{error.max():.4f}", f"{cost:.1f}"]
        )
    table(["step", "median rad", "99 % rad", "largest rad", "CPU ms"], rows)


def robots(n_robots: int = 40) -> None:
    rng, performer = np.random.default_rng(0), Performer(bare_scene())
    passed, reasons = 0, {}
    for _ in range(n_robots):
        performer.vary(VariationRanges().draw(rng), rng)
        for done in perform_all(performer):
            found = failures(done)
            passed += not found
            for name in found:
                reasons[name] = reasons.get(name, 0) + 1
    table(
        ["robots", "performances that pass", "refused for"], [[n_robots, f"{passed} of {6 * n_robots}", reasons or "-"]]
    )


def boxing() -> None:
    performer = Performer(Scene(), PlaybackSettings(frame_dt_s=0.01))
    scene, data = performer.scene, mujoco.MjData(performer.scene.model)
    fists = [mujoco.mj_name2id(scene.model, mujoco.mjtObj.mjOBJ_SITE, f"nao/{side}Fist") for side in "RL"]
    rows = []
    for name, trajectory in zip(DEMOS.names, DEMOS.trajectories, strict=True):
        done = performer.perform(trajectory, DEMOS.dt_s, keep_frames=True)
        assert done.frames is not None
        hits, ahead = done.hits, []
        for snapshot in done.frames:
            data.qpos[:] = snapshot
            mujoco.mj_kinematics(scene.model, data)
            torso = data.xmat[scene.index.torso].reshape(3, 3)
            ahead.append([(torso.T @ (data.site_xpos[fist] - data.xpos[scene.index.torso]))[0] for fist in fists])
        rows.append(
            [name, hits.count, f"{hits.impulse_ns:.2f}", f"{hits.impulse_ns / max(hits.count, 1):.2f}",
             f"{hits.peak_force_n:.0f}", f"{done.fist_peak_speed_m_s.max():.2f}", f"{100 * np.max(ahead):.1f}",
             f"{done.mean_error_rad.max():.3f}", f"{100 * done.saturated_share.max():.1f}",
             f"{100 * done.self_collision_share:.1f}", f"{done.largest_tilt_rad:.3f}"]
        )  # fmt: skip
    heads = ["action", "hits", "impulse N s", "a hit N s", "peak force N", "fist m/s", "reach cm"]
    table([*heads, "worst error rad", "at the limit %", "touching itself %", "tilt rad"], rows)


def pool(n: int = 48) -> None:
    trajectories = np.repeat(DEMOS.trajectories, n // 6, axis=0)

    def one_by_one(performer: Performer) -> None:
        for trajectory in trajectories:
            performer.perform(trajectory, DEMOS.dt_s)

    def one_call(performer: Performer, n_threads: int) -> None:
        """All controls in one call of `mujoco.rollout`: stepping only, nothing measured."""
        scene, model = performer.scene, performer.scene.model
        targets = [performer._targets(trajectory, DEMOS.dt_s, 15)[0] for trajectory in trajectories]
        n_steps = max(map(len, targets)) * performer._substeps
        control = np.broadcast_to(performer._control, (n, n_steps, model.nu)).copy()
        for row, target in zip(control, targets, strict=True):
            ramp = interpolation.ramp(performer.guard, target, performer._substeps)
            row[:, scene.index.arm_actuator] = np.concatenate([ramp, np.repeat(ramp[-1:], n_steps - len(ramp), axis=0)])
        start, warm = (np.repeat(row[None], n, axis=0) for row in (performer._start, performer._warmstart))
        datas = [mujoco.MjData(model) for _ in range(n_threads)]
        mujoco.rollout.rollout(model, datas, start, control, initial_warmstart=warm)

    full, bare = Performer(Scene()), Performer(bare_scene())
    ways: dict[str, Callable[[], object]] = {
        "one performer, the whole scene": lambda: one_by_one(full),
        "one performer, the bare scene": lambda: one_by_one(bare),
        "one call of mujoco.rollout, bare, 1 thread": lambda: one_call(bare, 1),
        "one call of mujoco.rollout, bare, 2 threads": lambda: one_call(bare, 2),
    }
    with closing(ThreadPool(1)) as one, closing(ThreadPool(2)) as two:
        alone, pair = (PhysicsPool(threads, SharedScene(bare=True)) for threads in (one, two))
        ways["a performer a thread (chosen), 1 thread"] = lambda: alone.perform(trajectories, [DEMOS.dt_s] * n)
        ways["a performer a thread (chosen), 2 threads"] = lambda: pair.perform(trajectories, [DEMOS.dt_s] * n)
        costs: dict[str, list[tuple[float, float]]] = {label: [] for label in ways}
        for _ in range(3):  # by turns, since other work on the machine comes and goes
            for label, way in ways.items():
                cpu, wall = time.process_time(), time.perf_counter()
                way()
                costs[label].append((time.process_time() - cpu, time.perf_counter() - wall))
    rows = [
        [label, *(f"{1000 * min(of) / n:.1f}" for of in zip(*found, strict=True))] for label, found in costs.items()
    ]
    table(["way", "CPU ms a performance", "wall ms"], rows)


def main() -> None:
    parts = {"servos": servos, "gains": gains, "step": step, "robots": robots, "boxing": boxing, "pool": pool}
    for name in sys.argv[1:] or parts:
        if name not in parts:
            raise SystemExit(f"no table {name!r}; there are {', '.join(parts)}")
        print(f"## {name}\n")
        parts[name]()


if __name__ == "__main__":
    main()
