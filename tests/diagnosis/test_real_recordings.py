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
    named = {one.effect: one for one in diagnosis.missing_physics}
    assert "turning" in named and named["turning"].parameters["scrub"].value == pytest.approx(scrub, abs=0.01)
