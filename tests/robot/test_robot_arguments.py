"""A value of a wrong kind is one of our errors, which names the argument."""

import re

import numpy as np
import pytest

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.robot import (
    PhysicalLimits,
    PlaybackSettings,
    Renderer,
    RobotVariation,
    ServoSettings,
    imagined_frames,
    moments,
    posture,
    write_gif,
)

RESTING = np.zeros((3, 8))
CASES = [
    (lambda p, s: p.perform([["a", 1]], 0.15), ShapeError, "`trajectory` should be an array of numbers, but is list"),
    (lambda p, s: p.perform(None, 0.15), ShapeError, "`trajectory` should have shape (n_steps >= 1, 8)"),
    (lambda p, s: p.perform(RESTING, "fast"), SettingsError, "`dt_s` should be a number, but is 'fast'"),
    (lambda p, s: imagined_frames(s, "punch", 0.15), ShapeError, "should be an array of numbers, but is str"),
    (lambda p, s: imagined_frames(s, RESTING, 0), SettingsError, "`dt_s` should be above 0, but is 0"),
    (lambda p, s: moments(RESTING, 1.5), SettingsError, "`n_moments` should be a whole number, but is 1.5"),
    (lambda p, s: write_gif([RESTING], "a.gif", frame_dt_s="x"), ShapeError, "`images` should be pictures"),
    (lambda p, s: Renderer(s.model, "wide"), SettingsError, "`width` should be a whole number, but is 'wide'"),
    (lambda p, s: posture(5), SettingsError, "`name` should be text, but is 5"),
    (lambda p, s: s.stiffness.set(("RElbowRoll",), "soft"), SettingsError, "`stiffness` should be a number"),
    (lambda p, s: PhysicalLimits(tracking_error_rad="x"), SettingsError, "`tracking_error_rad` should be a number"),
    (lambda p, s: ServoSettings(arm_kp=True), SettingsError, "`arm_kp` should be a number, but is True"),
    (lambda p, s: PlaybackSettings(settle_s=-1), SettingsError, "`settle_s` should be at least 0, but is -1"),
    (lambda p, s: RobotVariation(weight=2.0), SettingsError, "no key `weight`"),
]


@pytest.mark.parametrize(("call", "error", "message"), CASES, ids=range(len(CASES)))
def test_a_value_of_a_wrong_kind_is_named(performer, scene, call, error, message):
    with pytest.raises(error, match=re.escape(message)):
        call(performer, scene)
