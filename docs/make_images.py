"""Draw the pictures of the documentation again: `python docs/make_images.py NAME`.

`docs/make_explorer_images.py` takes those of the explorer, `docs/publish_results.py` publishes results.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from make_pages import agent_names, random_scores
from tyro.conf import Positional
from tyro.extras import SubcommandApp

from creative_nao import load_demonstrations, load_memory, pb_map
from creative_nao.agents import Agent, load_agent, make_agent
from creative_nao.agents.learned_map.agent import LearnedMapAgent
from creative_nao.agents.play import make_env, play_episode
from creative_nao.envs.physical_map import PhysicalMap
from creative_nao.evaluation.plots import agent_colour, agent_label
from creative_nao.evaluation.protocol import play
from creative_nao.maps import pb_grid
from creative_nao.maps.figure_style import FAINT, INK, YELLOW, action_letter, figure, save_small, styled
from creative_nao.maps.picture import MEASURE_COLOURS
from creative_nao.measures import dtw_matrix, reward_scale, score
from creative_nao.model import Memory
from creative_nao.robot import Performer, PlaybackSettings, film_strip, imagined_frames, pictures, write_gif
from creative_nao.robot.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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

BELIEF_AGENT, BELIEF_MEMORY, BELIEF_SEED = "learned_map/BoxingMental-v1", "half/12", 0
"""The first test memory with half closed loops and the first seed: nothing was selected."""
BELIEF_AFTER = (0, 5, 15, 30)
"""Tries after which the figure shows the belief."""
BELIEF_ENV, BELIEF_CELLS = "CreativeNao/BoxingMental-v1", 81
CHANCE_COLOURS = "Purples"
RIVAL = "random"
TURN_S = 0.7
LARGEST_FILM_BYTES = 1_000_000

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


@dataclass(frozen=True, eq=False)
class Moment:
    """What is true and what an agent expects in the cells of a grid, before one of its tries and after the last.

    Attributes:
        tries: PB points tried so far, (n, 2).
        tried_usable: Whether each of them could be used, (n,).
        earned: Reward so far.
        reward: What each point would earn now, (cells, cells).
        usable: Whether it can be used, (cells, cells).
        chance: The probability of that which the agent expects; None of an agent that expects nothing.
        expected: The reward that it expects, chance x distance; None of an agent that expects nothing.
        next_pb: The point that it tries next; None after the last.
    """

    tries: np.ndarray
    tried_usable: np.ndarray
    earned: float
    reward: np.ndarray
    usable: np.ndarray
    chance: np.ndarray | None
    expected: np.ndarray | None
    next_pb: np.ndarray | None


class Watched(gym.Wrapper):
    """Keeps the `Moment` before every step of an agent in a memory."""

    def __init__(self, env: gym.Env, agent: Agent, memory: Memory, n_cells: int) -> None:
        super().__init__(env)
        self.agent, self.shape = agent, (n_cells, n_cells)
        self.grid = pb_grid(n_cells)
        self.moves, self.unit = memory.generate(self.grid), reward_scale(memory.demonstrations)
        scored = score(self.moves, memory.demonstrations)
        self.usable, self.distance = scored.appropriate, scored.distances.min(axis=1)
        self.rewards: list[float] = []
        self.tries: list[tuple[np.ndarray, bool]] = []
        self.moments: list[Moment] = []

    def step(self, action: Any) -> Any:
        """Keep the moment, step, and take in what is known then."""
        self.look(np.asarray(action))
        result = self.env.step(action)
        reward, info = float(result[1]), result[4]
        self.rewards.append(reward)
        self.tries.append((np.asarray(action), bool(info["appropriate"])))
        if info["appropriate"]:
            self.distance = np.minimum(self.distance, dtw_matrix(self.moves, [info["trajectory"]])[:, 0])
        return result

    def look(self, next_pb: np.ndarray | None = None) -> None:
        """Keep what is true and expected now."""
        chance = expected = None
        if isinstance(self.agent, LearnedMapAgent):
            chance, distance, _ = self.agent.expect(self.grid)
            chance, expected = chance.reshape(self.shape), (chance * distance).reshape(self.shape)
        pb, usable = np.array([pb for pb, _ in self.tries]), np.array([one for _, one in self.tries], bool)
        reward = np.where(self.usable, self.distance / self.unit, 0.0).reshape(self.shape)
        self.moments.append(
            Moment(pb.reshape(-1, 2), usable, math.fsum(self.rewards), reward, self.usable.reshape(self.shape),
                   chance, expected, next_pb)
        )  # fmt: skip


def moments(name: str, n_cells: int = BELIEF_CELLS, n_actions: int = 30) -> list[Moment]:
    """Let an agent play an episode on `BELIEF_MEMORY` without imagining; return every moment, the last included."""
    agent, memory = make_agent(name), load_memory(BELIEF_MEMORY)
    env = Watched(make_env(BELIEF_ENV, BELIEF_MEMORY, agent, n_actions), agent, memory, n_cells)
    rng = np.random.default_rng(BELIEF_SEED)
    for _ in play_episode(agent, env, seed=BELIEF_SEED, rng=rng, n_actions=n_actions):
        pass
    env.look()
    env.close()
    return env.moments


def draw_cells(axes: Axes, values: np.ndarray, moment: Moment, top: float, colours: str, letters: np.ndarray) -> Any:
    """Draw numbers of every cell from 0 to `top`, what was tried, what is next and the learned points."""
    from matplotlib import patheffects

    half_cell = 1.0 / (len(values) - 1)
    sides = (-1 - half_cell, 1 + half_cell)
    image = axes.imshow(
        values, cmap=colours, vmin=0.0, vmax=top, origin="lower", extent=(*sides, *sides), interpolation="nearest"
    )
    for usable, marker, size in ((True, "o", 20), (False, "X", 26)):
        tried = moment.tries[moment.tried_usable == usable]
        axes.scatter(
            *tried.T, s=size, marker=marker, color="white", edgecolor="black", linewidth=0.9, zorder=3, clip_on=False
        )
    if moment.next_pb is not None:
        axes.scatter(
            *moment.next_pb, s=130, marker="*", color=YELLOW, edgecolor="black", linewidth=0.9, zorder=4, clip_on=False
        )
    for place, (x, y) in enumerate(letters):
        axes.text(x, y, action_letter(place), color="white", ha="center", va="center", fontsize=9, weight="bold",
                  path_effects=[patheffects.withStroke(linewidth=2, foreground="black")])  # fmt: skip
    axes.set(xlim=sides, ylim=sides, aspect="equal", xticks=(-1, 0, 1), yticks=(-1, 0, 1))
    axes.tick_params(labelsize=8)
    axes.grid(visible=False)
    return image


def hatched(axes: Axes, usable: np.ndarray) -> None:
    """Hatch what cannot be used."""
    axis = np.linspace(-1.0, 1.0, len(usable))
    filled = axes.contourf(axis, axis, ~usable, levels=[0.5, 1.5], colors=[FAINT], alpha=0.45, hatches=["////"])
    filled.set_edgecolor("#FFFFFF90")
    filled.set_linewidth(0.0)


def draw_belief(axes: Sequence[Axes], moment: Moment, top: float, letters: np.ndarray) -> tuple[Any, Any]:
    """Draw truth, expected reward and expected chance on three axes; return the images of reward and of chance."""
    assert moment.expected is not None
    assert moment.chance is not None
    axis = np.linspace(-1.0, 1.0, len(moment.usable))
    image = draw_cells(axes[0], moment.reward, moment, top, MEASURE_COLOURS, letters)
    hatched(axes[0], moment.usable)
    draw_cells(axes[1], moment.expected, moment, top, MEASURE_COLOURS, letters)
    chances = draw_cells(axes[2], 100.0 * moment.chance, moment, 100.0, CHANCE_COLOURS, letters)
    axes[2].contour(axis, axis, moment.usable, levels=[0.5], colors=INK, linewidths=0.8)
    r = np.corrcoef(moment.reward.ravel(), moment.expected.ravel())[0, 1]
    ranks = moment.chance.ravel().argsort().argsort() + 1
    n_usable = int(moment.usable.sum())
    above = ranks[moment.usable.ravel()].sum() - n_usable * (n_usable + 1) / 2.0
    area = above / (n_usable * (moment.usable.size - n_usable))
    axes[0].set_title("true reward now", fontsize=9)
    axes[1].set_title(f"expected reward (correlation {r:.2f})", fontsize=9)
    axes[2].set_title(f"probability of being usable (AUC {area:.2f})", fontsize=9)
    axes[0].set_ylabel(f"after {len(moment.tries)} tries: {moment.earned:.1f} earned\nPB 2")
    return image, chances


REWARD_LABEL = "reward for performing the movement of this PB point now"


@app.command
def belief() -> None:
    """Draw what the learned map expects of a memory that it has never seen: belief.png, and belief.gif try by try."""
    seen, letters = moments(BELIEF_AGENT), load_memory(BELIEF_MEMORY).pb
    top = float(max(one.reward.max() for one in seen))
    with styled():
        drawn, axes = figure(9.0, 11.6, len(BELIEF_AFTER), 3, sharex=True, sharey=True)
        for row, n in enumerate(BELIEF_AFTER):
            scales = draw_belief(axes[3 * row : 3 * row + 3], seen[n], top, letters)
        for axis in axes[-3:]:
            axis.set_xlabel("PB 1")
        bars(drawn, axes, scales)
        pixels = io.BytesIO()
        drawn.savefig(pixels, format="png", dpi=110)
        save_small(pixels, IMAGES / "belief.png")
        images = []
        for moment in seen:
            drawn, axes = figure(8.4, 3.7, 1, 3, sharey=True)
            scales = draw_belief(axes, moment, top, letters)
            for axis in axes:
                axis.set_xlabel("PB 1")
            bars(drawn, axes, scales)
            images.append(pixels_of(drawn))
    write_film(images, IMAGES / "belief.gif")


def bars(drawn: Figure, axes: Sequence[Axes], scales: tuple[Any, Any]) -> None:
    """Draw the scale of the first two columns and that of the third below them."""
    rows = np.array(axes).reshape(-1, 3)
    below: Any = {"location": "bottom", "aspect": 40, "pad": 0.02}
    drawn.colorbar(scales[0], ax=rows[:, :2].ravel().tolist(), label=REWARD_LABEL, **below)
    drawn.colorbar(scales[1], ax=rows[:, 2].tolist(), label="probability [%]", **{**below, "aspect": 20})


@app.command
def race() -> None:
    """Draw the learned map and uniform sampling on the same unseen memory, try by try: race.gif."""
    names = (BELIEF_AGENT, RIVAL)
    played, letters = [moments(name) for name in names], load_memory(BELIEF_MEMORY).pb
    top = float(max(one.reward.max() for seen in played for one in seen))
    most = max(seen[-1].earned for seen in played)
    images = []
    with styled():
        for n in range(len(played[0])):
            drawn, axes = figure(8.4, 3.6, 1, 3, width_ratios=(1, 1, 0.95))
            for axis, name, seen in zip(axes, names, played, strict=False):
                image = draw_cells(axis, seen[n].reward, seen[n], top, MEASURE_COLOURS, letters)
                hatched(axis, seen[n].usable)
                axis.set_title(f"{agent_label(name)}: {seen[n].earned:.1f}", fontsize=11, color=agent_colour(name))
                axis.set_xlabel("PB 1")
                axes[2].plot([one.earned for one in seen[: n + 1]], color=agent_colour(name), linewidth=2)
                axes[2].plot(n, seen[n].earned, "o", color=agent_colour(name))
            axes[0].set_ylabel("PB 2")
            axes[2].set(xlim=(0, len(seen) - 1), ylim=(0, 1.05 * most), title="reward so far", xlabel="movements tried")
            axes[2].title.set_fontsize(11)
            drawn.colorbar(image, ax=axes[:2], location="bottom", aspect=40, pad=0.02, label=REWARD_LABEL)
            images.append(pixels_of(drawn))
    write_film(images, IMAGES / "race.gif")


def pixels_of(drawn: Figure) -> np.ndarray:
    """Return a figure as pixels, (height, width, 3)."""
    from PIL import Image

    pixels = io.BytesIO()
    drawn.savefig(pixels, format="png", dpi=90)
    return np.asarray(Image.open(pixels).convert("RGB"))


def write_film(images: Sequence[np.ndarray], path: Path) -> None:
    """Write pictures of tries as a GIF that rests on the last; one that is too large is refused."""
    write_gif([*images, *[images[-1]] * 4], path, frame_dt_s=TURN_S)
    if path.stat().st_size > LARGEST_FILM_BYTES:
        raise SystemExit(f"{path} is larger than {LARGEST_FILM_BYTES} bytes: {path.stat().st_size}")


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


def _column(path: Path, name: str) -> np.ndarray:
    """Return one column of a CSV file as numbers."""
    with path.open(encoding="utf-8", newline="") as stream:
        return np.array([float(row[name]) for row in csv.DictReader(stream)])


if __name__ == "__main__":
    app.cli(prog="python docs/make_images.py")
