"""How creative a set of actions is: NumPy arrays of joint angles in, numbers out.

Distance
    - `dtw`, `dtw_matrix`, `dtw_pairs`: dynamic time warping, its definition in `dtw.py`.
Each action
    - `score` -> `Scores`: its outcome, its novelty and the basic action it is nearest to.
    - `attribution` -> `Attribution`, `Stretch`: which basic action it resembles when.
    - `Criteria`, `BasicActions`: where the lines between outcomes are drawn; what counts as basic actions.
    - `is_appropriate`, `largest_speeds`, `speed_limits`, `excursions`, `excursion_limit`: the lines themselves.
A set of actions
    - `novelty`, `diversity` -> `Draws`: the paper's means over random samples.
    - `table` -> `Table`: the figures of the paper's Table I.
    - `farthest_points` -> `FarthestPoints`: the greedy oracle; `reward_scale`: the unit of its rewards.
    - `vendi_score`, `dtw_similarity`: how many different actions a set amounts to.
    - `density_coverage` -> `DensityCoverage`: how a set lies among those of a reference.
    - `warping`, `warping_diversity`, `warping_path`: differences in timing.
    - `grid_quality` -> `GridQuality`: QD score and coverage of a grid of descriptors.
A search
    - `oracle_share`, `regret`, `first_novel`: how much it found for its trying; `unexpectedness`: how rare that is.

Nothing here knows of networks or robots; numba is loaded by the first distance, not by the import.
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
)
from creative_nao.measures.diversity import (
    Draws,
    FarthestPoints,
    diversity,
    dtw_similarity,
    farthest_points,
    mean_pairwise_distance,
    novelty,
    reward_scale,
    vendi_score,
)
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
)
from creative_nao.measures.table import Table, table

__all__ = [  # noqa: RUF022 - in reading order
    "dtw",
    "dtw_matrix",
    "dtw_pairs",
    "score",
    "Scores",
    "OUTCOMES",
    "attribution",
    "Attribution",
    "Stretch",
    "Criteria",
    "BasicActions",
    "is_appropriate",
    "largest_speeds",
    "speed_limits",
    "excursions",
    "excursion_limit",
    "novelty",
    "diversity",
    "Draws",
    "mean_pairwise_distance",
    "table",
    "Table",
    "farthest_points",
    "FarthestPoints",
    "reward_scale",
    "vendi_score",
    "dtw_similarity",
    "density_coverage",
    "DensityCoverage",
    "warping",
    "warping_diversity",
    "warping_path",
    "grid_quality",
    "GridQuality",
    "oracle_share",
    "regret",
    "first_novel",
    "unexpectedness",
]
