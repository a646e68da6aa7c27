"""The latest place to turn lies where the margin ends, and a robot is told in time to turn
there."""

import pytest

from homeward.companion.turn_advice import Turn, latest, when_to_turn


def margin_j(onwards_m: float) -> float:
    """Of a robot that uses up its margin of 1000 J in 500 m."""
    return 1000.0 - 2.0 * onwards_m


def asked(reaction_s: float = 10.0, draws_w: float = 1.0, now_j: float = 1000.0) -> Turn:
    return when_to_turn(
        margin_j, now_j, most_m=5000.0, pace_mps=1.0, draws_w=draws_w, reaction_s=reaction_s
    )


def test_it_turns_where_its_margin_ends() -> None:
    turn = asked()
    assert turn.in_m == turn.in_s == pytest.approx(500.0, abs=1.0) and not turn.is_due
    assert latest(margin_j, 1000.0, most_m=300.0) == 300.0  # no farther than is asked


def test_a_robot_that_needs_long_to_turn_is_told_sooner() -> None:
    assert asked(reaction_s=600.0).is_due


def test_standing_uses_the_margin_up_too() -> None:
    standing = asked(draws_w=50.0)
    assert standing.in_s == pytest.approx(20.0) and not standing.is_due
    assert asked(draws_w=50.0, reaction_s=30.0).is_due


def test_without_a_margin_it_turns_at_once() -> None:
    assert asked(now_j=-5.0) == Turn(0.0, 0.0, is_due=True)
