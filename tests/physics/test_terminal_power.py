"""What a meter at the terminals does not see: what is lost inside the battery."""

import dataclasses

import pytest

from homeward import load_robot
from homeward.physics import EFFECTS, d_max
from homeward.physics.terminal_power import at_terminals, lost_inside

HUSKY = load_robot("husky")


def test_losses_inside_are_effects_of_the_battery_alone() -> None:
    inside = {effect.id for effect in EFFECTS if lost_inside(effect)}
    assert inside == {"internal_resistance", "rate_capacity", "ageing", "cold_battery"}


def test_a_robot_without_them_is_itself() -> None:
    loaded = dataclasses.replace(HUSKY, effects={"standby": {"power_w": 5.0}})
    assert at_terminals(HUSKY) is HUSKY and at_terminals(loaded) is loaded


@pytest.mark.parametrize("other", [{}, {"standby": {"power_w": 5.0}}])
def test_only_they_are_taken_out(other: dict[str, dict[str, float]]) -> None:
    sags = dataclasses.replace(HUSKY, effects={"internal_resistance": {"ohm": 0.1}, **other})
    seen = at_terminals(sags)
    assert seen == dataclasses.replace(HUSKY, effects=other)
    # What the meter does not see shortens the range all the same.
    assert float(d_max(seen, 0.8)) > 1.01 * float(d_max(sags, 0.8))
