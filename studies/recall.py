"""Why recordings get lost in training, and what gives them back: which basic actions return, by condition and seed.

`python studies/recall.py FOLDER ... --compared boxing NAME` trains on each folder, and on sets of six where one holds
twelve recordings or more, beside the shipped boxing actions; `--page docs/recall.md` writes the page. A network that is
in the result file is not trained again.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from creative_nao import storage
from creative_nao.demonstrations import Demonstrations, load_demonstrations
from creative_nao.evaluation.pages import render
from creative_nao.evaluation.suites import BOXING, Taught
from creative_nao.measures import Criteria, dtw
from creative_nao.model import TrainingSettings, reproduction, train_network
from creative_nao.model.config import AUTO
from creative_nao.runtime import sha256

HELD = {"ending": "held"}
MEAN = {"first_input": "mean"}
VARIANTS = {
    "half": {},
    "half, first posture the mean": MEAN,
    "half, first posture the mean, end held": {**MEAN, **HELD},
    "closed": {"closed_loop_ratio": 1.0},
    "closed, first posture the mean": {"closed_loop_ratio": 1.0, **MEAN},
    "auto": {"condition": "auto"},
}
"""What is compared: what a network reads first, and what is asked past an action's end; `auto` is closed with both."""
assert AUTO == {"closed_loop_ratio": 1.0, **MEAN, **HELD}
N_EPOCHS, AUTO_EPOCHS = 20_000, 60_000


def recall(demonstrations: Demonstrations, variant: str, seed: int) -> dict:
    """Train once and measure what comes back up to an action's end, and in a movement of the default length."""
    n_epochs = AUTO_EPOCHS if variant == "auto" else N_EPOCHS
    memory = train_network(demonstrations, TrainingSettings(seed=seed, n_epochs=n_epochs, **VARIANTS[variant]))
    pairs = zip(memory.generate(memory.pb), demonstrations.trajectories, strict=True)
    return {
        "dtw": dict(zip(demonstrations.names, reproduction(memory), strict=True)),
        "worst_whole": max(dtw(*pair) for pair in pairs),
        "attempts": len(memory.record.get("attempts", [None])),
    }


def shown(measured: dict[str, dict[str, dict]]) -> dict[str, dict]:
    """Return of each variant the worst distances seed by seed, and how many networks give everything back."""
    found = {}
    for variant, rows in measured.items():
        worst = [max(row["dtw"].values()) for row in rows.values()]
        found[variant] = {
            "worst": worst,
            "whole": [row["worst_whole"] for row in rows.values()],
            "n_back": sum(distance <= Criteria().learned_threshold for distance in worst),
            "n": len(worst),
            "n_attempts": sum(row["attempts"] for row in rows.values()),
        }
    return found


def main() -> None:
    """Train what is missing in the result file, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--seeds", type=int, default=10, help="of auto")
    parser.add_argument("--few", type=int, default=3, help="seeds of the other variants, on the sets of --compared")
    parser.add_argument("--compared", nargs="*", default=["boxing"], help="sets on which all variants are tried")
    parser.add_argument("--out", type=Path, default=Path("docs/results/recall/recall.json"))
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    found = json.loads(storage.read_text(asked.out, "results")) if asked.out.exists() else {"sets": {}, "files": {}}
    for one in Taught(seeds=(0,), conditions=("half",), sets=(BOXING,)).on(asked.folders).sets if asked.folders else ():
        demos = load_demonstrations(one.demonstrations)
        names = one.actions or demos.names
        demos = Demonstrations(names, [demos.trajectory(name) for name in names], demos.dt_s, demos.joints)
        if one.demonstrations is not None:
            paths = sorted(Path(one.demonstrations).iterdir())
            found["files"] |= {path.name: sha256(path) for path in paths if path.stem in names}
        entry = found["sets"].setdefault(one.name, {"ticks": [len(t) for t in demos.trajectories], "recall": {}})
        first = [trajectory[0] for trajectory in demos.trajectories]
        entry["first_posture_rad"] = float(np.linalg.norm(first - demos.initial_posture, axis=1).max())
        for variant in VARIANTS:
            few = asked.few if one.name in asked.compared else 0
            for seed in range(asked.seeds if variant == "auto" else few):
                rows = entry["recall"].setdefault(variant, {})
                if str(seed) not in rows:
                    rows[str(seed)] = recall(demos, variant, seed)
                    storage.write_text(asked.out, json.dumps(found) + "\n")
                    print(one.name, variant, seed, f"{max(rows[str(seed)]['dtw'].values()):.2f}", flush=True)
    if asked.page is not None:
        found["sets"] = {name: {**entry, "recall": shown(entry["recall"])} for name, entry in found["sets"].items()}
        values = {"threshold": Criteria().learned_threshold, "variants": list(VARIANTS)[:-1], **found}
        folder = Path(__file__).parent.parent / "docs" / "templates"
        storage.write_text(asked.page, render("recall.md.jinja", folder, **values))


if __name__ == "__main__":
    main()
