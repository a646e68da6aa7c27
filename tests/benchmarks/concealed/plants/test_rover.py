"""Cases of the rover: they come from their seed, and the file of a control describes it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("mujoco")

from benchmarks.concealed.plants import rover
from benchmarks.concealed.plants import rover_scenarios as hidden
from benchmarks.concealed.plants.rover_engine import drive


def test_a_seed_always_gives_the_same_case_and_controls_lack_nothing() -> None:
    first, again = (
        rover.make(0, hidden.turning, "high", np.random.default_rng(2), short=True)
        for _ in range(2)
    )
    for frame, same in zip(first.recordings, again.recordings, strict=True):
        pd.testing.assert_frame_equal(frame, same)
        assert np.isfinite(frame.to_numpy()).all()
        assert {"power_w", "motor_left_a"} & set(frame) and {"speed_mps", "wheel_left_mps"} & set(
            frame
        )
    assert first.visible == {"turning": True}
    scenario = hidden.level(np.random.default_rng(3))
    robot = rover.calibrated(scenario)
    log = drive(scenario.rover, rover.cut(scenario.trips[0]))
    expected_w = (
        robot.controller_w
        + robot.rolling_resistance
        * robot.mass_kg
        * 9.80665
        * log.speed_mps
        / (1.0 - robot.friction_loss)
    )
    assert np.sqrt(np.mean((log.power_w - expected_w) ** 2)) < 0.005 * log.power_w.mean()
