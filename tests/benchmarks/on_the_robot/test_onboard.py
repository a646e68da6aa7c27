"""What the policy is given beforehand is what is compared, on the same missions."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from benchmarks.on_the_robot import onboard
from benchmarks.on_the_robot.onboard import GIVEN, Args, driven, main
from homeward.agents.onboard import Onboard
from homeward.companion import Advice, Companion
from homeward.envs.options import OptionError
from homeward.envs.state import RETURN
from tests.envs.conditions.reading import ReadRobot

DECISIONS = 3


def drives(
    given: str, monkeypatch: pytest.MonkeyPatch
) -> tuple[list[tuple[float, bool]], list[Any]]:
    """Results of two missions that are over after some decisions, and those decisions."""
    made: list[Any] = []
    whole = ReadRobot.drive

    def some(robot: ReadRobot, action: Any) -> bool:
        made.append(action.tolist())
        return whole(robot, action) or len(made) % DECISIONS == 0

    monkeypatch.setattr(ReadRobot, "drive", some)
    return list(driven(Args(missions=2), given)), made


def test_who_is_not_home_scores_nothing_and_missions_are_those_of_the_seed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, made = drives("all", monkeypatch)
    assert found == [(0.0, False)] * 2 and len(made) == 2 * DECISIONS


def test_who_heeds_the_advice_to_turn_heads_home_whatever_the_policy_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Companion, "update", turned(Companion.update))
    for given, home in ((GIVEN[2], False), (GIVEN[3], True)):
        _, made = drives(given, monkeypatch)
        assert all(action[2] == RETURN for action in made) == home


def turned(update: Callable[..., Advice]) -> Callable[..., Advice]:
    """Advice as it is, except that it is time to turn."""

    def advises(*given: Any, **reads: Any) -> Advice:
        return dataclasses.replace(update(*given, **reads), turn_now=True)

    return advises


@pytest.mark.parametrize(
    ("given", "route", "wind"),
    [
        (GIVEN[0], True, True),
        (GIVEN[1], False, True),
        (GIVEN[2], False, False),
        (GIVEN[3], False, False),
    ],
)
def test_the_policy_knows_what_it_is_given(
    given: str, route: bool, wind: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[Any, ...]] = []

    class Told(Exception):
        """Nothing is driven."""

    def asked(policy: object, known: object, *prior: Any) -> Onboard:
        told.append(prior)
        raise Told

    monkeypatch.setattr(onboard, "Onboard", asked)
    with pytest.raises(Told):
        next(driven(Args(), given))
    ((way, wind_mps, grade),) = told
    assert (way is not None, grade is not None, wind_mps is not None) == (route, route, wind)


def test_a_mission_or_number_that_cannot_be_driven_is_refused() -> None:
    for args in (Args(env="Moon"), Args(missions=0)):
        with pytest.raises(OptionError, match="--env of OutAndBack"):
            main(args)


def test_the_table_has_a_row_for_each(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of four missions one strands."""
    monkeypatch.setattr(onboard, "driven", lambda args, given: [(10.0, False)] * 3 + [(0.0, True)])
    main(Args(missions=4))
    printed = capsys.readouterr().out
    assert all(given in " ".join(printed.split()) for given in GIVEN)
    assert printed.count("7.5") == len(GIVEN) and printed.count("1, 25.0%") == len(GIVEN)
