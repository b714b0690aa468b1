"""The verdicts follow from the networks: planted orders are found, reversed ones refused, equal ones left open."""

import pytest

from creative_nao.evaluation.paper.claims import (
    CLAIMS,
    CONVERGED_LEVEL,
    FAILS,
    HOLDS,
    OWNED_PCT,
    SHOWS,
    UNDECIDED,
    judge,
)

AS_IN_THE_PAPER = {
    "novelty": {"open": 26.0, "half": 31.7, "closed": 18.5},
    "diversity": {"open": 43.1, "half": 48.0, "closed": 36.0},
    "appropriateness_pct": {"open": 83.4, "half": 82.8, "closed": 98.0},
    "learned_pct": {"open": 11.2, "half": 7.6, "closed": 40.0},
    "n_regions": {"open": 900.0, "half": 600.0, "closed": 300.0},
    "border_length": {"open": 90.0, "half": 60.0, "closed": 30.0},
    "ruggedness": {"open": 9.0, "half": 6.0, "closed": 3.0},
    "evenness": {"open": 3.0, "half": 6.0, "closed": 9.0},
    "unsteadiness": {"open": 1.0, "half": 1.0, "closed": 5.0},
    "epochs_to_level": {"open": 10, "half": 40, "closed": 70},
}


def verdicts(networks):
    return {one["key"]: one["verdict"] for one in judge(networks, seed=0)}


def test_networks_like_the_paper_make_every_claim_hold(make_networks):
    assert set(verdicts(make_networks(**AS_IN_THE_PAPER)).values()) == {HOLDS}


def test_the_opposite_order_makes_claims_fail(make_networks):
    turned = {
        field: {"open": means["closed"], "half": -means["half"], "closed": means["open"]}
        for field, means in AS_IN_THE_PAPER.items()
        if field not in ("epochs_to_level", "learned_pct")
    }
    found = verdicts(make_networks(**turned))
    for key in ("half-novel", "half-diverse", "closed-appropriate", "closed-unsteady", "simpler-regions", "more-even"):
        assert found[key] == FAILS, key


def test_conditions_that_do_not_differ_leave_orders_open(make_networks):
    same = {field: dict.fromkeys(means, 20.0) for field, means in AS_IN_THE_PAPER.items()}
    found = verdicts(make_networks(**{**same, "epochs_to_level": dict.fromkeys(("open", "half", "closed"), 20)}))
    orders = {key: verdict for key, verdict in found.items() if key not in ("own-region", "converges", "learned")}
    assert HOLDS not in {orders[key] for key in ("half-novel", "half-diverse", "closed-appropriate")}


def test_most_networks_that_cannot_do_it_make_a_claim_about_all_fail(make_networks):
    networks = make_networks()
    for one in networks:
        if one["condition"] == "open":
            one |= {"n_reproduced": 1, "epochs_to_level": None, "steep_step_pct": 0.0}
            one["region_pct"] = {"jab": 3.0, "hook": 0.01}
    found = verdicts(networks)
    assert {key for key, verdict in found.items() if verdict == FAILS} == {
        "learned", "converges", "open-fastest", "own-region", "abrupt",
    }  # fmt: skip


def test_a_network_that_never_converges_counts_with_all_its_epochs(make_networks):
    networks = make_networks(epochs_to_level={"open": 10, "half": None, "closed": None})
    claim = next(one for one in judge(networks, seed=0) if one["key"] == "open-fastest")
    assert claim["means"] == {"open": 10.0, "half": 100.0, "closed": 100.0}


def test_a_condition_without_a_figure_leaves_the_claim_open(make_networks):
    networks = make_networks(novelty={"open": 20.0, "half": None, "closed": 10.0})
    claim = next(one for one in judge(networks, seed=0) if one["key"] == "half-novel")
    assert (claim["verdict"], claim["differences"], claim["means"]["half"]) == (UNDECIDED, [], None)


def test_the_seed_decides_the_samples_and_nothing_else_does(make_networks):
    networks = make_networks(**AS_IN_THE_PAPER)
    assert judge(networks, seed=0) == judge(networks[::-1][::-1], seed=0)
    assert judge(networks, seed=0) != judge(networks, seed=1)


@pytest.mark.parametrize("condition", ["open", "half", "closed"])
def test_no_claim_depends_on_the_name_of_a_seed(make_networks, condition):
    networks = make_networks(**AS_IN_THE_PAPER)
    renamed = [{**one, "seed": one["seed"] + 50, "name": f"{one['condition']}/{one['seed'] + 50}"} for one in networks]
    assert verdicts(networks) == verdicts(renamed)


def test_every_claim_has_a_name_of_its_own_and_one_thing_that_decides_it():
    assert len({claim.key for claim in CLAIMS}) == len(CLAIMS) == 18
    assert {claim.key for claim in CLAIMS if not claim.pairs} == set(SHOWS)


def test_claims_tell_the_levels_that_decide_them():
    measured = {claim.key: claim.measured for claim in CLAIMS}
    assert all(f"below {100 * CONVERGED_LEVEL:g} % of" in measured[key] for key in ("converges", "open-fastest"))
    assert f"on at least {OWNED_PCT} % of the map" in measured["own-region"]
