"""Formulas in plain Python compute what compiled kernels compute."""

from __future__ import annotations

import dataclasses
from typing import Any

import numba
import numpy as np

from homeward import load_robot
from homeward.physics.effects import EFFECTS
from homeward.physics.kernel import Conditions, demand, full_charge
from homeward.physics.plain import plain

HILL = Conditions(0.8, 10.0, 0.1, 0.05, 0.9987, 0.2, 1.0, 2.0, -5.0, 30.0, 1.0)


def test_a_power_with_every_effect_is_that_of_compiled_code() -> None:
    switches = {effect.id: {effect.switch.name: 1e-3} for effect in EFFECTS}
    robot = dataclasses.replace(load_robot("husky"), effects=switches)
    states = [full_charge(robot) for _ in range(2)]
    for state in states:
        state["step_s"] = 1.0

    @numba.njit(error_model="numpy")
    def compiled_demand(records: Any, state: Any) -> float:
        return float(demand(records[0], state[0], HILL))

    compiled_w = compiled_demand(robot.record(), states[0])
    assert np.isclose(
        demand(plain(robot.record())[0], plain(states[1])[0], HILL), compiled_w, rtol=1e-14
    )
    np.testing.assert_allclose(states[1]["parts_w"], states[0]["parts_w"], rtol=1e-12)


def test_single_precision_only_stores() -> None:
    """Arithmetic of NumPy with a number of single precision would stay in it."""
    stored = np.zeros(1, [("share", np.float32)])
    record = plain(stored)[0]
    record.share = 0.1
    assert record.share * 3.0 == float(np.float32(0.1)) * 3.0
    assert stored["share"][0] == np.float32(0.1)
