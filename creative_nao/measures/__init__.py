"""How creative a set of actions is: NumPy arrays of joint angles in, numbers out.

docs/measures.md presents all measures. What the functions have in common is told here once:

- `trajectories`: a list of (n_steps, n_joints) arrays, whose lengths may differ, or one (n, n_steps, n_joints) array
  [rad], at the tick of the basic actions. One alone is ``trajectory[None]``.
- `demos`: the basic actions, anything with `trajectories` and `dt_s`; `criteria`: where the lines between outcomes are
  drawn; `appropriate`: a mask (n,) of bool, which actions count, if that is known already.
- `rng`: a generator or a seed for one.
- Arrays that do not fit or are not finite raise `ShapeError`, settings out of range `SettingsError`; the message names
  the argument. Nothing here knows of networks or robots; numba is loaded by the first distance, not by the import.
"""

from creative_nao.measures.attribution import Attribution, Stretch, attribution
from creative_nao.measures.coverage import (
    DensityCoverage,
    GridQuality,
    density_coverage,
    first_novel,
    grid_quality,
    oracle_share,
    regret,
    unexpectedness,
)  # fmt: skip
from creative_nao.measures.diversity import (
    Draws,
    FarthestPoints,
    Table,
    diversity,
    dtw_similarity,
    farthest_points,
    mean_pairwise_distance,
    novelty,
    reward_scale,
    table,
    vendi_score,
)  # fmt: skip
from creative_nao.measures.dtw import dtw, dtw_matrix, dtw_pairs, warping, warping_diversity, warping_path
from creative_nao.measures.outcome import (
    OUTCOMES,
    BasicActions,
    Criteria,
    Scores,
    excursion_limit,
    excursions,
    is_appropriate,
    largest_speeds,
    score,
    speed_limits,
)  # fmt: skip

__all__ = [  # noqa: RUF022 - in reading order
    "dtw", "dtw_matrix", "dtw_pairs", "score", "Scores", "OUTCOMES", "attribution", "Attribution", "Stretch",
    "Criteria", "BasicActions", "is_appropriate", "largest_speeds", "speed_limits", "excursions", "excursion_limit",
    "novelty", "diversity", "Draws", "mean_pairwise_distance", "table", "Table", "farthest_points", "FarthestPoints",
    "reward_scale", "vendi_score", "dtw_similarity", "density_coverage", "DensityCoverage", "warping",
    "warping_diversity", "warping_path", "grid_quality", "GridQuality", "oracle_share", "regret", "first_novel",
    "unexpectedness",
]  # fmt: skip
