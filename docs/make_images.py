"""Draw the pictures of the documentation again: `python docs/make_images.py NAME`.

`docs/make_explorer_images.py` takes those of the explorer, `docs/make_belief_images.py` draws what a learned map
expects, `docs/publish_results.py` publishes results.
"""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from make_pages import agent_names, random_scores
from tyro.conf import Positional
from tyro.extras import SubcommandApp

from creative_nao import load_demonstrations, load_memory, pb_map
from creative_nao.agents import load_agent, make_agent
from creative_nao.agents.play import make_env
from creative_nao.envs.physical_map import PhysicalMap
from creative_nao.evaluation.plots import agent_colour
from creative_nao.evaluation.protocol import play
from creative_nao.maps.figure_style import BLUE, GREEN, ORANGE, figure, save_small, styled
from creative_nao.robot import Performer, PlaybackSettings, film_strip, imagined_frames, pictures, write_gif
from creative_nao.robot.scene import Scene

DOCS = Path(__file__).parent
IMAGES = DOCS / "images"
MEMORIES = ("open_0", "half_0", "closed_0")
MOMENTS = {"right_straight": (0, 6, 8, 10, 14, 18), "left_hook": (0, 5, 8, 11, 13, 17)}
"""Ticks of the first punch that tell it best."""
FILM = ("right_straight", "left_hook")
"""Basic actions that stand in the film, each beside a movement that nobody taught."""
FILM_MEMORY, FILM_PB = "half/0", (0.3, -0.1)
"""Where that movement comes from: the PB point of the README's example."""
FILM_TICKS = slice(2, 19)
FILM_FRAME_S = 0.05

CLIP_MEMORY, CLIP_SEED, N_FINDS = "half/10", 100, 3
CLIP_TICKS = slice(0, 18)
"""The first punch, or what stands in its place; a movement repeats itself after it."""
CLIP_SIZE_PX = (168, 180)
LARGEST_CLIP_BYTES = 300_000

LOSSES = {
    "appropriate": ("usable: cross-entropy", BLUE), "distance": ("distance: log-likelihood, negative", ORANGE),
    "basic_distances": ("distances to basic actions: squared error", GREEN),
}  # fmt: skip
"""Terms of the loss of a learned map, what they are and their colours."""

AGENT_COLOURS = {"ppo": "#0072B2", "sac": "#D55E00"}

app = SubcommandApp()


@app.command
def strips() -> None:
    """Draw film strips of two basic actions in physics."""
    demos = load_demonstrations()
    performer = Performer()
    for name, ticks in MOMENTS.items():
        done = performer.perform(demos.trajectory(name), demos.dt_s, keep_frames=True)
        assert done.frames is not None
        per_tick = round(demos.dt_s / done.frame_dt_s)
        frames = done.frames[[tick * per_tick for tick in ticks]]
        images = pictures(performer.scene, frames, camera="close", width=260, height=300, shadows=True, smooth=2)
        film_strip(images, IMAGES / f"{name}.png")


@app.command
def film() -> None:
    """Draw two taught movements and a new one side by side, at the robot's own pace, as a GIF of less than 1 MB."""
    from PIL import Image, ImageDraw

    memory = load_memory(FILM_MEMORY)
    demos = memory.demonstrations
    movements = {f"taught: {name.replace('_', ' ')}": demos.trajectory(name) for name in FILM}
    movements["nobody taught this"] = memory.generate([FILM_PB])[0]
    performer = Performer(settings=PlaybackSettings(frame_dt_s=FILM_FRAME_S))
    columns = []
    for caption, trajectory in movements.items():
        performance = performer.perform(trajectory, demos.dt_s, keep_frames=True)
        assert performance.frames is not None
        per_tick = round(demos.dt_s / performance.frame_dt_s)
        frames = performance.frames[FILM_TICKS.start * per_tick : FILM_TICKS.stop * per_tick]
        images = pictures(performer.scene, frames, camera="close", width=256, height=240, shadows=True, smooth=2)
        captioned = [Image.fromarray(image) for image in images]
        for image in captioned:
            ImageDraw.Draw(image).text(
                (8, 220), caption, fill="white", stroke_width=2, stroke_fill="black", font_size=14
            )
        columns.append([np.asarray(image) for image in captioned])
    write_gif(
        [np.concatenate(row, axis=1) for row in zip(*columns, strict=True)],
        IMAGES / "boxing.gif",
        frame_dt_s=FILM_FRAME_S,
    )


@app.command
def maps() -> None:
    """Draw the maps of the shipped memories."""
    for name in MEMORIES:
        pb_map(load_memory(name.replace("_", "/"))).plot(IMAGES / f"map_{name}.png")


@app.command
def small() -> None:
    """Write the pictures, screenshots too, with few colours: a third of their size, for the source archive."""
    from PIL import Image

    for path in sorted(IMAGES.rglob("*.png")):
        with Image.open(path) as picture:
            done = picture.mode == "P"
        if not done:
            save_small(path, path)


@app.command
def physical() -> None:
    """Draw what the robot makes of them and sum it up, from the maps in docs/results/physical."""
    for name in MEMORIES:
        result = DOCS / "results" / "physical" / f"{name}.npz"
        chart = PhysicalMap.load(result)
        chart.plot(IMAGES / f"physical_map_{name}.png")
        result.with_suffix(".json").write_text(json.dumps(chart.summary(), indent=1) + "\n", encoding="utf-8")


class Recorder(gym.Wrapper):
    """Keeps the reward and the trajectory of every movement that was accepted."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        self.finds: list[tuple[float, np.ndarray]] = []

    def step(self, action: Any) -> Any:
        """Step, and keep what was found."""
        result = self.env.step(action)
        if result[4].get("appropriate"):
            self.finds.append((float(result[1]), np.asarray(result[4]["trajectory"])))
        return result


@app.command
def clips(names: Positional[tuple[str, ...]] = ()) -> None:
    """Draw a clip of the best finds of agents in an episode on a validation memory: images/agents/*.gif.

    Args:
        names: Shipped agents, or others, as imagine_with_body@64, which plays in physics; default: all shipped.
    """
    (IMAGES / "agents").mkdir(parents=True, exist_ok=True)
    dt_s = load_memory(CLIP_MEMORY).demonstrations.dt_s
    scene = Scene(with_bag=False)  # it would hide an arm
    width, height = CLIP_SIZE_PX
    for name in names or agent_names():
        env_id = load_agent(name).header.score.env if name in agent_names() else "CreativeNao/Boxing-v0"
        agent = make_agent(name)
        env = Recorder(make_env(env_id, CLIP_MEMORY, agent))
        play(agent, env, env_id=env_id, memory=CLIP_MEMORY, seed=CLIP_SEED)
        best = sorted(env.finds, key=lambda find: -find[0])[:N_FINDS]
        env.close()
        frames = [imagined_frames(scene, trajectory[CLIP_TICKS], dt_s, frame_dt_s=dt_s) for _, trajectory in best]
        images = pictures(scene, np.concatenate(frames), camera="close", width=width, height=height, smooth=2)
        path = write_gif(images, IMAGES / "agents" / f"{name.replace('/', '-').replace('@', '-')}.gif", frame_dt_s=dt_s)
        if path.stat().st_size > LARGEST_CLIP_BYTES:
            raise SystemExit(f"{path} is larger than {LARGEST_CLIP_BYTES} bytes: {path.stat().st_size}")


@app.command
def training(runs: Positional[Path]) -> None:
    """Draw what the shipped agents earned in training and on validation memories: images/agents.png.

    Args:
        runs: Holds a folder of `creative-nao agent train` for each shipped agent, named as its file in
            creative_nao/agents/pretrained.
    """
    from matplotlib.figure import Figure

    chance, names = random_scores(), agent_names()
    envs = [env for env in chance if env != "Boxing-v0"]  # trained as BoxingMental-v0 was, with the same curve
    figure = Figure(figsize=(4.2 * len(envs), 3.4), layout="constrained")
    panels = figure.subplots(1, len(envs), squeeze=False)[0]
    for axis, env in zip(panels, envs, strict=True):
        for name in (n for n in names if n.endswith("/" + env)):
            run, agent = runs / name.replace("/", "-"), name.split("/")[0]
            ends, rewards = (_column(run / "episodes.csv", head) for head in ("n_decisions", "reward"))
            label, whole = agent.upper(), load_agent(name).header.n_actions_training  # the last episode may end before
            tenths = np.minimum((10 * ends / whole).astype(int), 9)  # copies end together, so no split by number
            parts = [np.mean(rewards[tenths == tenth]) for tenth in np.unique(tenths)]
            places = [100 * np.mean(ends[tenths == tenth]) / whole for tenth in np.unique(tenths)]
            axis.plot(places, parts, color=AGENT_COLOURS[agent], label=f"{label}, train memories")
            judged = [_column(run / "evaluations.csv", head) for head in ("n_decisions", "mean_reward")]
            places = 100 * judged[0] / whole
            axis.plot(places, judged[1], "o--", ms=4, color=AGENT_COLOURS[agent], label=f"{label}, validation")
        axis.axhline(chance[env].mean, color="0.4", lw=1, ls=":", label="random, validation")
        axis.set(title=env, xlabel="share of the training [%]")
        axis.set_ylim(bottom=0)
    panels[0].set_ylabel("reward of an episode")
    panels[0].legend(fontsize=8, loc="lower right")
    figure.savefig(IMAGES / "agents.png", dpi=110)


@app.command
def curves(runs: Positional[tuple[Path, ...]]) -> None:
    """Draw losses and validation rewards of trainings of a learned map: images/agents/NAME_curves.png.

    Args:
        runs: Folders of `creative-nao agent train learned_map`, of one environment and several seeds.
    """
    agents = [load_agent(run / "agent.safetensors") for run in runs]
    headers, n_pb = [agent.header for agent in agents], agents[0].policy.action_space.shape[0]
    with styled():
        drawn, (losses, rewards) = figure(8.6, 3.4, 1, 2)
        for header, run, line in zip(headers, runs, ("-", "--", ":", "-."), strict=False):
            done = _column(run / "progress.csv", "n_decisions") / 1000
            for name, (label, colour) in LOSSES.items():
                told = label if run == runs[0] else None
                losses.plot(done, _column(run / "progress.csv", name), line, marker="o", ms=3, color=colour, label=told)
            done, mean = (_column(run / "evaluations.csv", name) for name in ("n_decisions", "mean_reward"))
            rewards.plot(done / 1000, mean, line, marker="o", ms=3, color=agent_colour(header.agent),
                         label=f"seed {header.seed}: {mean.max():.2f}")  # fmt: skip
        losses.set(title="Losses on train memories", xlabel="simulated episodes [1,000]", ylabel="mean of a term")
        rewards.set(title="Reward on validation memories", xlabel="simulated episodes [1,000]", ylim=(0, None))
        rewards.set_ylabel("reward of an episode")
        for axis in (losses, rewards):
            axis.legend(fontsize=8)
        pixels = io.BytesIO()
        drawn.savefig(pixels, format="png", dpi=110)
    name = f"{headers[0].agent}-{headers[0].env.rpartition('/')[2]}" + ("" if n_pb == 2 else f"-{n_pb}pb")
    save_small(pixels, IMAGES / "agents" / f"{name}_curves.png")


def _column(path: Path, name: str) -> np.ndarray:
    """Return one column of a CSV file as numbers."""
    with path.open(encoding="utf-8", newline="") as stream:
        return np.array([float(row[name]) for row in csv.DictReader(stream)])


if __name__ == "__main__":
    app.cli(prog="python docs/make_images.py")
