"""The real recordings of docs/results.md: what is named, wherever they are at hand."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from homeward import load_robot
from homeward.datasets import DATASETS, fetch
from homeward.diagnosis import diagnose, read_recording
from homeward.diagnosis.explain.gauge import weigh_gauge
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.read.signals import signals

DATA = Path(os.environ.get("HOMEWARD_DATA", "nowhere"))


@pytest.mark.skipif(
    not (DATA / "husky_borealtc").is_dir(), reason="needs HOMEWARD_DATA with the real recordings"
)
@pytest.mark.parametrize(("ground", "scrub"), [("FLOORING", 0.52), ("ICE", 0.10), ("SNOW", 0.29)])
def test_turning_is_named_on_real_ground(ground: str, scrub: float) -> None:
    name = "husky_borealtc"
    diagnosis = diagnose(fetch(name, ground), "husky", DATASETS[name].columns)
    turning = diagnosis.missing_physics[0]
    assert turning.effect == "turning" and turning.where[0].condition.startswith(
        "turning faster than"
    )
    assert turning.parameters["scrub"].value == pytest.approx(scrub, abs=0.01)
    assert diagnosis.fit is not None and diagnosis.fit.held_out_by == "run"
    assert diagnosis.fit.arms["corrected"].rmse < diagnosis.fit.arms["refit"].rmse
    assert diagnosis.fit.arms["refit"].energy_error_pct is None and diagnosis.range_change_m is None


@pytest.mark.skipif(
    not (DATA / "leaf_ved").is_dir(), reason="needs HOMEWARD_DATA with the recordings of a Leaf"
)
@pytest.mark.parametrize("follows", ["charge", "voltage"])
def test_a_real_counter_is_believed_and_a_map_of_its_real_voltage_is_not(follows: str) -> None:
    """The map is that of Husarion's Panther, for the 96 cells of a Leaf."""
    leaf, run = (
        load_robot(DATA / "robots" / "leaf.toml"),
        read_recording(DATA / "leaf_ved" / "v8_0.csv"),
    )
    if follows == "voltage":
        percent = np.interp(run.channels["voltage_v"] / 96.0, [3.2, 4.14], [0.0, 1.0]).round(2)
        run = dataclasses.replace(run, channels={**run.channels, "soc": percent})
    _, gauge = weigh_gauge(average([signals(run, leaf)]), leaf)
    assert gauge is not None and gauge.follows == follows
