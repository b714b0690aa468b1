"""Demonstrations made in the page: what they are, what is refused, and what is said about bad ones."""

import numpy as np
import pytest

from creative_nao.demonstrations.keyframes import ACTIONS, DT_S, N_STEPS, keyframes
from creative_nao.errors import CreativeNaoError, SettingsError
from creative_nao.explorer.keyframes import MAX_DRAFTS, MAX_KEYS, Draft, Key, KeyframeSet, Rows, boxing
from creative_nao.schema import parse

GUARD = boxing().drafts[0].keys[0].posture


def made(*times, name="wave", angle=None, at=1):
    """The guard at these times; at one of them the right shoulder is elsewhere."""
    postures = [GUARD] * len(times)
    if angle is not None:
        postures[at] = (angle, *GUARD[1:])
    return Draft(name, tuple(map(Key, times, postures)))


def waving(name="wave", angle=0.2):
    """A second and a half in which the right shoulder goes up and down."""
    return made(0.0, 0.75, 1.5, name=name, angle=angle)


def test_the_boxing_set_is_the_shipped_key_postures():
    boxing_set = boxing()
    assert [draft.name for draft in boxing_set.drafts] == list(ACTIONS)
    for draft in boxing_set.drafts:
        meant = keyframes(draft.name).at(np.arange(N_STEPS) * DT_S)
        np.testing.assert_allclose(draft.trajectory(), meant, atol=0.03)  # times are whole hundredths here
    assert boxing_set.shortcomings() == boxing_set.advice() == []
    assert KeyframeSet.from_rows(parse(Rows, boxing_set.to_text(), "rows")) == boxing_set
    told = boxing_set.as_json()
    assert told["faults"] == [None] * 6
    assert np.shape(told["movements"][0]) == boxing_set.drafts[0].trajectory().shape


def test_too_fast_is_one_line_that_says_how_to_mend_it():
    draft = made(0.0, 0.3, 1.5, name="swing", angle=-2.0)
    said = draft.fault()
    assert said == ("swing: RShoulderPitch reaches 18.1 rad/s between 0.00 and 0.30 s, its motor 7.9; give it 0.69 s")
    assert draft.peak_speeds()[0, 0] == pytest.approx(1.875 * 2.9 / 0.3)
    fine = np.gradient(draft.movement().at(np.arange(0, 0.3, 1e-4))[:, 0], 1e-4)
    assert np.abs(fine).max() == pytest.approx(draft.peak_speeds()[0, 0], rel=1e-3)  # the factor is that of the curve
    assert made(0.0, 0.69, 1.5, angle=-2.0).fault() is None


def test_what_cannot_be_learned_is_said_in_one_line():
    assert "hardly moves, its widest joint travels 0.00 rad" in made(0.0, 1.5).fault()
    alone = KeyframeSet((waving(),))
    assert alone.shortcomings() == [
        "a memory needs two demonstrations or more; add one, or the mirror image of the first"
    ]
    one_arm = KeyframeSet((waving(), waving("again", 0.0)))
    assert one_arm.shortcomings() == []
    assert "LShoulderPitch" in one_arm.advice()[0]
    assert "never moves in any demonstration and is learned as still" in one_arm.advice()[0]
    assert any("wave and again are" in line and "count as one movement" in line for line in one_arm.advice())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: Draft("../../etc/passwd", d.keys), "`name` should be a letter"),
        (lambda d: Draft("x" * 25, d.keys), "`name` should be a letter"),
        (lambda d: Draft("", d.keys), "`name` should be a letter"),
        (lambda d: made(0.0, 1.48, 1.5), "follow each other by 0.05 s or more"),
        (lambda d: made(0.0, 12.5), "end by 12 s"),
        (lambda d: made(0.2, 1.5), "begin at 0 s"),
        (lambda d: made(0.0, float("nan")), "`time_s` should be a finite number"),
        (
            lambda d: Draft("x", (Key(0, (0.0,) * 7), Key(1, (0.0,) * 8))),
            "`posture` should be a list of at least 8 entries",
        ),
        (lambda d: Key(0, (float("nan"),) * 8), "`posture`, entry 1 should be a finite number"),
        (lambda d: Key(0, (9.0,) * 8), "the posture at 0 s should lie in the joints' ranges"),
        (lambda d: Draft("x", tuple(Key(0.1 * k, d.keys[0].posture) for k in range(MAX_KEYS + 1))), "2 to 81 keys"),
        (
            lambda d: KeyframeSet(tuple(Draft(f"d{k}", d.keys) for k in range(MAX_DRAFTS + 1))),
            "there may be 8 demonstrations",
        ),
        (lambda d: Draft("x", d.keys[:1]), "should have 2 to 81 keys, but has 1"),
        (lambda d: KeyframeSet((d, d)), "two demonstrations are called wave"),
    ],
)
def test_bounds_are_kept_and_named(change, said):
    with pytest.raises(SettingsError, match=said.replace("(", r"\(")):
        change(waving())


@pytest.mark.parametrize(
    "text",
    ["", "[", "null", "[[]]", '[["a"]]', '[["a", [[0], [1]]]]', '[["a", 3]]', '{"a": 1}', "[" * 5000,
     "[]", '[["a", [["0", "x"], []]]]', '[[1, []]]', '[["a", [[NaN]]]]', '[["<b>", []]]'],
)  # fmt: skip
def test_text_of_nonsense_is_refused(text):
    with pytest.raises(CreativeNaoError):
        KeyframeSet.from_rows(parse(Rows, text, "rows"))
