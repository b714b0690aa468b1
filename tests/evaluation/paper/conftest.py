import numpy as np
import pytest


@pytest.fixture
def make_networks():
    """Figures of networks whose conditions differ as asked: `field={"open": (mean, ...), ...}`."""

    def make(n_seeds=8, spread=0.1, **means):
        rng = np.random.default_rng(5)
        networks = []
        for condition in ("open", "half", "closed"):
            for seed in range(n_seeds):
                one = {
                    "name": f"{condition}/{seed}", "condition": condition, "seed": seed, "n_epochs": 100,
                    "best_loss": 1.0, "epochs_to_level": 50, "unsteadiness": 1.0, "n_reproduced": 2,
                    "reproduction_dtw": {"jab": 1.0, "hook": 2.0}, "region_pct": {"jab": 3.0, "hook": 2.0},
                    "unlearned_pct": 50.0, "learned_pct": 30.0, "appropriateness_pct": 80.0, "fluctuating_pct": 20.0,
                    "non_moving_pct": 0.0, "novelty": 20.0, "diversity": 40.0, "n_regions": 100.0,
                    "border_length": 50.0, "ruggedness": 4.0, "evenness": 0.5, "steep_step_pct": 1.0,
                    "combination_pct": 1.0, "clearest_combination": None, "n_pairs_between": 1,
                }  # fmt: skip
                for field, per_condition in means.items():
                    value = per_condition[condition]
                    noise = spread * rng.standard_normal() if isinstance(value, float) else 0
                    one[field] = value if value is None or not noise else value + noise
                networks.append(one)
        return networks

    return make
