"""The paper's hours: what the model gives, and every mission printed."""

import dataclasses

import numpy as np
import pytest

from benchmarks import paper_tables
from benchmarks.paper_tables import INCLINE_RAD, MISSIONS, mission_hours
from homeward import load_robot
from homeward.physics import ancillary_power, traction_force
from homeward.physics.model import drive_power

RUSTI = load_robot("rusti")
NO_DRAG = dataclasses.replace(RUSTI, drag_ns2_per_m2=0.0)


@pytest.mark.parametrize(
    ("mission", "hours"), list(zip(MISSIONS[:3], [1.64, 4.02, 4.95], strict=True))
)
def test_box_hours_at_1_mps_and_078_kg(mission: paper_tables.FieldTest, hours: float) -> None:
    assert round(mission_hours(NO_DRAG, mission), 2) == hours


def test_incline_hours_use_the_mean_power_of_both_ways() -> None:
    mission = MISSIONS[3]
    force_n = traction_force(RUSTI, 1.0, np.array([INCLINE_RAD, -INCLINE_RAD]))
    power_w = ancillary_power(RUSTI, 0.0) + mission.duty * np.mean(drive_power(RUSTI, force_n, 1.0))
    assert mission_hours(RUSTI, mission) == pytest.approx(55440.0 / power_w / 3600.0, rel=1e-12)


def test_the_benchmark_prints_every_mission(capsys: pytest.CaptureFixture[str]) -> None:
    paper_tables.main()
    printed = capsys.readouterr().out
    for mission in MISSIONS:
        assert f"{mission.measured_h:.3f}" in printed
