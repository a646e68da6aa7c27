"""Every candidate is checked to the end, and the diagnosis stays what it is."""

from benchmarks.conditions import NAMES, tried
from homeward import Robot
from homeward.diagnosis import analyse
from tests.diagnosis.conftest import Drive


def test_candidates_have_the_values_of_all_conditions(drive: Drive, husky: Robot) -> None:
    runs = drive(husky, runs=2, minutes=1.0, effects={"turning": {"scrub": 0.5}})
    judged = dict(tried(lambda: analyse(runs, husky), "husky"))
    for whose in ("husky, turning", "husky, turning together"):
        assert [check.condition for check in judged[whose] if not check.holds] == []
    assert {check.condition for checks in judged.values() for check in checks} <= {*NAMES}
