"""Missing physics is named, fitted, handed back as a robot, and not seen where there is none."""

import dataclasses
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import homeward  # noqa: F401
from homeward import Robot, load_robot
from homeward.diagnosis import Analysis, Diagnosis, Recording, analyse, diagnose, thresholds
from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.change_points import search
from homeward.diagnosis.explain.hypothesis import Setting
from homeward.diagnosis.explain.naming import name_missing
from homeward.diagnosis.explain.residual_test import independent_blocks
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import Runs, average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.tell.report import write_outputs
from homeward.physics.effects.regeneration import NO_LIMIT_W
from homeward.physics.log_replay import replay
from tests.diagnosis import hills
from tests.diagnosis.conftest import Analyse
from tests.diagnosis.made_up import ends, over_hills, with_power
from tests.diagnosis.tell.test_file_choice import replay_equals_fit

Drive = Callable[..., list[Recording]]

EFFECTS: Mapping[str, Mapping[str, float]] = {
    "turning": {"scrub": 0.3},
    "inertia": {"mass_factor": 1.0},
    "slip": {"per_load": 1.5},
    "copper_loss": {"w_per_n2": 0.002},
    "viscous": {"drag_ns_per_m": 20.0},
    "no_load": {"power_w": 20.0},
    "compute": {"power_w": 15.0, "base_share": 1.0},
    "breakaway": {"start_j": 60.0},
    "motor_heating": {"per_k": 0.004},
    "internal_resistance": {"ohm": 0.4},
}

MINUTES: Mapping[str, float] = {"slip": 4.0, "motor_heating": 8.0}
"""How long the drives of a robot have to be that show an effect, where two minutes do not."""


def chattering(runs: list[Recording]) -> list[Recording]:
    """The runs of a drive that chatters in a band of speeds, which no effect of the catalogue
    does."""
    return with_power(
        runs, lambda of: of["power_w"] + 60.0 * (np.abs(of["speed_mps"] - 0.55) < 0.1)
    )


@pytest.mark.parametrize("effect", EFFECTS)
def test_a_concealed_effect_is_named_with_its_size(
    effect: str, scrubbing: Analysis, drive: Drive, husky: Robot
) -> None:
    hidden = EFFECTS[effect]
    runs = drive(husky, runs=4, minutes=MINUTES.get(effect, 2.0), effects={effect: hidden})
    analysis = scrubbing if effect == "turning" else analyse(runs, husky)
    diagnosis = analysis.diagnosis
    assert diagnosis.verdict == "missing_physics"
    first = diagnosis.missing_physics[0]
    assert first.effect == effect
    assert len(diagnosis.missing_physics) == 1
    size, true = next(iter(hidden.items()))
    if effect != "motor_heating":  # its size and its temperatures enter as a product
        assert first.parameters[size].value == pytest.approx(true, rel=0.15)
    assert diagnosis.fit is not None
    arms = diagnosis.fit.arms
    assert arms["corrected"].rmse < min(arms["refit"].rmse, arms["placebo"].rmse)
    assert diagnosis.file is not None and diagnosis.file.holds == "corrected"
    assert arms["file"].rmse == pytest.approx(arms["corrected"].rmse, rel=1e-3)
    assert replay_equals_fit(analysis)


def test_both_effects_of_a_pair_are_named(short_drive: Drive, husky: Robot) -> None:
    hidden = {"turning": {"scrub": 0.3}, "inertia": {"mass_factor": 1.0}}
    diagnosis = diagnose(short_drive(husky, effects=hidden), husky)
    assert {one.effect for one in diagnosis.missing_physics} == set(hidden)


def test_an_effect_that_a_channel_shows_is_named_beside_a_load_that_drifts(
    short_drive: Drive, husky: Robot
) -> None:
    """The drift, up to twice what turning draws, correlates the residual over most of a run."""
    drifting = []
    for number, run in enumerate(short_drive(husky, effects={"turning": {"scrub": 0.3}})):
        share = np.clip(np.linspace(-0.6, 1.4, len(run.channels["time_s"])), 0.0, 1.0)
        drift_w = 60.0 * (share if number % 2 else 1.0 - share)
        power_w = run.channels["power_w"] + drift_w
        drifting.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    (found,) = diagnose(drifting, husky).missing_physics
    assert found.effect == "turning"
    assert found.parameters["scrub"].value == pytest.approx(0.3, rel=0.15)


def test_a_noisy_meter_does_not_hide_an_effect(drive: Drive, husky: Robot) -> None:
    """Its noise is most of the squared error, of which the effect explains less than a tenth."""
    rng = np.random.default_rng(1)
    runs = drive(
        husky, runs=4, minutes=4.0, effects={"compute": {"power_w": 29.0, "base_share": 1.0}}
    )
    noisy = with_power(
        runs, lambda of: of["power_w"] + 60.0 * rng.standard_normal(len(of["power_w"]))
    )
    (found,) = diagnose(noisy, husky).missing_physics
    assert found.effect == "compute"
    assert (
        found.evidence.held_out_gain is not None
        and found.evidence.held_out_gain < thresholds.SMALLEST_GAIN_TO_NAME
    )


def test_a_load_switched_on_part_way_is_found_with_its_time(
    short_drive: Drive, husky: Robot, analyse_once: Analyse
) -> None:
    runs = with_power(
        short_drive(husky, runs=3), lambda of: of["power_w"] + 25.0 * (of["time_s"] > 75.0)
    )
    analysis = analyse_once(runs, husky)
    diagnosis = analysis.diagnosis
    assert (
        diagnosis.file is not None
        and "is confounded with a fault of the meter" in diagnosis.file.why
    )
    # a load that is there half of the time is none of all the time
    assert not analysis.corrected.effects
    first = diagnosis.missing_physics[0]
    assert first.effect == "standby" and "sensor_offset" in first.confused_with
    assert first.parameters["power_w"].value == pytest.approx(25.0, rel=0.1)
    assert len(first.where) == 3
    assert all(place.start_s == pytest.approx(75.0, abs=6.0) for place in first.where)
    assert all(place.condition.startswith("after ") for place in first.where)


@pytest.mark.parametrize(("air_c", "thermostat"), [(2.0, "heater"), (18.0, None), (30.0, "cooler")])
def test_a_load_that_switches_is_found_with_its_rhythm_or_in_cold_and_heat_as_a_thermostat(
    air_c: float, thermostat: str | None, short_drive: Drive, husky: Robot
) -> None:
    runs = with_power(
        short_drive(husky), lambda of: of["power_w"] + 25.0 * (of["time_s"] % 40.0 < 12.0)
    )
    runs = [
        dataclasses.replace(
            run,
            channels={**run.channels, "temperature_c": np.full(len(run.channels["time_s"]), air_c)},
        )
        for run in runs
    ]
    first = diagnose(runs, husky).missing_physics[0]
    if thermostat:
        assert (first.effect, "intermittent_load" in first.confused_with) == (thermostat, True)
    else:
        assert first.effect == "intermittent_load"
        assert not {"heater", "cooler"} & set(first.confused_with)
        assert first.parameters["period_s"].value == pytest.approx(40.0, rel=0.05)
        assert first.parameters["duty"].value == pytest.approx(0.3, abs=0.05)
        low, high = ends(first.parameters["duty"])
        assert 0.2 < low < high < 0.4  # the moments are known to a window of a second or two


def warming(runs: list[Recording], from_c: float, to_c: float) -> list[Recording]:
    """The runs of a day on which the air warms up."""
    edges_c = np.linspace(from_c, to_c, len(runs) + 1)
    return [
        dataclasses.replace(
            run, channels={**run.channels, "temperature_c": np.linspace(a, b, len(run))}
        )
        for run, a, b in zip(runs, edges_c[:-1], edges_c[1:], strict=True)
    ]


def heated(
    runs: list[Recording], on_s: tuple[tuple[float, float], ...], power_w: float
) -> list[Recording]:
    """The runs with a load that is on in some stretches of the first."""

    def on(time_s: np.ndarray) -> np.ndarray:
        return np.asarray(
            np.any([(time_s >= start) & (time_s < end) for start, end in on_s], axis=0)
        )

    return [*with_power(runs[:1], lambda of: of["power_w"] + power_w * on(of["time_s"])), *runs[1:]]


def test_what_is_switched_is_on_or_off(drive: Drive, husky: Robot) -> None:
    """Of a load with three sizes there are schedules with three levels, but none of something that
    switches."""
    three = with_power(
        drive(husky, minutes=4.0),
        lambda of: (
            of["power_w"]
            + 25.0 * (of["time_s"] % 100.0 < 30.0)
            + 25.0 * (of["time_s"] % 100.0 < 60.0)
        ),
    )
    runs = average(usable_runs(three, husky)[0])
    fit = refit(runs, husky)
    residual = runs.observed - fit.predicted
    setting = Setting.of(fit, runs, residual)
    found = search("time", np.ones(len(residual)), residual, runs, signed=False)
    assert max(one.levels for one in found) > 2
    levels = {
        one.schedule.levels
        for one in CATALOGUE["intermittent_load"].forms(setting, True)
        if one.schedule
    }
    assert levels <= {2}


def test_a_load_that_grows_is_a_rival_of_what_its_growth_looks_like(
    short_runs: Runs, husky: Robot
) -> None:
    """A gripper that jams more each time: what the switched load leaves looks like rougher ground,
    but the same load, stronger at these times, explains as much."""
    rng = np.random.default_rng(9)
    jammed_w = np.zeros(len(short_runs.observed))
    for run in range(len(short_runs.signals)):
        time_s = short_runs.elapsed_s
        power_w = 15.0
        start_s = rng.exponential(15.0)
        while start_s < time_s.max():
            end_s = start_s + rng.uniform(3.0, 12.0)
            is_jammed = (short_runs.run == run) & (start_s <= time_s) & (time_s < end_s)
            jammed_w[is_jammed] = power_w
            power_w += 15.0
            start_s += 8.0 + rng.exponential(15.0)
    runs = dataclasses.replace(short_runs, observed=short_runs.observed + jammed_w)
    fit = refit(runs, husky)
    block = independent_blocks(fit, runs).channels
    naming = name_missing(fit, runs, block, np.random.default_rng(0), lambda step: None)
    load, growth = naming.named
    assert load.term.effect == "intermittent_load"
    assert growth.term.effect != "intermittent_load"
    assert "intermittent_load" in [rival.effect for rival in growth.rivals]


def test_a_radio_whose_power_rises_in_steps_is_told_by_its_channel(
    short_drive: Drive, husky: Robot
) -> None:
    runs = []
    for run in short_drive(husky):
        way_m = np.cumsum(run.channels["speed_mps"] * np.gradient(run.channels["time_s"]))
        base_m = np.minimum(way_m, way_m[-1] - way_m)
        steps_w = 15.0 * np.floor(
            np.minimum(4.0 * np.sqrt(np.maximum(base_m, 0.0) / base_m.max()), 3.0)
        )
        power_w = run.channels["power_w"] + steps_w
        runs.append(
            dataclasses.replace(
                run, channels={**run.channels, "base_distance_m": base_m, "power_w": power_w}
            )
        )
    first = diagnose(runs, husky).missing_physics[0]
    assert first.effect == "radio"
    assert first.where[0].condition.startswith("further from base than")


def test_a_radio_in_a_room_takes_as_much_over_a_few_metres(
    short_drive: Drive, husky: Robot
) -> None:
    runs = []
    for run in short_drive(husky):
        base_m = 2.5 - 2.5 * np.cos(run.channels["time_s"] / 9.0)
        power_w = run.channels["power_w"] + 1.2 * base_m**2
        runs.append(
            dataclasses.replace(
                run, channels={**run.channels, "base_distance_m": base_m, "power_w": power_w}
            )
        )
    first = diagnose(runs, husky).missing_physics[0]
    assert first.effect == "radio"
    assert first.parameters["w_per_km2"].value == pytest.approx(1.2e6, rel=0.1)


def test_a_late_power_clock_is_an_instrument_and_changes_no_robot(
    short_drive: Drive, husky: Robot
) -> None:
    runs = with_power(
        short_drive(husky), lambda of: np.interp(of["time_s"] - 3.6, of["time_s"], of["power_w"])
    )
    analysis = analyse(runs, husky)
    first = analysis.diagnosis.missing_physics[0]
    assert first.effect == "clock_lag"
    assert first.parameters["lag_s"].value == pytest.approx(3.6, abs=0.15)
    assert analysis.corrected.effects == husky.effects


def test_a_late_power_clock_is_named_beside_inertia_however_late_it_seems_alone(
    short_drive: Drive, husky: Robot
) -> None:
    hidden = short_drive(husky, effects={"inertia": {"mass_factor": 2.5}})
    runs = with_power(hidden, lambda of: np.interp(of["time_s"] - 1.2, of["time_s"], of["power_w"]))
    late, inertia = diagnose(runs, husky).missing_physics
    assert (late.effect, inertia.effect) == ("clock_lag", "inertia")
    assert late.parameters["lag_s"].value == pytest.approx(1.2, abs=0.1)
    assert inertia.parameters["mass_factor"].value == pytest.approx(2.5, rel=0.1)


def test_a_meter_that_soon_reads_too_much_was_right_before(
    short_drive: Drive, husky: Robot
) -> None:
    """However long a fault lasts, the robot is as it was read before it began."""
    recordings = []
    for run, since in zip(short_drive(husky, runs=3), (0.4, 0.0, 0.0), strict=True):
        after = np.linspace(0.0, 1.0, len(run)) >= since
        read_w = run.channels["power_w"] * np.where(after, 1.25, 1.0)
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": read_w}))
    analysis = analyse(recordings, husky)
    assert [one.effect for one in analysis.diagnosis.missing_physics] == ["sensor_gain"]
    assert analysis.diagnosis.missing_physics[0].parameters["gain"].value == pytest.approx(
        0.25, abs=0.02
    )
    assert analysis.diagnosis.parameters_off == ()


@pytest.mark.parametrize("effects", [
    {"regeneration": {"share": 0.6, "up_to_w": 12.0}, "inertia": {"mass_factor": 1.2}},
    {"breakaway": {"start_j": 300.0, "over_m": 1.5}},
])  # fmt: skip
def test_a_parameter_beside_the_size_is_fitted_and_written(
    effects: Mapping[str, Mapping[str, float]], drive: Drive, husky: Robot
) -> None:
    """The largest braking power that motors take, and the way over which a start is spent."""
    robot = dataclasses.replace(husky, rolling_resistance=0.05 * husky.rolling_resistance)
    analysis = analyse(drive(robot, minutes=4.0, effects=effects), robot)
    assert {one.effect for one in analysis.diagnosis.missing_physics} == {*effects}
    for one in analysis.diagnosis.missing_physics:
        for name, value in one.parameters.items():
            assert ends(value)[0] < effects[one.effect][name] < ends(value)[1]
            assert analysis.corrected.effects[one.effect][name] == pytest.approx(
                effects[one.effect][name], rel=0.1
            )


def test_a_limit_that_is_never_reached_is_at_its_default(
    short_drive: Drive, husky: Robot, analyse_once: Analyse
) -> None:
    robot = dataclasses.replace(husky, rolling_resistance=0.2 * husky.rolling_resistance)
    hidden = {"regeneration": {"share": 0.6}, "inertia": {"mass_factor": 1.2}}
    corrected = analyse_once(short_drive(robot, runs=3, effects=hidden), robot).corrected
    assert corrected.effects["regeneration"].get("up_to_w", NO_LIMIT_W) == NO_LIMIT_W


def test_the_corrected_robot_drives_in_the_environments(
    scrubbing: Analysis, tmp_path: Path
) -> None:
    write_outputs(scrubbing, tmp_path)
    written = tomllib.loads((tmp_path / "corrected.toml").read_text())
    assert written["effects"]["turning"]["scrub"] == pytest.approx(0.3, rel=0.1)
    env = gym.make("homeward/OutAndBack-v0", robot=str(tmp_path / "corrected.toml"))
    env.reset(seed=0)
    _, _, _, _, info = env.step(env.action_space.sample())
    assert "turning" in info["energy_j"]
    assert Diagnosis.from_json((tmp_path / "diagnosis.json").read_text()) == scrubbing.diagnosis


def test_turning_of_a_robot_without_a_known_track_is_named_with_an_interval_for_its_track(
    short_drive: Drive,
) -> None:
    trackless = load_robot("rusti")
    assert trackless.track_m == 0.0
    analysis = analyse(
        short_drive(trackless, track_m=0.5, effects={"turning": {"scrub": 0.3}}), trackless
    )
    (named,) = analysis.diagnosis.missing_physics
    assert named.effect == "turning"
    for name, true in (("scrub", 0.3), ("track_m", 0.5)):
        low, high = ends(named.parameters[name])
        assert low <= true <= high
    assert analysis.corrected.track_m == pytest.approx(named.parameters["track_m"].value, rel=1e-5)


def test_a_zero_that_creeps_through_all_runs_is_a_fault_of_the_sensor(
    short_drive: Drive, husky: Robot
) -> None:
    creeping: list[Recording] = []
    for run in short_drive(husky):
        start_w = 10.0 * len(creeping)
        rising_w = start_w + np.linspace(0.0, 10.0, len(run.channels["time_s"]))
        creeping += with_power([run], lambda of, rising_w=rising_w: of["power_w"] + rising_w)  # type: ignore[misc]
    diagnosis = diagnose(creeping, husky)
    assert diagnosis.missing_physics[0].effect == "sensor_offset"
    assert diagnosis.missing_physics[0].parameters["offset"].value == pytest.approx(40.0, rel=0.1)


def test_what_a_named_effect_leaves_is_said_where_it_depends_on_a_channel(
    short_drive: Drive, husky: Robot
) -> None:
    """Turning, which the catalogue knows, and a drive that chatters in a band of speeds, which it
    does not."""
    runs = chattering(short_drive(husky, effects={"turning": {"scrub": 0.5}}))
    analysis = analyse(runs, husky)
    assert [one.effect for one in analysis.diagnosis.missing_physics] == ["turning"]
    assert {"recorded", "motion together"} <= {
        check.condition for check in analysis.diagnosis.together if check.holds
    }
    assert analysis.evidence is not None
    assert analysis.evidence.remaining is not None
    assert "m/s" in analysis.evidence.remaining.location.condition
    assert "A residual is left" in analysis.diagnosis.summary


def test_a_load_that_comes_on_in_the_same_places_every_day_is_not_said_to_come_by_the_clock(
    short_drive: Drive, husky: Robot
) -> None:
    recordings = []
    for run in short_drive(husky):
        way_m = np.cumsum(0.1 * run.channels["speed_mps"])
        base_m = np.abs(40.0 - np.mod(way_m, 80.0))  # to and fro
        read_w = run.channels["power_w"] + 40.0 * (np.mod(base_m, 20.0) > 12.0)
        of = {**run.channels, "power_w": read_w, "base_distance_m": base_m}
        recordings.append(dataclasses.replace(run, channels=of))
    named = {one.effect for one in diagnose(recordings, husky).missing_physics}
    assert not named & {"intermittent_load", "standby", "sensor_offset", "sensor_gain", "payload"}


def test_bursts_at_random_that_no_channel_tells_are_unknown_physics_and_not_a_change_of_parameters(
    short_drive: Drive, husky: Robot
) -> None:
    """Each other than the last, so that no schedule of a load that is on or off follows them."""
    rng = np.random.default_rng(5)
    recordings = []
    for run in short_drive(husky):
        time_s, read_w = run.channels["time_s"], run.channels["power_w"].copy()
        for start_s in np.cumsum(rng.exponential(9.0, 40)):
            read_w += rng.exponential(40.0) * (
                (time_s >= start_s) & (time_s < start_s + rng.uniform(2.0, 8.0))
            )
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": read_w}))
    assert diagnose(recordings, husky).verdict == "unknown_physics"


def test_ground_that_changes_all_the_time_in_places_that_are_met_again_is_no_hypothesis(
    drive: Drive, husky: Robot
) -> None:
    def ground(place_known: bool) -> set[int]:
        """Changes in time of the ground that are tried."""
        recordings = []
        for run in drive(husky, runs=3, minutes=4.0):
            of, time_s = dict(run.channels), run.channels["time_s"]
            way_m = np.cumsum(0.1 * np.abs(of["speed_mps"]))
            of |= {"base_distance_m": np.abs(20.0 - np.mod(way_m, 40.0))} if place_known else {}
            of["power_w"] = of["power_w"] + 120.0 * np.abs(of["speed_mps"]) * (time_s % 40.0 < 20.0)
            recordings.append(dataclasses.replace(run, channels=of))
        runs = average(usable_runs(recordings, husky)[0])
        fit = refit(runs, husky)
        residual = runs.observed - fit.predicted
        setting = Setting.of(fit, runs, residual)
        forms = CATALOGUE["surface"].forms(setting, True)
        return {
            one.schedule.changes for one in forms if one.schedule is not None and one.axis == "time"
        }

    assert max(ground(place_known=False)) > 6
    assert max(ground(place_known=True), default=0) <= 6


def test_a_device_that_comes_on_is_named_beside_an_effect_of_motion(
    drive: Drive, husky: Robot
) -> None:
    """Motion, which causes the one, does not explain the other."""
    runs = drive(husky, runs=3, minutes=4.0, effects={"breakaway": {"start_j": 60.0}})
    since_s = (150.0, 100.0, 100.0)
    recordings = [
        with_power([run], lambda of, on_s=on_s: of["power_w"] + 20.0 * (of["time_s"] > on_s))[0]  # type: ignore[misc]
        for run, on_s in zip(runs, since_s, strict=True)
    ]
    named = diagnose(recordings, husky).missing_physics
    device, motion = sorted(named, key=lambda one: one.effect != "standby")
    assert device.effect == "standby"
    assert device.parameters["power_w"].value == pytest.approx(20.0, rel=0.15)
    assert motion.effect == "breakaway"


def test_a_payload_taken_up_in_mid_run_is_named_with_its_mass(drive: Drive, husky: Robot) -> None:
    """A fifth of the robot's mass, from another moment in each run; the last carries none.

    In runs of two minutes motors that heat up would explain nearly as much.
    """
    loaded = dataclasses.replace(husky, effects={"payload": {"mass_kg": 10.0}})
    recordings = []
    for run, since_s in zip(
        drive(husky, runs=4, minutes=4.0), (96.0, 120.0, 144.0, np.inf), strict=True
    ):
        more_w = replayed_w(loaded, run) - replayed_w(husky, run)
        power_w = run.channels["power_w"] + more_w * (run.channels["time_s"] >= since_s)
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    (payload,) = diagnose(recordings, husky).missing_physics
    assert payload.effect == "payload"
    assert payload.parameters["mass_kg"].value == pytest.approx(10.0, rel=0.15)
    assert [place.condition.split()[0] for place in payload.where] == ["after"] * 3
    assert [place.start_s for place in payload.where] == pytest.approx(
        [96.0, 120.0, 144.0], abs=20.0
    )


@pytest.mark.parametrize(
    ("share", "changes_s", "put_down"),
    [
        (0.2, (240.0, 300.0, 360.0, np.inf), False),
        (0.2, (240.0, 300.0, 360.0, 270.0), False),
        (0.5, (240.0, 300.0, 360.0, 270.0), False),
        (0.3, (240.0, 300.0, 360.0, 270.0, 330.0, np.inf), False),
        (0.3, (240.0, 300.0, 360.0, 270.0), True),
    ],
    ids=["three of four runs", "all runs", "half of its mass more", "six runs", "put down"],
)
def test_a_payload_that_changes_in_mid_run_is_named_with_its_mass(
    share: float, changes_s: tuple[float, ...], put_down: bool, husky: Robot
) -> None:
    """A share of the robot's mass, from another moment in each run or up to it.

    A stop of half a minute hides the moment.
    """
    mass_kg = share * husky.mass_kg
    loaded = dataclasses.replace(husky, effects={"payload": {"mass_kg": mass_kg}})
    recordings = []
    for seed, change_s in enumerate(changes_s):
        run = over_hills(husky, seed)
        is_loaded = (run.channels["time_s"] < change_s) == put_down
        more_w = over_hills(loaded, seed).channels["power_w"] - run.channels["power_w"]
        power_w = run.channels["power_w"] + more_w * is_loaded
        recordings.append(dataclasses.replace(run, channels={**run.channels, "power_w": power_w}))
    (payload,) = diagnose(recordings, husky).missing_physics
    assert payload.effect == "payload"
    assert payload.parameters["mass_kg"].value == pytest.approx(mass_kg, rel=0.05)
    moments_s = [place.end_s if put_down else place.start_s for place in payload.where]
    within_runs_s = [moment_s for moment_s in changes_s if moment_s < np.inf]
    assert moments_s == pytest.approx(within_runs_s, abs=30.0)


def test_a_rougher_stretch_of_the_way_is_named_where_it_lies(
    drive: Drive, husky: Robot, analyse_once: Analyse
) -> None:
    """Two fifths more rolling resistance between 40 and 75 m from base, there and back."""
    rough = dataclasses.replace(husky, rolling_resistance=1.4 * husky.rolling_resistance)
    recordings = []
    for run in drive(husky, runs=3, minutes=6.0):
        way_m = np.cumsum(np.abs(run.channels["speed_mps"]) * np.gradient(run.channels["time_s"]))
        base_m = np.minimum(way_m, way_m[-1] - way_m)
        more_w = (replayed_w(rough, run) - replayed_w(husky, run)) * (
            (base_m > 40.0) & (base_m < 75.0)
        )
        of = {
            **run.channels,
            "base_distance_m": base_m,
            "power_w": run.channels["power_w"] + more_w,
        }
        recordings.append(dataclasses.replace(run, channels=of))
    (surface,) = analyse_once(recordings, husky).diagnosis.missing_physics
    assert surface.effect == "surface"
    assert next(iter(surface.parameters.values())).value == pytest.approx(0.4, rel=0.15)


def replayed_w(robot: Robot, run: Recording) -> np.ndarray:
    """Power of a robot on the way of a recording."""
    of = run.channels
    return replay(
        robot, of["time_s"], of["speed_mps"], grade_rad=of["grade_rad"], yaw_rate_radps=of["yaw_rate_radps"],
        sensing_hz=of["sensing_hz"],
    ).power_w  # fmt: skip


def test_what_the_bends_of_a_way_cost_is_not_its_ground(husky: Robot) -> None:
    """A bent steering drags in left bends, which are always in the same places: trees on the motion
    explain more than any ground does."""
    runs = []
    for seed in range(4):
        channels = dict(hills.drive(husky, seed))
        moving = channels["speed_mps"] > 0.0
        place_m = channels["base_distance_m"]
        turning_radps = 0.5 * np.sin(2.0 * np.pi * place_m / 30.0) * moving
        power_w = replay(
            husky, channels["time_s"], np.abs(channels["speed_mps"]), yaw_rate_radps=turning_radps
        ).power_w
        dragged_w = 60.0 * np.tanh(np.maximum(turning_radps, 0.0) / 0.1)
        noise = 1.0 + 0.01 * np.random.default_rng(seed).normal(size=len(power_w))
        del channels["elevation_m"]
        channels |= {
            "yaw_rate_radps": turning_radps,
            "grade_rad": np.zeros(len(power_w)),
            "power_w": noise * (power_w + dragged_w),
        }
        runs.append(Recording(f"run{seed}.csv", str(seed), channels))
    diagnosis = diagnose(runs, husky)
    assert diagnosis.verdict == "unknown_physics"
    refused = diagnosis.together[-1]
    assert refused.condition == "motion together"
    assert thresholds.SIMPLER < refused.value < refused.limit == 1.0
