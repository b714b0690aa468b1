"""Draw what a learned map expects of an unseen memory: `python docs/make_belief_images.py belief`, and its `race`."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from tyro.extras import SubcommandApp

from creative_nao import load_memory
from creative_nao.agents import Agent, make_agent
from creative_nao.agents.learned_map.agent import LearnedMapAgent
from creative_nao.agents.play import make_env, play_episode
from creative_nao.evaluation.plots import agent_colour, agent_label
from creative_nao.maps import pb_grid
from creative_nao.maps.figure_style import FAINT, INK, YELLOW, action_letter, figure, save_small, styled
from creative_nao.maps.picture import MEASURE_COLOURS
from creative_nao.measures import dtw_matrix, reward_scale, score
from creative_nao.model import Memory
from creative_nao.robot import write_gif

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

IMAGES = Path(__file__).parent / "images"
AGENT, MEMORY, SEED = "learned_map/BoxingMental-v1", "half/12", 0
"""The first test memory with half closed loops and the first seed: nothing was selected."""
SHOWN_AFTER = (0, 5, 15, 30)
"""Tries after which the figure shows the belief."""
ENV, N_CELLS = "CreativeNao/BoxingMental-v1", 61
CHANCE_COLOURS = "Purples"
RIVAL = "random"
TURN_S = 0.7
LARGEST_FILM_BYTES = 1_000_000

app = SubcommandApp()


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


def moments(name: str, n_cells: int | None = None, n_actions: int = 30) -> list[Moment]:
    """Let an agent play an episode on `MEMORY`; return every moment, the last included."""
    agent, memory = make_agent(name), load_memory(MEMORY)
    env = Watched(make_env(ENV, MEMORY, agent, n_actions), agent, memory, n_cells or N_CELLS)
    rng = np.random.default_rng(SEED)
    for _ in play_episode(agent, env, seed=SEED, rng=rng, n_actions=n_actions):
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
    axes[2].set_title(f"probability usable (AUC {area:.2f})", fontsize=9)
    axes[0].set_ylabel(f"after {len(moment.tries)} tries: {moment.earned:.1f} earned\nPB 2", fontsize=9)
    return image, chances


REWARD_LABEL = "reward for performing the movement of this PB point now"


@app.command
def belief() -> None:
    """Draw what the learned map expects of a memory that it has never seen: belief.png, and belief.gif try by try."""
    seen, letters = moments(AGENT), load_memory(MEMORY).pb
    top = float(max(one.reward.max() for one in seen))
    with styled():
        drawn, axes = figure(9.0, 11.6, len(SHOWN_AFTER), 3, sharex=True, sharey=True)
        for row, n in enumerate(SHOWN_AFTER):
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
    names = (AGENT, RIVAL)
    played, letters = [moments(name) for name in names], load_memory(MEMORY).pb
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


if __name__ == "__main__":
    app.cli(prog="python docs/make_belief_images.py")
