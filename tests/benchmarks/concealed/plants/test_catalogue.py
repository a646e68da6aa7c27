"""Plants with the catalogue's own formulas: the replay, and true parameters that a robot file may
hold."""

import dataclasses

import numpy as np
import pytest

from benchmarks.concealed.plants.catalogue import TRUTHS, replayed, replayed_w
from benchmarks.concealed.plants.vehicles import SCOUT, VEHICLES
from homeward.physics.effects import EFFECTS
from tests.benchmarks.concealed.plants.steady import ROBOT, motion, plain


def test_a_replay_without_effects_is_the_plant_without_effects() -> None:
    run = motion(grade_rad=0.02, sensing_hz=3.0)
    np.testing.assert_allclose(replayed_w(ROBOT, run), plain(run).power_w, rtol=1e-9)


@pytest.mark.parametrize("effect", TRUTHS)
def test_a_file_may_hold_what_is_drawn_on_every_vehicle_and_it_is_at_work(effect: str) -> None:
    """Of each effect's own parameters, and within their bounds, which a robot checks."""
    known = {one.name for of in EFFECTS if of.id == effect for one in of.parameters}
    for vehicle in VEHICLES:
        rng = np.random.default_rng(0)
        for _ in range(20):
            drawn = TRUTHS[effect](vehicle, rng)
            assert set(drawn) <= known
            assert dataclasses.replace(vehicle.robot, effects={effect: drawn}).active_effects == (
                effect,
            )


def test_a_recorded_replay_is_seen_as_it_is_drawn() -> None:
    run = motion()
    truth = dataclasses.replace(ROBOT, effects={"inertia": {"mass_factor": 1.2}})
    work = replayed(SCOUT, truth, run)
    np.testing.assert_array_equal(work.power_w, replayed_w(truth, run))
    assert work.seen_w is work.chemical_w is work.power_w
    assert (work.soc == 0.95).all() and len(work.soc) == len(run.time_s)
