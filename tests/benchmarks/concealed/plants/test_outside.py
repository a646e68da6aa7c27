"""Mechanisms outside the catalogue: each does what its sentence says, and nothing where its cause
is absent."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.concealed.plants.chain import Work, rollout
from benchmarks.concealed.plants.effects import EFFECTS, first_order
from benchmarks.concealed.plants.motion import Motion
from benchmarks.concealed.plants.outside import OUTSIDE, make_outside
from benchmarks.concealed.plants.vehicles import SCOUT, rolling_power_w, typical_power_w
from tests.benchmarks.concealed.plants.steady import DT_S, ROBOT, later, motion, plain

SEEDS = range(3)
each_seed = pytest.mark.parametrize("seed", SEEDS)


def drawn(name: str, run: Motion, seed: int = 0, runs: int = 1) -> Work:
    mechanism, _ = make_outside(name, SCOUT, np.random.default_rng(seed), runs)
    return rollout(SCOUT, run, [mechanism], np.random.default_rng(1))


def rolls(name: str, run: Motion, seed: int = 0, runs: int = 1) -> np.ndarray:
    """Rolling resistance over that of the file."""
    return np.asarray(drawn(name, run, seed, runs).rolling / ROBOT.rolling_resistance)


def adds_w(name: str, run: Motion, seed: int = 0, runs: int = 1) -> np.ndarray:
    return np.asarray(drawn(name, run, seed, runs).power_w - plain(run).power_w)


def speeds(*levels: tuple[float, float]) -> Motion:
    """A drive of speeds, m/s, each for some seconds."""
    parts = [np.full(round(seconds / DT_S), speed) for speed, seconds in levels]
    values = np.concatenate(parts)
    return motion(values, values.size * DT_S)  # type: ignore[arg-type]


@each_seed
def test_furrows_are_the_same_there_and_back_and_hinder_across(seed: int) -> None:
    round_about = motion(heading_rad=np.linspace(0.0, 2.0 * np.pi, 600))
    there = rolls("furrows", round_about, seed)
    back = rolls("furrows", motion(heading_rad=np.linspace(np.pi, 3.0 * np.pi, 600)), seed)
    np.testing.assert_allclose(there, back)
    assert there.min() == pytest.approx(1.0, abs=1e-3) and 1.4 <= there.max() <= 2.0


@each_seed
def test_a_dry_bearing_squeals_once_hot_and_until_clearly_cooler(seed: int) -> None:
    """It cools as it warms, so that the levels at which it begins and ends follow from the
    times."""
    run = speeds((1.5, 300.0), (0.0, 600.0))
    worse = rolls("squealing_bearing", run, seed) > 1.0
    begins, ends = np.flatnonzero(np.diff(worse.astype(int)))
    rise_s = np.random.default_rng(seed).uniform(60.0, 150.0)
    heat = first_order(run.speed_mps, DT_S, rise_s)
    heat /= heat.max()
    assert 0.5 < heat[begins] < 0.71
    assert heat[ends] == pytest.approx(heat[begins] - 0.15, abs=0.01)
    assert rolls("squealing_bearing", motion(0.0), seed).max() == 1.0


@each_seed
def test_a_pump_pulses_with_the_way_and_not_while_standing(seed: int) -> None:
    assert not adds_w("speed_coupled_pump", motion(0.0), seed).any()
    slow, fast = (adds_w("speed_coupled_pump", motion(speed, 300.0), seed) for speed in (0.5, 1.0))
    assert np.mean(fast > 0.0) == pytest.approx(0.4, abs=0.12)
    starts = [np.flatnonzero(np.diff((one > 0.0).astype(int)) > 0) for one in (slow, fast)]
    assert np.median(np.diff(starts[0])) == pytest.approx(
        2.0 * np.median(np.diff(starts[1])), abs=2.0
    )


@each_seed
def test_a_converter_loses_above_its_load_only(seed: int) -> None:
    assert not adds_w("hiccup_converter", motion(0.0), seed).any()
    hard = motion(1.5, grade_rad=0.1)
    lost = adds_w("hiccup_converter", hard, seed)[-1] / plain(hard).power_w[-1]
    assert 0.15 <= lost <= 0.3


@each_seed
def test_tyres_warm_while_driving(seed: int) -> None:
    worse = rolls("cold_tyres", motion(1.0, 3000.0), seed)
    assert worse[0] + 0.02 >= 1.5 and worse[0] <= 2.0 and worse[-1] == pytest.approx(1.0, abs=1e-3)
    assert (np.diff(worse) <= 0.0).all()
    assert (
        np.diff(rolls("cold_tyres", speeds((1.0, 300.0), (0.0, 100.0)), seed)[3001:]) > 0.0
    ).all()


@each_seed
def test_mud_gathers_with_the_way_and_falls_off_at_a_stop(seed: int) -> None:
    mud = rolls("clinging_mud", speeds((1.0, 100.0), (0.0, 5.0), (1.0, 1.0)), seed)
    assert mud[0] == 1.0 and (np.diff(mud[:1000]) > 0.0).all() and 1.3 < mud[999] < 2.2
    assert mud[1001:1049] == pytest.approx(1.0)
    assert mud[-1] < 1.1


@each_seed
def test_a_tyre_leaks_in_one_drive_and_stays_flat(seed: int) -> None:
    first, leaks, after = (
        rolls("slow_puncture", later(motion(), index), seed, runs=1) for index in (-1, 0, 1)
    )
    assert (first == 1.0).all() and leaks[0] == 1.0 and leaks[-1] > 1.05
    np.testing.assert_allclose(after, 0.12**-0.4)  # of the pressure that is left


@each_seed
def test_a_brake_sticks_after_a_long_stop_alone(seed: int) -> None:
    short, long = (
        rolls("sticking_brake", speeds((1.0, 10.0), (0.0, stop), (1.0, 60.0)), seed)
        for stop in (5.0, 15.0)
    )
    assert (short == 1.0).all()
    assert 2.3 < long[251] < 4.0 and long[-1] < 1.1 and (long[:249] == 1.0).all()


@each_seed
def test_the_sun_only_gives(seed: int) -> None:
    gained_w = -adds_w("solar_panel", motion(seconds=600.0), seed)
    assert gained_w.min() > 0.0 and gained_w.max() < 0.4 * typical_power_w(SCOUT)
    assert gained_w.std() > 0.0


@each_seed
def test_corrugations_shake_at_one_speed(seed: int) -> None:
    at = np.linspace(0.01, 1.0, 600) * ROBOT.max_speed_mps
    worse = rolls("washboard", motion(at), seed)  # type: ignore[arg-type]
    peak = int(np.argmax(worse))
    assert 0.4 <= at[peak] / ROBOT.max_speed_mps <= 0.76 and 1.8 <= worse[peak] <= 2.6
    assert worse[0] < 1.1


@each_seed
def test_a_bent_linkage_hinders_to_the_left(seed: int) -> None:
    left, straight, right = (
        adds_w("damaged_steering", motion(yaw_rate_radps=yaw), seed) for yaw in (0.5, 0.0, -0.5)
    )
    assert not straight.any() and not right.any()
    assert left[0] / rolling_power_w(SCOUT) == pytest.approx(1.2 * np.tanh(5.0), rel=0.34)


@each_seed
def test_a_fan_runs_on_until_the_motor_is_clearly_cooler(seed: int) -> None:
    run = speeds((1.5, 120.0), (0.0, 240.0))
    fan_w = adds_w("cooling_fan", run, seed)
    on = fan_w > 0.0
    begins, ends = np.flatnonzero(np.diff(on.astype(int)))[:2]
    assert begins < 1200 <= ends
    rng = np.random.default_rng(seed)
    rng.uniform(0.25, 0.5)
    heat = first_order(plain(run).drive_w, DT_S, rng.uniform(40.0, 100.0))
    assert heat[ends] / heat[begins] == pytest.approx(0.7, abs=0.03)
    assert 0.25 <= fan_w.max() / typical_power_w(SCOUT) <= 0.5


@each_seed
def test_a_descent_costs_power_while_driving(seed: int) -> None:
    assert not adds_w("hill_descent", motion(grade_rad=0.1), seed).any()
    assert not adds_w("hill_descent", motion(0.0, grade_rad=-0.1), seed).any()
    steep_w = adds_w("hill_descent", motion(grade_rad=-0.12), seed)[0]
    assert 0.5 <= steep_w / rolling_power_w(SCOUT) <= 1.0


@each_seed
def test_an_instrument_works_high_up(seed: int) -> None:
    work_w = adds_w("altitude_switch", motion(elevation_m=np.linspace(0.0, 9.0, 600)), seed)
    on = work_w > 0.0
    assert (np.diff(on.astype(int)) >= 0).all() and 0.38 < on.mean() < 0.57


@each_seed
def test_bursts_grow(seed: int) -> None:
    bursts_w = adds_w("growing_bursts", motion(seconds=600.0), seed)
    sizes = np.unique(bursts_w[bursts_w > 0.0].round(6))
    assert len(sizes) > 2
    # Sums of bursts that overlap are no multiples of the first.
    assert sizes[1] / sizes[0] == pytest.approx(1.3)


@each_seed
def test_rain_is_of_one_drive_and_the_ground_dries(seed: int) -> None:
    dry, wet = (rolls("shower", later(motion(seconds=600.0), index), seed) for index in (1, 0))
    assert (dry == 1.0).all()
    assert wet[0] == 1.0 and 1.4 < wet.max() < 2.0 and wet[-1] < 1.05


@each_seed
def test_a_gearbox_remembers_fast_driving(seed: int) -> None:
    slow = rolls("speed_memory", speeds((0.5, 60.0)), seed)
    after = rolls("speed_memory", speeds((1.5, 20.0), (0.5, 300.0)), seed)
    np.testing.assert_allclose(slow, slow[0])
    assert after[210] > 1.3 and after[-1] == pytest.approx(slow[0])
    assert (np.diff(after[201:]) <= 0.0).all()


@pytest.mark.parametrize("name", OUTSIDE)
def test_it_is_no_effect_of_the_catalogue_though_some_describe_it(name: str) -> None:
    mechanism, fair = make_outside(name, SCOUT, np.random.default_rng(0), 3)
    assert mechanism.effect == name and name not in EFFECTS
    assert fair <= EFFECTS.keys()
