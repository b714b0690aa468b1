"""What more train memories are worth: `learned_map` trained on 10, 30, 100, ... of them, judged on the same ones.

    python studies/learned_map_scaling.py --memories runs/maps --validation-memories runs/held-out --out runs/scaling

The folders are those of `creative-nao agent memories`. The memories trained on are the first of a fixed order: the
bank's train part, then those of the folder, seed by seed. All agents play the same episodes of the bank's validation
part and of the other folder, in `BoxingMental-v1`, without imagining; rules play them too. What is finished in --out is
not done again, and a training that was stopped goes on. --docs publishes the result and its figure.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from creative_nao import storage
from creative_nao.agents import Agent, BundleHeader, make_agent, save_bundle
from creative_nao.agents.learned_map.training import train_map
from creative_nao.agents.learned_map.truth import ENDING, MemoryTruth, bank_truths, read_truths
from creative_nao.agents.play import PlayedEpisode, Score, evaluate_agent
from creative_nao.agents.settings import read_hyperparameters
from creative_nao.agents.training import TrainingPlan
from creative_nao.cli.terminal import Display
from creative_nao.errors import SettingsError
from creative_nao.maps.figure_style import BLUE, INK, figure, save, styled
from creative_nao.model import split_memories
from creative_nao.runtime import versions
from creative_nao.schema import dump, load_json, record

ENV = "CreativeNao/BoxingMental-v1"
NAME = "learned_map_scaling"
PLAYED_SEEDS = range(200, 203)
"""Of the episodes played; the weights kept were chosen with others."""


@record
class Curve:
    """What one agent earned: a rule, or a map trained on so many memories with a seed."""

    described: dict[str, Any]
    score: Score


@dataclass(frozen=True)
class ScalingSettings:
    """What more train memories are worth."""

    out: Path
    """Folder of what is finished; `learned_map_scaling.json`, `.png` and `.svg` are written there."""
    memories: Path
    """Folder to train on, beside the bank's train part."""
    validation_memories: Path
    """Folder to be judged on, beside the bank's validation part."""
    sizes: tuple[int, ...] = (10, 30, 100, 300, 1000)
    """How many memories are trained on; those beyond all that there are become all."""
    seeds: tuple[int, ...] = (0,)
    """Seeds of the trainings, one each for every size."""
    timesteps: int = 64_000
    """Simulated episodes of each training."""
    conf_file: Path | None = None
    """Hyperparameters; default: the shipped ones."""
    rules: tuple[str, ...] = ("random", "lattice", "spread_points", "surrogate")
    """Agents to compare with."""
    docs: Path | None = None
    """Folder of the documentation to write the result and the figure to as well."""


def in_order(truths: list[MemoryTruth]) -> list[MemoryTruth]:
    """Return truths seed by seed, so that the first of them are of all conditions.

    Example:
        >>> by_name = [MemoryTruth(name, *[None] * 6) for name in ("half/10", "open/2", "closed-2", "open/10")]
        >>> [one.name for one in in_order(by_name)]
        ['closed-2', 'open/2', 'half/10', 'open/10']
    """

    def key(truth: MemoryTruth) -> tuple[int, str]:
        condition, _, seed = truth.name.replace("/", "-").rpartition("-")
        return int(seed), condition

    return sorted(truths, key=key)


def played(agent: Agent, names: dict[str, str], progress: Callable[[int], None]) -> Score:
    """Return the score of an agent on memories, given as what an environment takes and the name to list."""
    episodes = evaluate_agent(agent, ENV, names, PLAYED_SEEDS, progress=progress)
    renamed: list[PlayedEpisode] = [dataclasses.replace(one, memory=names[one.memory]) for one in episodes]
    return Score(ENV, True, tuple(renamed))


def trained_on(truths: list[MemoryTruth], judged: list[MemoryTruth], seed: int, settings: ScalingSettings) -> Agent:
    """Train a map and return the agent; its bundle is written to --out."""
    chosen = read_hyperparameters("learned_map", ENV, settings.conf_file).replace(n_timesteps=settings.timesteps)
    plan = TrainingPlan(chosen, env=ENV, judged_env=ENV, seed=seed, evaluation_interval=max(settings.timesteps // 4, 1))
    label = f"learned_map-{len(truths)}-{seed}"
    with Display({label: chosen.n_timesteps}) as display:
        policy, _ = train_map(
            plan, truths, judged, checkpoint=settings.out / f"{label}.checkpoint", resume=True,
            progress=lambda _, done: display.show(label, min(done, chosen.n_timesteps)),
        )  # fmt: skip
    header = BundleHeader(
        "learned_map", chosen, ENV, "train", seed, sum(len(one.pb) for one in truths), policy.observation_space,
        policy.action_space,
    )  # fmt: skip
    return make_agent(str(save_bundle(settings.out / f"{label}.safetensors", header, policy)))


def run(settings: ScalingSettings) -> dict[str, Any]:
    """Train and play what is not finished, write result and figure, return the result."""
    truths = in_order(bank_truths(split_memories("train"), settings.out / "truths"))
    truths += in_order(read_truths(settings.memories))
    judged = bank_truths(split_memories("validation"), settings.out / "truths")
    names = {name: name for name in split_memories("validation")}
    for truth in (held_out := read_truths(settings.validation_memories)):
        path = settings.validation_memories / f"{truth.name}.safetensors"
        if not path.is_file():
            raise SettingsError(f"{path} is missing: the memory of {truth.name}{ENDING}, in which agents play")
        names[str(path)] = truth.name
    sizes = sorted({min(size, len(truths)) for size in settings.sizes})
    recipe = dump(read_hyperparameters("learned_map", ENV, settings.conf_file))
    shared = {"memories": [*names.values()], "seeds": [*PLAYED_SEEDS]}
    found: list[Curve] = []

    def once(label: str, described: dict[str, Any], make: Callable[[], Agent]) -> None:
        path = settings.out / f"{label}.json"
        described = {"agent": label, **described, **shared}
        if path.is_file() and (done := load_json(Curve, path, "curve")).described == described:
            found.append(done)
            return
        agent = make()
        with Display({f"playing {label}": len(names) * len(PLAYED_SEEDS)}) as display:
            score = played(agent, names, lambda n: display.show(f"playing {label}", n))
        found.append(Curve(described, score))
        storage.write_json(path, dump(found[-1]), None)

    for rule in settings.rules:
        once(rule, {}, lambda rule=rule: make_agent(rule))
    for size in sizes:
        for seed in settings.seeds:
            made_of = {"n_memories": size, "seed": seed, "timesteps": settings.timesteps, "recipe": recipe}
            made_of["trained_on"] = [one.name for one in truths[:size]]
            once(
                f"learned_map-{size}-{seed}", made_of,
                lambda n=size, seed=seed: trained_on(truths[:n], judged + held_out, seed, settings),
            )  # fmt: skip
    rows = [
        {
            "agent": one.described["agent"].partition("-")[0],
            **{key: one.described[key] for key in ("n_memories", "seed", "timesteps") if key in one.described},
            "mean": one.score.mean,
            "interval_95": list(one.score.interval),
            "rewards": {
                name: [e.reward for e in one.score.episodes if e.memory == name] for name in one.score.memories
            },
        }
        for one in found
    ]
    result = {"env": ENV, "seeds": [*PLAYED_SEEDS], "recipe": recipe, "versions": versions(), "rows": rows}
    for folder, image in [(settings.out, settings.out)] + (
        [] if settings.docs is None else [(settings.docs, settings.docs / "images")]
    ):
        storage.write_json(folder / f"{NAME}.json", result, 1)
        draw(rows, image / NAME)
    return result


def draw(rows: list[dict[str, Any]], path: Path) -> Path:
    """Draw reward over memories trained on, with intervals over memories, and the rules as lines; return the PNG."""
    with styled():
        drawn, (axis,) = figure(6.5, 4.0)
        curves = [row for row in rows if row["agent"] == "learned_map"]
        sizes = sorted({row["n_memories"] for row in curves})
        for seed in dict.fromkeys(row["seed"] for row in curves):
            mine = [row for row in curves if row["seed"] == seed]
            x, y = [row["n_memories"] for row in mine], [row["mean"] for row in mine]
            below, above = zip(
                *((row["mean"] - row["interval_95"][0], row["interval_95"][1] - row["mean"]) for row in mine),
                strict=True,
            )
            axis.errorbar(x, y, (below, above), color=BLUE, marker="o", capsize=3, label=f"learned_map, seed {seed}")
        for row in rows:
            if row["agent"] != "learned_map":
                axis.axhline(row["mean"], color=INK, linestyle="--", linewidth=0.8)
                axis.annotate(row["agent"], (sizes[-1], row["mean"]), ha="right", va="bottom", color=INK)
        axis.set(xscale="log", xticks=sizes, xticklabels=[str(size) for size in sizes])
        axis.minorticks_off()
        axis.set(xlabel="memories trained on", ylabel="reward of an episode", title="What more memories are worth")
        axis.legend(loc="upper left")
        return save(drawn, path)


def main() -> None:
    """Run the study of the command line and print a line for each agent."""
    for row in run(tyro.cli(ScalingSettings, description=__doc__))["rows"]:
        name = f"{row['agent']} on {row['n_memories']} memories, seed {row['seed']}" if "seed" in row else row["agent"]
        low, high = row["interval_95"]
        print(f"{name}: {row['mean']:.2f} ({low:.2f} to {high:.2f})")


if __name__ == "__main__":
    main()
