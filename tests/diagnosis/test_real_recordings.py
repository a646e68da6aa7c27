"""The real recordings of docs/results.md: what is named, wherever they are at hand."""

import os
from pathlib import Path

import pytest

from homeward.datasets import DATASETS, fetch
from homeward.diagnosis import diagnose

DATA = Path(os.environ.get("HOMEWARD_DATA", "nowhere"))


@pytest.mark.skipif(not (DATA / "husky_borealtc").is_dir(), reason="needs HOMEWARD_DATA with the real recordings")
@pytest.mark.parametrize(("ground", "scrub"), [("FLOORING", 0.52), ("ASPHALT", 0.59), ("ICE", 0.10), ("SNOW", 0.29)])
def test_turning_is_named_on_real_ground(ground: str, scrub: float) -> None:
    name = "husky_borealtc"
    diagnosis = diagnose(fetch(name, ground), "husky", DATASETS[name].columns)
    turning = diagnosis.missing_physics[0]
    assert turning.effect == "turning" and turning.where[0].condition.startswith("turning faster than")
    assert turning.parameters["scrub"].value == pytest.approx(scrub, abs=0.01)
    assert diagnosis.fit is not None and diagnosis.fit.held_out_by == "run"
    assert diagnosis.fit.arms["corrected"].rmse < diagnosis.fit.arms["refit"].rmse
    assert diagnosis.fit.arms["refit"].energy_error_pct is None and diagnosis.range_change_m is None
