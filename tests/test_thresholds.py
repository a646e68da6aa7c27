"""Thresholds that packages share."""

import math

import pytest

from homeward import thresholds
from homeward.companion import Companion
from homeward.envs.routes.route import LIMITS
from homeward.logs.channels import CHANNELS


def test_recordings_and_readings_have_the_same_limits() -> None:
    assert (
        CHANNELS["grade_rad"].high
        == thresholds.STEEPEST_RAD
        == -CHANNELS["grade_rad"].low
        == LIMITS["grade_rad"][1]
    )
    assert CHANNELS["voltage_v"].high == thresholds.MOST_VOLTAGE_V
    assert CHANNELS["sensing_hz"].high == thresholds.MOST_SENSING_HZ
    assert {CHANNELS[name].high for name in ("current_a", "motor_left_a", "motor_right_a")} == {
        thresholds.MOST_CURRENT_A
    }


@pytest.mark.parametrize("times", [0.999, 1.001])
def test_a_reading_beyond_a_limit_is_left_out(times: float) -> None:
    advice = Companion("husky", home="here").update(
        0.0,
        speed_mps=0.5,
        grade_rad=times * thresholds.STEEPEST_RAD,
        heading_rad=times * thresholds.MOST_HEADING_RAD,
    )
    said = [text.split(" left out")[0] for text in advice.warnings]
    assert said == ([] if times < 1.0 else ["impossible grade_rad", "impossible heading_rad"])


def test_limits_detect_another_unit() -> None:
    assert math.degrees(thresholds.STEEPEST_RAD) == pytest.approx(46.0, abs=0.2)
    assert thresholds.MOST_HEADING_RAD / math.tau == pytest.approx(159.0, abs=0.2)
    # The coldest in K is hotter than the hottest.
    assert thresholds.MOST_TEMPERATURE_C < 273.15 - thresholds.MOST_TEMPERATURE_C
