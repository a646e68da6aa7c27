"""Every candidate is checked to the end, and the diagnosis stays what it is."""

from benchmarks.conditions import ALL, tried
from benchmarks.real_drives import Split
from homeward import Robot
from tests.diagnosis.conftest import Drive


def test_candidates_have_the_values_of_all_conditions(drive: Drive, husky: Robot) -> None:
    runs = drive(husky, runs=2, minutes=1.0, effects={"turning": {"scrub": 0.5}})
    judged = tried(Split("husky", "all", husky, runs, ()))  # type: ignore[arg-type]
    checks = dict(judged)["husky, turning"]
    assert [check.condition for check in checks if not check.holds] == []
    assert {check.condition for _, checks in judged for check in checks} <= {*ALL}
