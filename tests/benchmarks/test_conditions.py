"""Every candidate is checked to the end, and the diagnosis stays what it is."""

from benchmarks.conditions import ALL, tried
from benchmarks.real_drives import Split
from homeward import Robot
from homeward.diagnosis import Analysis
from tests.diagnosis.conftest import Drive


def test_candidates_have_the_values_of_all_conditions(short_drive: Drive, husky: Robot, scrubbing: Analysis) -> None:
    runs = short_drive(husky, effects={"turning": {"scrub": 0.3}})
    judged = tried(Split("husky", "all", husky, runs, ()))  # type: ignore[arg-type]
    named = dict(judged)["husky, turning"]
    assert [check.condition for check in named if not check.holds] == []
    assert {check.condition for _, checks in judged for check in checks} <= {*ALL}
    longest = max(len(checks) for _, checks in judged)
    assert longest > len(scrubbing.diagnosis.missing_physics[0].conditions) or longest >= 5
