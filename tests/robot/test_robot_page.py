"""What docs/robot.md tells of the robot is what the code has and what the robot does."""

import re
from pathlib import Path

import pytest

from creative_nao.robot import PhysicalLimits, ServoSettings
from creative_nao.robot.performance import FALL_HEIGHT_M, FALL_TILT_RAD

PAGE = (Path(__file__).parents[2] / "docs" / "robot.md").read_text(encoding="utf-8")


def row(first_cell):
    """Return the cells of the one table row that begins with this."""
    found = [line for line in PAGE.splitlines() if line.startswith(f"| {first_cell} |")]
    assert len(found) == 1, first_cell
    return [cell.strip() for cell in found[0].strip("|").split("|")]


def test_the_servos_are_those_of_the_page():
    ours = ServoSettings()
    told = re.search(
        r"Chosen: kp (\S+) N m/rad, kd (\S+) N m s/rad, damping (\S+) N m s/rad,\s+dry friction (\S+) N m,", PAGE
    )
    assert told is not None
    assert tuple(map(float, told.groups())) == (ours.arm_kp, ours.arm_kd, ours.damping, ours.friction_loss)


def test_the_thresholds_are_those_of_the_page():
    limits = PhysicalLimits()
    told = {
        "`joint_limit`": f"more than {limits.joint_limit_rad} rad",
        "`fell`": f"below {FALL_HEIGHT_M} m or leaning by more than {FALL_TILT_RAD} rad",
        "`self_collision`": f"more than {100 * limits.self_collision_share:.0f} %",
        "`torque_saturated`": f"more than {100 * limits.torque_saturated_share:.0f} %",
        "`tracking_error`": f"above {limits.tracking_error_rad} rad",
    }
    for outcome, words in told.items():
        assert words in row(outcome)[1], outcome


def test_the_basic_actions_hit_as_the_page_says(performances, demos):
    for name in demos.names:
        _, hits, impulse, _, force, speed, _, error, saturated = row(name)
        done = performances[name]
        assert done.hits.count == int(hits), name
        assert done.hits.impulse_ns == pytest.approx(float(impulse), abs=0.02), name
        assert done.hits.peak_force_n == pytest.approx(float(force), abs=1.5), name
        assert done.fist_peak_speed_m_s.max() == pytest.approx(float(speed), abs=0.02), name
        assert done.mean_error_rad.max() == pytest.approx(float(error), abs=0.001), name
        assert 100 * done.saturated_share.max() == pytest.approx(float(saturated), abs=0.1), name
