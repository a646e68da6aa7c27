"""Concealed effects: each against a formula at one point, nothing where its cause is nothing, and
its sign."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.concealed.plants.chain import Work
from benchmarks.concealed.plants.effects import (
    COPPER_PER_K,
    EFFECTS,
    INSTRUMENTS,
    first_order,
    ornstein_uhlenbeck,
    since,
    since_start_m,
)
from benchmarks.concealed.plants.instruments import read_power
from benchmarks.concealed.plants.motion import Array, Motion
from benchmarks.concealed.plants.vehicles import (
    GRAVITY_MPS2,
    RACER,
    SCOUT,
    peak_power_w,
    rolling_power_w,
    typical_power_w,
)
from tests.benchmarks.concealed.plants.steady import DT_S, ROBOT, drawn, later, motion, plain

WEIGHT_N = ROBOT.mass_kg * GRAVITY_MPS2
ROLLING_N = ROBOT.rolling_resistance * WEIGHT_N
STOPS = np.where(np.arange(600) % 200 < 60, 0.0, 1.0)
"""Speeds of a drive that stands for 6 s of every 20."""
SEEDS = range(4)


def extra_w(effect: str, run: Motion, seed: int = 0, **more: str) -> Array:
    """What an effect adds to the drive's power, W."""
    return np.asarray(drawn(effect, run, seed=seed).power_w - plain(run).power_w)


def extra_n(effect: str, run: Motion, seed: int = 0) -> Array:
    return np.asarray(drawn(effect, run, seed=seed).force_n - plain(run).force_n)


def test_a_lag_follows_a_step_exponentially() -> None:
    risen = first_order(np.ones(100), 0.1, 2.0)
    np.testing.assert_allclose(risen, 1.0 - np.exp(-0.1 * np.arange(1, 101) / 2.0))
    np.testing.assert_allclose(first_order(np.full(9, 3.0), 0.1, 2.0, 3.0), 3.0)


def test_autocorrelated_noise_has_its_deviation_and_correlation() -> None:
    noise = ornstein_uhlenbeck(np.random.default_rng(0), 200_000, 0.1, 2.0, 1.0)
    assert noise.mean() == pytest.approx(0.0, abs=0.1) and noise.std() == pytest.approx(
        2.0, rel=0.03
    )
    assert np.corrcoef(noise[10:], noise[:-10])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.02)
    starts = [
        ornstein_uhlenbeck(np.random.default_rng(seed), 1, 0.1, 2.0, 1.0)[0] for seed in range(2000)
    ]
    assert np.std(starts) == pytest.approx(2.0, rel=0.06)  # from the first sample on


def test_a_permanent_change_happens_in_its_drive_and_stays() -> None:
    run = motion()
    assert not since(later(run, 0), 1, 0.5).any() and since(later(run, 2), 1, 0.5).all()
    np.testing.assert_array_equal(since(later(run, 1), 1, 0.5), run.time_s >= 0.5 * run.time_s[-1])


def test_the_way_since_a_stop_begins_at_nothing() -> None:
    run = motion(speed_mps=STOPS)  # type: ignore[arg-type]
    way_m = since_start_m(run)
    assert (way_m[STOPS == 0.0] == 0.0).all()
    assert way_m[199] == pytest.approx(139 * DT_S)
    assert way_m[-1] == pytest.approx(139 * DT_S)


@pytest.mark.parametrize("seed", SEEDS)
def test_turning_is_zero_straight_on_and_the_same_to_either_side(seed: int) -> None:
    assert not extra_w("turning", motion(), seed).any()
    left, right = (extra_w("turning", motion(yaw_rate_radps=yaw), seed) for yaw in (0.3, -0.3))
    assert (left > 0.0).all()
    np.testing.assert_allclose(left, right)
    on_the_spot = extra_w("turning", motion(0.0, yaw_rate_radps=0.3), seed)
    np.testing.assert_allclose(on_the_spot, left)  # scrub is independent of the speed ahead


def test_wheels_that_are_steered_scrub_as_their_side_force_squared() -> None:
    """F_y^2 / C v with C of 3 to 6 weights per rad; twice the yaw rate is four times the power."""
    vehicle, weight_n = RACER, RACER.robot.mass_kg * GRAVITY_MPS2
    slow, fast = (
        drawn("turning", motion(2.0, yaw_rate_radps=yaw), vehicle=vehicle).turning_w[0]
        for yaw in (0.4, 0.8)
    )
    assert fast == pytest.approx(4.0 * slow)
    side_n = RACER.robot.mass_kg * 2.0 * 0.4
    assert side_n**2 / (6.0 * weight_n) * 2.0 <= slow <= side_n**2 / (3.0 * weight_n) * 2.0
    assert not drawn("turning", motion(0.0, yaw_rate_radps=0.4), vehicle=vehicle).turning_w.any()


@pytest.mark.parametrize("seed", SEEDS)
def test_inertia_is_mass_times_acceleration_and_more_for_what_turns(seed: int) -> None:
    assert not extra_n("inertia", motion(), seed).any()
    force_n = extra_n("inertia", motion(accel_mps2=0.5), seed)
    assert 1.04 <= force_n[0] / (ROBOT.mass_kg * 0.5) <= 1.6
    np.testing.assert_allclose(extra_n("inertia", motion(accel_mps2=-0.5), seed), -force_n)


@pytest.mark.parametrize("seed", SEEDS)
def test_breakaway_is_over_once_the_wheels_are_out(seed: int) -> None:
    force_n = extra_n("breakaway", motion(seconds=600.0), seed)
    assert force_n[0] > 0.7 * 1.5 * ROLLING_N and force_n[-1] < 1e-3 * ROLLING_N
    assert (np.diff(force_n) <= 1e-12).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_grease_drags_in_proportion_to_speed_and_thins(seed: int) -> None:
    slow_n, fast_n = (extra_n("viscous", motion(speed), seed) for speed in (0.25, 1.5))
    exponent = np.log(fast_n[0] / slow_n[0]) / np.log(1.5 / 0.25)
    assert 0.8 <= exponent <= 1.1
    assert 0.6 <= fast_n[0] / ROLLING_N <= 1.2
    assert 0.65 * fast_n[0] < fast_n[-1] < fast_n[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_wind_from_ahead_and_from_behind_are_the_same_wind(seed: int) -> None:
    """The head wind of one heading is the tail wind of the other; both are drawn alike."""
    out, back = (
        drawn("wind", motion(heading_rad=heading), seed=seed).air_mps - 1.0
        for heading in (0.0, np.pi)
    )
    np.testing.assert_allclose(out, -back, atol=1e-9)
    across = drawn("wind", motion(heading_rad=0.5 * np.pi), seed=seed).air_mps - 1.0
    speed_mps = np.hypot(out, across)
    assert 4.0 < speed_mps.mean() < 12.0 and 0.05 < speed_mps.std() / speed_mps.mean() < 0.35


@pytest.mark.parametrize("seed", SEEDS)
def test_ground_is_soft_on_a_stretch_and_hard_elsewhere(seed: int) -> None:
    run = motion(1.5, seconds=SCOUT.leg_m / 1.5)
    softer = extra_n("surface", run, seed) / ROLLING_N
    share = run.place_m / SCOUT.leg_m
    assert np.abs(softer[share < 0.05]).max() < 0.01 and np.abs(softer[share > 0.95]).max() < 0.01
    assert softer[(share > 0.42) & (share < 0.45)].mean() > 0.3
    assert (softer >= 0.0).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_load_weighs_from_where_it_is_picked_up(seed: int) -> None:
    work = drawn("payload", motion(grade_rad=0.05), seed=seed)
    heavier = work.mass_kg / ROBOT.mass_kg
    assert heavier[0] == 1.0 and 1.2 <= heavier[-1] <= 1.5
    np.testing.assert_allclose(work.rolling / ROBOT.rolling_resistance, heavier**0.1)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_hidden_slope_is_against_the_way_out_and_with_the_way_home(seed: int) -> None:
    out, home = (
        drawn("hidden_grade", motion(direction=direction), seed=seed).grade_rad
        for direction in (1.0, -1.0)
    )
    np.testing.assert_allclose(out, -home)
    assert 0.2 * 0.7 <= np.abs(out).max() / ROBOT.rolling_resistance <= 0.5 * 1.3


@pytest.mark.parametrize("seed", SEEDS)
def test_wheels_slip_as_burckhardts_curve_says(seed: int) -> None:
    """With force up to its maximum, and not at all where none is asked for."""
    rng = np.random.default_rng(seed)
    c1, c2, c3 = rng.uniform(0.25, 0.35), rng.uniform(4.0, 8.0), rng.uniform(0.02, 0.06)
    work = drawn("slip", motion(grade_rad=0.08), seed=seed)
    slip = 1.0 - work.run.speed_mps / work.tread_mps
    friction = work.force_n / (WEIGHT_N * np.cos(0.08))
    np.testing.assert_allclose(c1 * (1.0 - np.exp(-c2 * slip)) - c3 * slip, friction, atol=1e-4)
    assert (slip > 0.0).all()
    down = drawn("slip", motion(grade_rad=-0.1), seed=seed)
    np.testing.assert_array_equal(down.tread_mps, down.run.speed_mps)


@pytest.mark.parametrize("seed", SEEDS)
def test_only_braking_is_recovered_and_no_more_than_its_work(seed: int) -> None:
    assert not drawn("regeneration", motion(grade_rad=0.0), seed=seed).returned_w.any()
    work = drawn("regeneration", motion(1.0, grade_rad=-0.12), seed=seed)
    braking_w = -work.force_n * ROBOT.traction_efficiency
    limit_w = 1.2 * rolling_power_w(SCOUT)
    assert (work.returned_w > 0.0).all() and (
        work.returned_w <= np.minimum(0.85 * braking_w, limit_w)
    ).all()
    # too slow
    assert not drawn("regeneration", motion(0.02, grade_rad=-0.12), seed=seed).returned_w.any()


@pytest.mark.parametrize("seed", SEEDS)
def test_copper_loss_rises_faster_than_the_square_of_the_force(seed: int) -> None:
    flat, steep = (motion(grade_rad=grade) for grade in (0.0, 0.06))
    loss_w = [extra_w("copper_loss", run, seed)[0] for run in (flat, steep)]
    force_n = [plain(run).force_n[0] for run in (flat, steep)]
    assert loss_w[0] > 0.0
    assert loss_w[1] / loss_w[0] > (force_n[1] / force_n[0]) ** 2
    assert extra_w("copper_loss", motion(0.0), seed)[0] == 0.0


@pytest.mark.parametrize("seed", SEEDS)
def test_no_load_loss_is_of_turning_motors_alone(seed: int) -> None:
    assert not extra_w("no_load", motion(0.0), seed).any()
    slow, fast = (extra_w("no_load", motion(speed), seed)[0] for speed in (0.15, 1.5))
    assert fast / slow == pytest.approx(1.0 / (0.6 + 0.03 + 0.001))
    assert 0.3 <= fast / rolling_power_w(SCOUT) <= 0.6


@pytest.mark.parametrize("seed", SEEDS)
def test_a_motor_that_warms_consumes_more_and_no_more_than_copper_at_its_limit(seed: int) -> None:
    hot = (
        drawn("motor_heating", motion(1.5, 3600.0), seed=seed).drive_w
        / plain(motion(1.5, 3600.0)).drive_w
    )
    assert (
        hot[0] == pytest.approx(1.0, abs=0.01) and (np.diff(hot) >= -1e-12).all() and hot[-1] > 1.05
    )
    limit = (1.0 + COPPER_PER_K * 130.0) / (1.0 - 0.13) ** 2 - 1.0
    assert hot[-1] <= 1.0 + 0.55 * limit
    assert not extra_w("motor_heating", motion(0.0), seed).any()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_warm_motor_has_the_resistance_of_warm_copper_and_weaker_magnets(seed: int) -> None:
    rng, run = np.random.default_rng(seed), motion(0.5, 3600.0 * 3.0)
    copper_share = rng.uniform(0.35, 0.55)
    rise_k = (
        (rng.uniform(40.0, 60.0) + rng.uniform(25.0, 45.0))
        * plain(run).drive_w[0]
        / rolling_power_w(SCOUT)
    )
    hotter = (1.0 + COPPER_PER_K * rise_k) / (1.0 - 0.001 * rise_k) ** 2
    hot = drawn("motor_heating", run, seed=seed).drive_w / plain(run).drive_w
    assert hot[-1] == pytest.approx(1.0 + copper_share * (hotter - 1.0), rel=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("effect", ["internal_resistance", "cold_battery"])
def test_a_battery_loses_what_ohm_says_and_delivers_what_is_asked(effect: str, seed: int) -> None:
    run = motion(1.0, temperature_c=-5.0)
    without, work = plain(run), drawn(effect, run, seed=seed)
    np.testing.assert_array_equal(work.power_w, without.power_w)
    lost_w = work.chemical_w - work.power_w
    assert (lost_w > 0.0).all()
    assert (work.voltage_v < without.voltage_v).all()
    current_a = work.power_w / work.voltage_v
    # What is lost is the sag of the voltage times the current.
    np.testing.assert_allclose(lost_w, (without.voltage_v - work.voltage_v) * current_a, rtol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_resistance_is_the_share_of_the_peak_that_it_is_drawn_as(seed: int) -> None:
    """Before polarisation builds up, three quarters of it are in series."""
    run = motion(1.0)
    ohm = (
        np.random.default_rng(seed).uniform(0.12, 0.2)
        * ROBOT.nominal_voltage_v**2
        / peak_power_w(SCOUT)
    )
    work = drawn("internal_resistance", run, seed=seed)
    current_a = float(work.power_w[0] / work.voltage_v[0])
    sag_v = float(plain(run).voltage_v[0] - work.voltage_v[0])
    assert sag_v == pytest.approx(0.75 * ohm * current_a, rel=0.01)


@pytest.mark.parametrize("seed", SEEDS)
def test_peukert_loses_nothing_up_to_the_rated_power(seed: int) -> None:
    still = drawn("rate_capacity", motion(0.0), seed=seed)
    rng = np.random.default_rng(seed)
    exponent, rated_w = rng.uniform(0.1, 0.25), typical_power_w(SCOUT) * rng.uniform(0.4, 0.8)
    if still.power_w[0] < rated_w:
        np.testing.assert_array_equal(still.chemical_w, still.power_w)
    hard = drawn("rate_capacity", motion(1.5, grade_rad=0.1), seed=seed)
    assert hard.power_w[0] > rated_w
    np.testing.assert_allclose(hard.chemical_w, hard.power_w * (hard.power_w / rated_w) ** exponent)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_old_battery_falls_faster_and_delivers_alike(seed: int) -> None:
    work, without = (
        drawn("ageing", motion(), seed=seed, read_by="terminals"),
        plain(motion(), read_by="terminals"),
    )
    np.testing.assert_array_equal(work.seen_w, without.seen_w)
    ratio = (0.95 - work.soc) / (0.95 - without.soc)
    assert 1.0 / 0.85 <= ratio[0] <= 1.0 / 0.65
    np.testing.assert_allclose(ratio, ratio[0])


@pytest.mark.parametrize("seed", SEEDS)
def test_cold_raises_a_batterys_resistance(seed: int) -> None:
    lost_w = [
        float(np.sum(work.chemical_w - work.power_w))
        for work in (
            drawn("cold_battery", motion(temperature_c=at_c), seed=seed)
            for at_c in (-15.0, 5.0, 25.0)
        )
    ]
    assert lost_w[0] > 2.0 * lost_w[1] > 2.0 * lost_w[2] > 0.0


@pytest.mark.parametrize("seed", SEEDS)
def test_a_load_that_stays_on_draws_a_third_more_while_cold(seed: int) -> None:
    load_w = extra_w("standby", motion(seconds=600.0), seed)
    on = load_w > 0.0
    first = int(on.argmax())
    assert first > 0 and on[first:].all()
    assert load_w[first] / load_w[-1] == pytest.approx(1.3, abs=0.02)
    assert 0.12 <= load_w[-1] / typical_power_w(SCOUT) <= 0.3


@pytest.mark.parametrize("seed", SEEDS)
def test_a_processor_follows_the_sensing_rate(seed: int) -> None:
    assert not extra_w("compute", motion(sensing_hz=0.0), seed).any()
    half, full = (extra_w("compute", motion(sensing_hz=hz), seed) for hz in (10.0, 20.0))
    assert 0.25 <= full[0] / typical_power_w(SCOUT) <= 0.5
    assert 0.2 * full[0] < half[0] < 0.65 * full[0]  # of leakage and f V^2


@pytest.mark.parametrize("seed", SEEDS)
def test_a_radio_is_longer_on_the_air_farther_away(seed: int) -> None:
    near, mid, far = (
        extra_w("radio", motion(base_distance_m=at_m), seed)
        for at_m in (0.5, 0.5 * SCOUT.leg_m, 2.0 * SCOUT.leg_m)
    )
    assert near.mean() < mid.mean() < far.mean() and near.min() > 0.0
    assert far.max() == pytest.approx(9.0 * near.min(), rel=1e-9)  # 54 over 6 Mbit/s


@pytest.mark.parametrize("seed", SEEDS)
def test_a_heater_heats_where_it_is_cold_and_switches(seed: int) -> None:
    assert not extra_w("heater", motion(seconds=600.0, temperature_c=20.0), seed).any()
    heating_w = extra_w("heater", motion(seconds=3000.0, temperature_c=-5.0), seed)
    assert 0.0 < (heating_w > 0.0).mean() < 1.0
    switches = np.flatnonzero(np.diff((heating_w > 0.0).astype(int)))
    assert np.diff(switches).min() * DT_S > 8.0  # two kelvins at the least, of at most 0.175 K/s
    sizes = np.unique(heating_w.round(6))
    assert len(sizes) == 2 and 0.25 <= sizes[-1] / typical_power_w(SCOUT) <= 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_a_cooler_cools_where_it_is_hot_and_switches(seed: int) -> None:
    assert not extra_w("cooler", motion(seconds=600.0, temperature_c=10.0), seed).any()
    cooling_w = extra_w("cooler", motion(seconds=3000.0, temperature_c=35.0), seed)
    assert 0.0 < (cooling_w > 0.0).mean() < 1.0


@pytest.mark.parametrize("seed", SEEDS)
def test_a_compressor_runs_for_its_duty_cycle_with_an_inrush(seed: int) -> None:
    load_w = extra_w("intermittent_load", motion(seconds=3000.0), seed)
    assert 0.22 < (load_w > 0.0).mean() < 0.56
    steady_w = float(np.median(load_w[load_w > 0.0]))
    assert 0.25 <= steady_w / typical_power_w(SCOUT) <= 0.51
    assert load_w.max() / steady_w == pytest.approx(1.5, abs=0.06)


def test_effects_of_the_road_change_no_reading_and_instruments_no_power() -> None:
    run = motion(1.0, yaw_rate_radps=0.1, accel_mps2=0.2, sensing_hz=10.0, temperature_c=-5.0)
    for name in EFFECTS:
        work = drawn(name, run)
        readings = (work.read_gain, work.read_offset_w, work.odometer_gain)
        defaults = (1, 0, 1)
        changes = [
            float(np.abs(reading - default).max())
            for reading, default in zip(readings, defaults, strict=True)
        ]
        told = (work.read_lag_s, *changes)
        if name not in INSTRUMENTS:
            assert not any(told), name
        else:
            assert any(told), name
            np.testing.assert_array_equal(work.chemical_w, plain(run).chemical_w)


Reading = Callable[[Work], Array]


@pytest.mark.parametrize(
    ("effect", "reads", "least", "most"),
    [
        (
            "sensor_offset",
            lambda work: np.abs(work.read_offset_w) / typical_power_w(SCOUT),
            0.1,
            0.25,
        ),
        ("sensor_gain", lambda work: work.read_gain - 1.0, 0.12, 0.3),
        ("odometry_scale", lambda work: np.abs(work.odometer_gain - 1.0), 0.08, 0.2),
    ],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_an_instrument_is_off_by_what_it_is_drawn_as(
    effect: str, reads: Reading, least: float, most: float, seed: int
) -> None:
    read = reads(drawn(effect, motion(), seed=seed))
    assert least * 0.9 <= read[-1] <= most and (read <= most + 1e-12).all()
    if effect != "odometry_scale":  # of which the whole drive has it
        assert read[0] == 0.0


@pytest.mark.parametrize("seed", SEEDS)
def test_a_clock_that_lags_reads_what_was(seed: int) -> None:
    run = motion(1.0, sensing_hz=np.where(np.arange(600) < 300, 0.0, 20.0))
    work = drawn("clock_lag", run, seed=seed)
    assert 0.8 <= work.read_lag_s <= 3.0
    step = int(np.argmax(read_power(work) > 0.5 * (work.seen_w[0] + work.seen_w[-1])))
    assert (step - 300) * DT_S == pytest.approx(work.read_lag_s + 0.7 * work.read_smooth_s, abs=0.2)


def test_every_effect_of_the_catalogue_has_a_plant() -> None:
    """But for the road load by temperature, whose size is published: files have it, and few drives
    could prove it."""
    from homeward.physics.effects import EFFECTS as CATALOGUE

    catalogue = {effect.id for effect in CATALOGUE} - {"air_temperature"}
    assert set(EFFECTS) == {*catalogue, *INSTRUMENTS}
    assert all(
        draw(SCOUT, np.random.default_rng(0), 3).effect == name for name, draw in EFFECTS.items()
    )


def test_effects_are_drawn_anew_with_another_seed() -> None:
    changes = {"yaw_rate_radps": 0.3, "accel_mps2": 0.2, "sensing_hz": 10.0, "temperature_c": -5.0}
    runs = [later(motion(1.2, 120.0, grade_rad=grade, **changes), 3) for grade in (0.1, -0.1)]
    runs.append(later(motion(1.2, 120.0, temperature_c=35.0), 3))  # for a cooler
    for name in set(EFFECTS) - set(INSTRUMENTS) - {"ageing"}:
        assert any(
            (
                drawn(name, run, seed=0, runs=3).chemical_w
                != drawn(name, run, seed=1, runs=3).chemical_w
            ).any()
            for run in runs
        ), name
