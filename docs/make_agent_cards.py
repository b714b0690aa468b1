"""Draw the training curves of the shipped agents and write their cards: docs/agent_cards.md, docs/images/agents.png.

Usage: python docs/make_agent_cards.py RUNS, where RUNS holds a folder of `creative-nao agent train` for each shipped
agent, named as its file in creative_nao/agents/pretrained. The figures of the cards come from the bundles themselves.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from creative_nao.agents import load_agent, make_agent, shipped_agents
from creative_nao.agents.play import Score, evaluate_agent

mpl.use("Agg")
import matplotlib.pyplot as plt

DOCS = Path(__file__).parent
COLOURS = {"ppo": "#0072B2", "sac": "#D55E00"}


def column(path: Path, name: str) -> np.ndarray:
    """Return one column of a CSV file as numbers."""
    with path.open(encoding="utf-8", newline="") as stream:
        return np.array([float(row[name]) for row in csv.DictReader(stream)])


def draw(runs: Path, names: list[str], chance: dict[str, Score]) -> None:
    """Draw what was earned in training and on validation memories, one panel an environment."""
    envs = [env for env in chance if env != "Boxing-v0"]  # trained as BoxingMental-v0 was, with the same curve
    figure, axes = plt.subplots(1, len(envs), figsize=(4.2 * len(envs), 3.4), squeeze=False, layout="constrained")
    for axis, env in zip(axes[0], envs, strict=True):
        for name in (n for n in names if n.endswith("/" + env)):
            run, agent = runs / name.replace("/", "-"), name.split("/")[0]
            ends, rewards = (column(run / "episodes.csv", head) for head in ("n_decisions", "reward"))
            label, whole = agent.upper(), load_agent(name).header.n_actions_training  # the last episode may end before
            tenths = np.minimum((10 * ends / whole).astype(int), 9)  # copies end together, so no split by number
            parts = [np.mean(rewards[tenths == tenth]) for tenth in np.unique(tenths)]
            places = [100 * np.mean(ends[tenths == tenth]) / whole for tenth in np.unique(tenths)]
            axis.plot(places, parts, color=COLOURS[agent], label=f"{label}, train memories")
            judged = [column(run / "evaluations.csv", head) for head in ("n_decisions", "mean_reward")]
            places = 100 * judged[0] / whole
            axis.plot(places, judged[1], "o--", ms=4, color=COLOURS[agent], label=f"{label}, validation")
        axis.axhline(chance[env].mean, color="0.4", lw=1, ls=":", label="random, validation")
        axis.set(title=env, xlabel="share of the training [%]")
        axis.set_ylim(bottom=0)
    axes[0][0].set_ylabel("reward of an episode")
    axes[0][0].legend(fontsize=8, loc="lower right")
    figure.savefig(DOCS / "images" / "agents.png", dpi=110)


def card(name: str, chance: Score) -> tuple[str, bool]:
    """Return the card of one agent, and whether it is told apart from chance."""
    header = load_agent(name).header
    score = header.score
    assert score is not None
    low, high = score.interval
    gain = np.array([a.reward - b.reward for a, b in zip(score.episodes, chance.episodes, strict=True)])
    by_memory = gain.reshape(len(score.memories), -1).mean(axis=1)
    drawn = np.random.default_rng(0).integers(len(by_memory), size=(10_000, len(by_memory)))
    gain_low, gain_high = np.quantile(by_memory[drawn].mean(axis=1), [0.025, 0.975])
    shares = [one.appropriateness_pct for one in score.episodes if one.appropriateness_pct is not None]
    how = "its likeliest actions" if score.deterministic else "actions drawn from its policy"
    film = f"images/agents/{name.replace('/', '-')}.gif"
    shown = f"![Three finds of {name}, one after the other]({film})\n\n" if (DOCS / film).is_file() else ""
    text = f"""## {name}

| | |
| --- | --- |
| reward of an episode, validation memories | {score.mean:.2f} ({low:.2f} to {high:.2f}) |
| more than random on the same memories and seeds | {gain.mean():+.2f} ({gain_low:+.2f} to {gain_high:+.2f}) |
| appropriate actions | {np.mean(shares):.1f} % |
| episodes | {len(score.episodes)}: {len(score.memories)} memories, {len(score.seeds)} seeds; it plays {how} |
| trained with | {header.n_actions_training} decisions on the train memories |

{shown}`{header.command}`
"""
    return text, bool(gain_low > 0.0)


def main() -> None:
    """Write all cards and the picture."""
    runs = Path(sys.argv[1])
    names = sorted(shipped_agents(), key=lambda name: tuple(reversed(name.split("/"))))
    chance: dict[str, Score] = {}
    cards = []
    for name in names:
        score = load_agent(name).header.score
        assert score is not None
        env = name.split("/")[1]
        if env not in chance:
            episodes = evaluate_agent(make_agent("random"), score.env, score.memories, score.seeds)
            chance[env] = Score(score.env, True, episodes)
        cards.append(card(name, chance[env]))
    draw(runs, names, chance)
    rows = "\n".join(
        f"| {env} | {score.mean:.2f} ({score.interval[0]:.2f} to {score.interval[1]:.2f}) |"
        for env, score in chance.items()
    )
    (DOCS / "agent_cards.md").write_text(
        HEAD.format(rows=rows, n_better=sum(better for _, better in cards), n_agents=len(cards))
        + "\n"
        + "\n".join(text for text, _ in cards),
        encoding="utf-8",
    )


HEAD = """# Cards of the shipped agents

Written by `docs/make_agent_cards.py` from the bundles themselves. `cn.load_agent("ppo/BoxingMental-v0")` loads one,
`creative-nao agent run NAME --replay` plays its recorded score again and says whether it is reproduced.

All learned on the 30 memories of the bank's train part and are scored here on the six of the validation part, which
also chose the weights that were kept; the recorded episodes have other seeds. The twelve test memories played no part.
Intervals are 95 % bootstrap intervals over memories. The agents for `Boxing-v0` were trained in its mental twin and are
scored in physics.

The training of each took minutes of one core. Those for `Boxing-v0` and `BoxingMental-v0` choose among cells of the PB
space and learned with its axes flipped and swapped; those for `BoxingModulation-v0` have the plain policies. A search
of hyperparameters found nothing better ([how, and other seeds](trained_agents.md)). How much of what they learned
carries over to unseen memories is what the second row of each card says; an interval that holds 0 means: not told apart
from chance. Clips show the three best finds of an episode on half/10, drawn by
`docs/make_agent_clips.py`.

Better than chance beyond doubt: {n_better} of {n_agents}.

![Reward in training and on validation memories](images/agents.png)

| environment | random: reward of an episode |
| --- | --- |
{rows}
"""

if __name__ == "__main__":
    main()
