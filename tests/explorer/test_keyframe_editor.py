"""Demonstrations made in the page: what they are, what is refused, and what is said about bad ones."""

import numpy as np
import pytest

from creative_nao.demonstrations.keyframes import ACTIONS, DT_S, N_STEPS, keyframes
from creative_nao.errors import CreativeNaoError, SettingsError
from creative_nao.explorer.keyframe_editor import (
    MAX_DRAFTS,
    MAX_KEYS,
    Draft,
    Key,
    KeyframeSet,
    blank,
    boxing,
)
from creative_nao.joints import JOINTS, limits


def waving(name="wave", angle=0.2):
    """A second and a half in which the right shoulder goes up and down."""
    draft, key = blank(name).with_key(0.75)
    return draft.posed(key, 0, angle)


def test_the_boxing_set_is_the_shipped_key_postures():
    boxing_set = boxing()
    assert [draft.name for draft in boxing_set.drafts] == list(ACTIONS)
    for draft in boxing_set.drafts:
        meant = keyframes(draft.name).at(np.arange(N_STEPS) * DT_S)
        np.testing.assert_allclose(draft.trajectory(), meant, atol=0.03)  # times are whole hundredths here
    assert boxing_set.shortcomings() == boxing_set.advice() == []
    assert KeyframeSet.from_text(boxing_set.to_text()) == boxing_set


def test_a_key_is_added_on_the_curve_and_removed():
    draft = waving()
    longer, place = draft.with_key(0.4)
    assert place == 1
    np.testing.assert_allclose(longer.keys[1].posture, draft.movement().at(np.array([0.4]))[0])
    assert longer.without_key(1) == draft
    assert draft.without_key(0).keys[0].time_s == 0.0
    with pytest.raises(SettingsError, match="should have 2 to 24 keys, but has 1"):
        blank().without_key(1)


def test_no_joint_leaves_its_range():
    low, high = limits()
    for joint in range(len(JOINTS)):
        assert waving().posed(0, joint, -9).keys[0].posture[joint] == low[joint]
        assert waving().posed(0, joint, 9).keys[0].posture[joint] == high[joint]


def test_the_mirror_image_of_the_mirror_image_is_the_same():
    draft = waving()
    other = draft.mirrored("other")
    assert other.keys[1].posture[4] == draft.keys[1].posture[0]
    assert other.mirrored("wave") == draft
    assert boxing().drafts[2].mirrored("right_hook").keys == boxing().drafts[3].keys


def test_too_fast_is_one_line_that_says_how_to_mend_it():
    draft, key = blank("swing").with_key(0.3)
    draft = draft.posed(key, 0, -2.0)
    said = draft.fault()
    assert said == ("swing: RShoulderPitch reaches 18.1 rad/s between 0.00 and 0.30 s, its motor 7.9; give it 0.69 s")
    assert draft.peak_speeds()[0, 0] == pytest.approx(1.875 * 2.9 / 0.3)
    fine = np.gradient(draft.movement().at(np.arange(0, 0.3, 1e-4))[:, 0], 1e-4)
    assert np.abs(fine).max() == pytest.approx(draft.peak_speeds()[0, 0], rel=1e-3)  # the factor is that of the curve
    assert draft.at_time(key, 0.69).fault() is None


def test_what_cannot_be_learned_is_said_in_one_line():
    assert "hardly moves, its widest joint travels 0.00 rad" in blank().fault()
    alone = KeyframeSet((waving(),))
    assert alone.shortcomings() == [
        "a memory needs two demonstrations or more; add one, or the mirror image of the first"
    ]
    one_arm = KeyframeSet((waving(), waving("again", 0.0)))
    assert "LShoulderPitch" in one_arm.shortcomings()[0]
    assert "never moves in any demonstration; add a mirror image" in one_arm.shortcomings()[0]
    assert any("wave and again are" in line and "count as one movement" in line for line in one_arm.advice())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: Draft("../../etc/passwd", d.keys), "`name` should be a letter"),
        (lambda d: Draft("x" * 25, d.keys), "`name` should be a letter"),
        (lambda d: Draft("", d.keys), "`name` should be a letter"),
        (lambda d: d.at_time(1, 1.48), "follow each other by 0.05 s or more"),
        (lambda d: d.at_time(2, 12.5), "end by 12 s"),
        (lambda d: d.at_time(0, 0.2), "begin at 0 s"),
        (lambda d: d.at_time(2, float("nan")), "`time_s` should be a finite number"),
        (
            lambda d: Draft("x", (Key(0, (0.0,) * 7), Key(1, (0.0,) * 8))),
            "`posture` should be a list of at least 8 entries",
        ),
        (lambda d: Key(0, (float("nan"),) * 8), "`posture`, entry 1 should be a finite number"),
        (lambda d: Key(0, (9.0,) * 8), "the posture at 0 s should lie in the joints' ranges"),
        (lambda d: Draft("x", tuple(Key(0.1 * k, d.keys[0].posture) for k in range(MAX_KEYS + 1))), "2 to 24 keys"),
        (
            lambda d: KeyframeSet(tuple(Draft(f"d{k}", d.keys) for k in range(MAX_DRAFTS + 1))),
            "there may be 8 demonstrations",
        ),
        (lambda d: KeyframeSet((d, d)), "two demonstrations are called wave"),
    ],
)
def test_bounds_are_kept_and_named(change, said):
    with pytest.raises(SettingsError, match=said.replace("(", r"\(")):
        change(waving())


@pytest.mark.parametrize(
    "text",
    ["", "[", "null", "[[]]", '[["a"]]', '[["a", [[0], [1]]]]', '[["a", 3]]', '{"a": 1}', "[" * 5000, "x" * 60_001,
     "[]", '[["a", [["0", "x"], []]]]', '[[1, []]]', '[["a", [[NaN]]]]', '[["<b>", []]]'],
)  # fmt: skip
def test_text_of_nonsense_is_refused(text):
    with pytest.raises(CreativeNaoError):
        KeyframeSet.from_text(text)


def test_names_are_found_that_nobody_has():
    keyframes = KeyframeSet((blank("a"), blank("a_2")))
    assert keyframes.free_name("a") == "a_3"
    assert keyframes.free_name("b") == "b"
