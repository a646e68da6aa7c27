"""Other channels show what no power does: the gauge the battery, its voltage a resistance, a
distance the odometer."""

import dataclasses
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from homeward import Robot, load_robot
from homeward.diagnosis import Diagnosis, Recording, analyse, diagnose
from homeward.diagnosis.explain.catalogue import terms
from homeward.diagnosis.explain.channel_effects.find import find_effects
from homeward.diagnosis.explain.channel_effects.meter import not_contradicted
from homeward.diagnosis.explain.channel_effects.shown import Capacity, ChannelEffect
from homeward.diagnosis.explain.gauge import weigh_gauge
from homeward.diagnosis.explain.hypothesis import Setting, Term
from homeward.diagnosis.fit.estimates import Estimate, estimates
from homeward.diagnosis.fit.folds import cut_blocks
from homeward.diagnosis.fit.parameter_groups import with_effects_of
from homeward.diagnosis.fit.refit import refit
from homeward.diagnosis.fit.replay import average
from homeward.diagnosis.fit.usable import usable_runs
from homeward.diagnosis.read.signals import signals
from homeward.diagnosis.tell.report import write_outputs
from homeward.physics.battery import FLAT
from homeward.physics.effects.cold_battery import cold_battery
from tests.diagnosis.conftest import Analyse
from tests.diagnosis.made_up import ends

Drive = Callable[..., list[Recording]]
HUSKY = dataclasses.replace(load_robot("husky"), chemistry=FLAT, cells_in_series=0)
"""Of constant voltage, as the batteries of the drives here."""


def with_charge(
    runs: Sequence[Recording], robot: Robot, lost: Sequence[float], step: float = 0.001
) -> list[Recording]:
    """The runs with the state of charge of a gauge that shows whole steps, its battery having lost
    a share of all."""
    recordings = []
    for run, gone in zip(runs, lost, strict=True):
        time_s, power_w = run.channels["time_s"], run.channels["power_w"]
        drawn_j = np.concatenate(([0.0], np.cumsum(power_w[:-1] * np.diff(time_s))))
        soc = 0.95 - drawn_j / (robot.usable_energy_j * (1.0 - gone))
        recordings.append(
            dataclasses.replace(run, channels={**run.channels, "soc": np.round(soc / step) * step})
        )
    return recordings


def at_terminals(
    runs: Sequence[Recording],
    resistance: float | Sequence[NDArray[np.float64] | float],
    noise_v: float = 0.03,
) -> list[Recording]:
    """The runs with voltage and current of a battery that gives their power through a resistance,
    as it empties."""
    recordings = []
    ohms = [resistance] * len(runs) if isinstance(resistance, float) else resistance
    for seed, (run, ohm) in enumerate(zip(runs, ohms, strict=True)):
        of = dict(run.channels)
        power_w = of.pop("power_w")
        cells_v = np.linspace(24.5, 24.0, len(power_w))
        of["current_a"] = 2.0 * power_w / (cells_v + np.sqrt(cells_v**2 - 4.0 * ohm * power_w))
        noise = noise_v * np.random.default_rng(seed).standard_normal(len(power_w))
        of["voltage_v"] = cells_v - ohm * of["current_a"] + noise
        recordings.append(dataclasses.replace(run, channels=of))
    return recordings


def on_a_cold_day(
    runs: Sequence[Recording], per_run_k: float = 4.0, in_run_k: float = 2.0
) -> list[Recording]:
    """The runs with an air that warms in each, and from one to the next, from -10 degC."""
    return [
        dataclasses.replace(
            run, channels={**run.channels, "temperature_c": -10.0 + per_run_k * at + warmer}
        )
        for at, run in enumerate(runs)
        for warmer in (in_run_k * run.channels["time_s"] / run.channels["time_s"][-1],)
    ]


def by_arrhenius(air_c: NDArray[np.float64], ohm: float) -> NDArray[np.float64]:
    """Resistance of cells with an activation energy of 35 kJ/mol, which have so many ohm at 25
    degC."""
    return np.asarray(ohm * np.exp(35e3 / 8.314 * (1.0 / (273.15 + air_c) - 1.0 / 298.15)))


def drawn_faster(
    runs: Sequence[Recording], robot: Robot, excess: float, reference_w: float
) -> list[Recording]:
    """The runs with the gauge of a battery of which high power leaves a part unreachable, by
    Peukert's law."""
    recordings = []
    for run in runs:
        power_w = run.channels["power_w"]
        lost_w = power_w * np.maximum(power_w / reference_w, 1.0) ** excess
        drawn_j = np.concatenate(([0.0], np.cumsum(lost_w[:-1] * np.diff(run.channels["time_s"]))))
        soc = np.round(0.95 - drawn_j / robot.usable_energy_j, 3)
        recordings.append(dataclasses.replace(run, channels={**run.channels, "soc": soc}))
    return recordings


def with_distance(runs: Sequence[Recording], scale: float) -> list[Recording]:
    """The runs with the distance that was driven, and speeds that read too much by a share of
    it."""
    recordings = []
    for run in runs:
        speed = run.channels["speed_mps"]
        way_m = np.concatenate(
            ([0.0], np.cumsum(np.abs(speed[:-1]) * np.diff(run.channels["time_s"])))
        )
        of = {**run.channels, "distance_m": way_m, "speed_mps": (1.0 + scale) * speed}
        recordings.append(dataclasses.replace(run, channels=of))
    return recordings


def shown(
    recordings: Sequence[Recording], robot: Robot
) -> tuple[Capacity | None, tuple[ChannelEffect, ...], dict[str, Estimate]]:
    """What the other channels tell beside a refit, and what that says of each group."""
    runs, _ = weigh_gauge(average([signals(one, robot) for one in recordings]), robot)
    fit = refit(runs, robot)
    block = cut_blocks(runs.run, runs.observed - fit.predicted)
    groups = {one.group.name: one for one in estimates(fit, runs, block)}
    return *find_effects(fit, runs, block, rng=np.random.default_rng(0)), groups


@pytest.fixture(scope="module")
def small() -> Robot:
    """A robot whose battery a drive of minutes empties by a good part."""
    return dataclasses.replace(HUSKY, rated_energy_j=1.2e5)


@pytest.fixture(scope="module")
def tiny() -> Robot:
    """A robot whose battery a drive of two minutes empties by most of it."""
    return dataclasses.replace(HUSKY, rated_energy_j=2.6e4)


def test_a_battery_that_fades_from_run_to_run_is_named_and_handed_back(
    drive: Drive, small: Robot, tmp_path: Path
) -> None:
    lost = (0.0, 0.08, 0.16, 0.24)
    analysis = analyse(with_charge(drive(small, runs=4, minutes=4.0), small, lost), small)
    diagnosis = analysis.diagnosis
    assert diagnosis.verdict == "missing_physics"
    (found,) = diagnosis.missing_physics
    low, high = ends(found.parameters["lost_share"])
    assert found.effect == "ageing"
    assert low <= found.parameters["lost_share"].value <= high
    assert found.parameters["lost_share"].value == pytest.approx(0.24, abs=0.03)
    assert {place.recording for place in found.where} >= {"run2.csv", "run3.csv"}
    assert "state of charge" in diagnosis.summary
    assert Diagnosis.from_json(diagnosis.to_json()) == diagnosis
    write_outputs(analysis, tmp_path)
    corrected = tomllib.loads((tmp_path / "corrected.toml").read_text())
    assert corrected["effects"]["ageing"]["lost_share"] == pytest.approx(0.24, abs=0.03)
    assert "not as assumed" not in (tmp_path / "report.html").read_text()


def test_a_battery_that_holds_less_in_all_runs_is_a_parameter_that_is_off(
    short_drive: Drive, tiny: Robot, analyse_once: Analyse
) -> None:
    analysis = analyse_once(with_charge(short_drive(tiny, runs=3), tiny, (0.3, 0.3, 0.3)), tiny)
    diagnosis = analysis.diagnosis
    assert diagnosis.verdict == "parameters_off"
    (off,) = diagnosis.parameters_off
    assert off.group == "usable energy"
    assert off.ci95[0] <= 0.7 * tiny.usable_energy_j <= off.ci95[1]
    assert analysis.corrected.rated_energy_j == pytest.approx(0.7 * tiny.rated_energy_j, rel=0.02)


def test_a_gauge_that_agrees_is_no_mismatch(drive: Drive, small: Robot) -> None:
    diagnosis = diagnose(
        with_charge(drive(small, runs=4, minutes=4.0), small, (0.0, 0.0, 0.0, 0.0), 0.01), small
    )
    assert diagnosis.verdict == "no_mismatch"


def test_a_gauge_that_goes_up_and_down_between_runs_is_not_called_ageing(
    drive: Drive, small: Robot
) -> None:
    diagnosis = diagnose(
        with_charge(drive(small, runs=4, minutes=4.0), small, (0.0, 0.2, 0.0, 0.2)), small
    )
    assert not diagnosis.missing_physics


def test_a_gauge_that_falls_far_too_fast_is_no_battery_that_fades(
    drive: Drive, small: Robot
) -> None:
    """It would have lost more than the effect allows, which no robot file takes."""
    large = dataclasses.replace(small, rated_energy_j=20.0 * small.rated_energy_j)
    recordings = with_charge(drive(large, runs=4, minutes=4.0), large, (0.0, 0.3, 0.6, 0.96))
    assert "ageing" not in {one.hypothesis.id for one in shown(recordings, large)[1]}


def test_fading_that_goes_with_the_cold_may_be_the_cold(drive: Drive, small: Robot) -> None:
    runs = [
        dataclasses.replace(
            run,
            channels={
                **run.channels,
                "temperature_c": np.full(len(run.channels["time_s"]), 20.0 - 8.0 * index),
            },
        )
        for index, run in enumerate(drive(small, runs=4, minutes=4.0))
    ]
    diagnosis = diagnose(with_charge(runs, small, (0.0, 0.08, 0.16, 0.24)), small)
    (found,) = diagnosis.missing_physics
    assert {found.effect, *found.confused_with} == {"ageing", "cold_battery"}
    assert found.to_tell_apart


def test_the_voltage_shows_a_resistance_that_power_at_the_terminals_does_not(
    short_drive: Drive, husky: Robot
) -> None:
    _, (found,), _ = shown(at_terminals(short_drive(husky), 0.15), husky)
    assert found.hypothesis.id == "internal_resistance"
    low, high = ends(found.parameters["ohm"])
    assert low <= 0.15 <= high and high - low < 0.03


def test_a_resistance_that_the_file_holds_is_not_asked_for_again(
    short_drive: Drive, husky: Robot
) -> None:
    holding = dataclasses.replace(husky, effects={"internal_resistance": {"ohm": 0.15}})
    _, found, _ = shown(at_terminals(short_drive(husky), 0.15), holding)
    assert found == ()


@pytest.mark.parametrize("per_run_k", [4.0, 9.0])
def test_a_resistance_that_falls_with_warmth_is_that_of_a_cold_battery(
    per_run_k: float, short_drive: Drive, husky: Robot
) -> None:
    cold = on_a_cold_day(short_drive(husky), per_run_k)
    runs = at_terminals(cold, [by_arrhenius(run.channels["temperature_c"], 0.05) for run in cold])
    _, (found,), _ = shown(runs, husky)
    assert found.hypothesis.id == "cold_battery" and set(found.rivals) <= {"internal_resistance"}
    record = dataclasses.replace(husky, effects=found.in_file).record().view(np.recarray)[0]
    for air_c in (-8.0, 0.0, -10.0 + 2.0 * per_run_k):
        ohm = float(by_arrhenius(np.array(air_c), 0.05))
        lost_w = cold_battery(record, None, SimpleNamespace(temperature_c=air_c), np.array(200.0))
        assert lost_w == pytest.approx(
            ohm * (200.0 / 23.0) ** 2, rel=0.15 if per_run_k < 5.0 else 0.3
        )
    _, again, _ = shown(runs, dataclasses.replace(husky, effects=found.in_file))
    assert again == ()


@pytest.mark.parametrize(
    "ohms", [(0.15, 0.15, 0.15, 0.15), (0.25, 0.2, 0.1, 0.15), (0.25, 0.2, 0.15, 0.1)]
)
def test_a_resistance_that_stays_or_differs_from_run_to_run_is_not_only_a_cold_battery(
    ohms: tuple[float, ...], short_drive: Drive, husky: Robot
) -> None:
    """Even if it happens to be smaller in the warmer runs."""
    _, (found,), _ = shown(at_terminals(on_a_cold_day(short_drive(husky)), ohms), husky)
    assert {found.hypothesis.id, *found.rivals} == {"internal_resistance", "cold_battery"}


def test_a_resistance_that_rises_as_the_battery_empties_is_not_only_a_cold_battery(
    short_drive: Drive, husky: Robot
) -> None:
    """While the air cools."""
    cooling = on_a_cold_day(short_drive(husky), per_run_k=0.0, in_run_k=-5.0)
    drawn = [np.cumsum(run.channels["power_w"]) for run in cooling]
    rising = [0.12 + 0.18 * one / drawn[0][-1] for one in drawn]
    _, (found,), _ = shown(at_terminals(cooling, rising), husky)
    assert {found.hypothesis.id, *found.rivals} == {"internal_resistance", "cold_battery"}


@pytest.mark.parametrize("law", ["warmth", "constant"])
def test_the_gauge_tells_a_cold_battery_from_a_resistance(
    law: str, drive: Drive, small: Robot
) -> None:
    cold, recordings = on_a_cold_day(drive(small, runs=4, minutes=4.0)), []
    for run in cold:
        power_w = run.channels["power_w"]
        ohm = by_arrhenius(run.channels["temperature_c"], 0.15) if law == "warmth" else 0.4
        lost_w = ohm * (power_w / small.nominal_voltage_v) ** 2
        drawn_j = np.concatenate(
            ([0.0], np.cumsum((power_w + lost_w)[:-1] * np.diff(run.channels["time_s"])))
        )
        soc = np.round(0.95 - drawn_j / small.usable_energy_j, 3)
        recordings.append(dataclasses.replace(run, channels={**run.channels, "soc": soc}))
    _, (found,), _ = shown(recordings, small)
    assert (found.hypothesis.id == "cold_battery") == (law == "warmth")
    assert "internal_resistance" in (found.hypothesis.id, *found.rivals)


def test_noise_of_the_voltage_and_a_distance_that_agrees_show_nothing(
    short_drive: Drive, husky: Robot
) -> None:
    runs = with_distance(at_terminals(short_drive(husky), 0.0, noise_v=0.2), 0.0)
    assert diagnose(runs, husky).verdict == "no_mismatch"
    capacity, found, _ = shown(runs, husky)
    assert capacity is None and found == ()


def test_an_odometer_that_all_distances_contradict_is_named_and_set_right(
    short_drive: Drive, husky: Robot
) -> None:
    runs = with_distance(short_drive(husky), 0.12)
    diagnosis = diagnose(runs, husky)
    (named,) = diagnosis.missing_physics
    assert named.effect == "odometry_scale"
    assert named.parameters["scale"].value == pytest.approx(0.12, abs=1e-3)
    assert diagnosis.parameters_off == ()
    _, _, groups = shown(runs, husky)
    rolling = groups["rolling"].ci95
    assert rolling is not None
    assert (
        rolling[0]
        <= husky.rolling_resistance * husky.mass_kg / husky.traction_efficiency
        <= rolling[1]
    )
    untold = [
        dataclasses.replace(
            run, channels={name: of for name, of in run.channels.items() if name != "distance_m"}
        )
        for run in runs
    ]
    _, _, groups = shown(untold, husky)
    biased = groups["rolling"].ci95
    assert biased is not None and biased[1] < rolling[1]  # nothing else sets it right


def test_one_odometer_of_six_that_a_distance_contradicts_is_named(
    short_drive: Drive, husky: Robot
) -> None:
    runs = short_drive(husky, runs=6, minutes=1.0)
    _, (found,), _ = shown([*with_distance(runs[:5], 0.0), *with_distance(runs[5:], 0.12)], husky)
    assert found.hypothesis.id == "odometry_scale"


def test_what_was_drawn_in_a_gap_does_not_count_against_the_battery(
    short_drive: Drive, tiny: Robot
) -> None:
    """Each run stops for five minutes, in which the robot went on drawing, and no power was
    recorded."""
    runs = []
    for run in with_charge(short_drive(tiny), tiny, (0.0,) * 4):
        of = {name: values.copy() for name, values in run.channels.items()}
        half = len(of["time_s"]) // 2
        of["time_s"][half:] += 300.0
        of["soc"][half:] -= 0.15
        runs.append(dataclasses.replace(run, channels=of))
    capacity, found, _ = shown(runs, tiny)
    assert capacity is not None and found == ()
    assert not capacity.off
    assert capacity.fitted_j == pytest.approx(tiny.usable_energy_j, rel=0.01)


def test_a_loss_that_grows_with_the_load_is_found_by_the_gauge_with_what_it_looks_like(
    short_drive: Drive, small: Robot
) -> None:
    _, (found,), _ = shown(drawn_faster(short_drive(small), small, 0.3, 80.0), small)
    alike = {"rate_capacity", "internal_resistance"}
    assert {found.hypothesis.id, *found.rivals} == alike


def test_only_where_the_load_varies_a_smaller_battery_is_told_from_a_loss_inside(
    short_drive: Drive, tiny: Robot
) -> None:
    varied = short_drive(tiny)
    rng = np.random.default_rng(0)
    even = [
        dataclasses.replace(
            run, channels={**run.channels, "power_w": 150.0 + rng.standard_normal(len(run))}
        )
        for run in varied
    ]
    cold = [
        dataclasses.replace(run, channels={**run.channels, "temperature_c": np.full(len(run), 4.0)})
        for run in varied
    ]
    for runs, rivals in ((even, ("internal_resistance",)), (varied, ()), (cold, ("cold_battery",))):
        capacity, found, _ = shown(with_charge(runs, tiny, (0.12,) * 4), tiny)
        assert capacity is not None and capacity.off and found == ()
        assert capacity.fitted_j == pytest.approx(0.88 * tiny.usable_energy_j, rel=0.02)
        assert capacity.rivals == rivals
    diagnosis = diagnose(with_charge(cold, tiny, (0.12,) * 4), tiny)
    assert diagnosis.parameters_off[-1].confused_with == ("cold_battery",)
    assert "(or as much is lost by cold_battery)" in diagnosis.summary
    assert Diagnosis.from_json(diagnosis.to_json()) == diagnosis


@pytest.mark.parametrize("as_power", [False, True])
@pytest.mark.parametrize("cause", ["load", "age"])
def test_what_the_gauge_showed_is_not_asked_for_again(
    cause: str, as_power: bool, drive: Drive, short_drive: Drive
) -> None:
    """Whether power is voltage times current or not: what the file's battery loses is no part of
    it."""
    robot = dataclasses.replace(HUSKY, rated_energy_j=0.6e5 if cause == "age" else 1.2e5)
    runs = (
        with_charge(drive(robot, runs=4, minutes=4.0), robot, (0.0, 0.08, 0.16, 0.24))
        if cause == "age"
        else drawn_faster(short_drive(robot), robot, 0.3, 80.0)
    )
    runs = runs if as_power else at_terminals(runs, 0.0)
    _, (first,), _ = shown(runs, robot)
    capacity, again, _ = shown(runs, with_effects_of(robot, first.in_file))
    assert capacity is None or not capacity.off
    assert again == ()


def test_the_power_of_a_file_that_loses_energy_inside_is_all_that_its_charge_falls_by(
    short_drive: Drive, tiny: Robot
) -> None:
    """Where the power itself is recorded, as the replay predicts it."""
    for effects in ({"internal_resistance": {"ohm": 0.3}}, {"ageing": {"lost_share": 0.15}}):
        runs = with_charge(short_drive(tiny, effects=effects), tiny, (0.0,) * 4)
        capacity, found, _ = shown(runs, dataclasses.replace(tiny, effects=effects))
        assert capacity is not None and not capacity.off and found == ()


@pytest.mark.parametrize(
    "effects",
    [{"cold_battery": {"per_k": 0.05}}, {"rate_capacity": {"excess": 1.0, "reference_w": 80.0}}],
)
def test_an_effect_of_the_file_may_be_at_its_bound(
    effects: dict[str, dict[str, float]], short_drive: Drive, small: Robot
) -> None:
    shown(
        with_charge(short_drive(small), small, (0.0,) * 4),
        dataclasses.replace(small, effects=effects),
    )


@pytest.mark.parametrize(
    ("drawn_w", "read_w", "named", "not_named"),
    [(60.0, 0.0, "standby", "sensor_offset"), (0.0, 60.0, "sensor_offset", "standby")],
)
def test_the_gauge_tells_a_load_from_a_zero_that_has_shifted(
    short_drive: Drive, husky: Robot, drawn_w: float, read_w: float, named: str, not_named: str
) -> None:
    def with_more(runs: Sequence[Recording], more_w: float) -> list[Recording]:
        return [
            dataclasses.replace(
                run,
                channels={**run.channels, "power_w": run.channels["power_w"] + more_w * (at > 1)},
            )
            for at, run in enumerate(runs)
        ]

    shown = with_charge(with_more(short_drive(husky), drawn_w), husky, [0.0] * 4)
    (found,) = diagnose(with_more(shown, read_w), husky).missing_physics
    assert found.effect == named and not_named not in found.confused_with


def test_beside_a_zero_that_has_shifted_the_gauge_does_not_refute_a_load(
    drive: Drive, small: Robot
) -> None:
    """What the meter adds is not drawn, and what the load adds is."""
    light, loaded = (drive(small, runs=5, minutes=4.0, mass_kg=mass_kg) for mass_kg in (50.0, 70.0))
    read = []
    for at, run in enumerate(with_charge([*light[:4], loaded[4]], small, [0.0] * 5)):
        read_w = run.channels["power_w"] + 40.0 * (at > 1)
        read.append(dataclasses.replace(run, channels={**run.channels, "power_w": read_w}))
    runs = average(usable_runs(read, small)[0])
    fit = refit(runs, small)
    setting, block = Setting.of(fit, runs), cut_blocks(runs.run, runs.observed - fit.predicted)
    candidates = terms(setting)

    def of(effect: str, found: Sequence[Term], since: int) -> list[Term]:
        same = (
            one
            for one in found
            if one.effect == effect and one.schedule and one.schedule.levels == 2
        )
        return [one for one in same if np.array_equal(one.schedule.level > 0, runs.run >= since)]  # type: ignore[union-attr]

    kept = not_contradicted(candidates, fit.jacobian, setting, np.zeros(len(runs.observed)), block)
    for effect, since, stays in (
        ("payload", 4, True),
        ("sensor_offset", 2, True),
        ("standby", 2, False),
    ):
        assert of(effect, candidates, since)
        assert bool(of(effect, kept, since)) == stays


@pytest.mark.parametrize(("excess", "reference_w"), [(0.2, 80.0), (0.4, 150.0)])
def test_a_loss_inside_the_battery_refutes_no_load(
    excess: float, reference_w: float, drive: Drive, small: Robot
) -> None:
    """By Peukert's law the charge falls less than the energy of bursts that are drawn at low
    power."""
    bursts = [
        dataclasses.replace(
            run, channels={**of, "power_w": of["power_w"] + 60.0 * (of["time_s"] % 37.0 < 15.0)}
        )
        for run in drive(small, runs=4, minutes=4.0)
        for of in (run.channels,)
    ]
    runs = average(usable_runs(drawn_faster(bursts, small, excess, reference_w), small)[0])
    fit = refit(runs, small)
    setting, block = Setting.of(fit, runs), cut_blocks(runs.run, runs.observed - fit.predicted)
    found = [one for one in terms(setting) if one.effect == "intermittent_load"]
    assert found
    assert (
        not_contradicted(found, fit.jacobian, setting, np.ones(len(runs.observed)), block) == found
    )


def test_what_began_once_and_stays_is_handed_over_where_the_gauge_shows_that_it_is_drawn(
    short_drive: Drive, husky: Robot
) -> None:
    runs = []
    for run, from_s in zip(short_drive(husky, runs=3), (60.0, 0.0, 0.0), strict=True):
        read_w = run.channels["power_w"] + 60.0 * (run.channels["time_s"] >= from_s)
        runs.append(dataclasses.replace(run, channels={**run.channels, "power_w": read_w}))
    runs = with_charge(runs, husky, [0.0] * 3)
    analysis = analyse(runs, husky)
    assert analysis.diagnosis.file is not None and analysis.diagnosis.file.holds == "corrected"
    assert analysis.corrected.effects["standby"]["power_w"] == pytest.approx(60.0, rel=0.1)
    assert analyse(runs[1:], analysis.corrected).diagnosis.verdict == "no_mismatch"


def test_a_meter_that_reads_more_from_some_run_on_is_no_battery_that_loses_less(
    drive: Drive, husky: Robot
) -> None:
    runs = [
        dataclasses.replace(
            run,
            channels={**run.channels, "power_w": run.channels["power_w"] * (1.0 + 0.3 * (at > 1))},
        )
        for at, run in enumerate(with_charge(drive(husky, runs=4, minutes=4.0), husky, [0.0] * 4))
    ]
    assert [one.effect for one in diagnose(runs, husky).missing_physics] == ["sensor_gain"]


@pytest.mark.parametrize(("shift_w", "found"), [(-8.0, ["sensor_offset"]), (0.0, [])])
def test_a_zero_that_has_shifted_is_known_by_the_charge_where_gusts_hide_it(
    shift_w: float, found: list[str], drive: Drive, small: Robot
) -> None:
    """The charge seems to fall faster from the third run on, as with a battery that has lost
    capacity."""
    small = dataclasses.replace(small, rated_energy_j=4.5e4)
    rng, runs = np.random.default_rng(3), []
    for at, run in enumerate(with_charge(drive(small, runs=4, minutes=4.0), small, [0.0] * 4)):
        gusts_w = (
            15.0 * np.sqrt(1.0 - 0.99**2) * lfilter([1.0], [1.0, -0.99], rng.normal(size=len(run)))
        )
        read_w = run.channels["power_w"] + gusts_w + shift_w * (at > 1)
        runs.append(dataclasses.replace(run, channels={**run.channels, "power_w": read_w}))
    capacity, effects, _ = shown(runs, small)
    assert [one.hypothesis.id for one in effects] == found
    assert capacity is not None and not capacity.off
    for one in effects:
        offset = one.parameters["offset"]
        assert ends(offset)[0] <= shift_w <= ends(offset)[1] < 0.0, offset


@pytest.mark.parametrize("excess", [0.15, 0.25, 0.4])
def test_a_loss_of_another_form_is_no_larger_than_the_charge_shows(
    excess: float, drive: Drive, small: Robot
) -> None:
    """Only high power loses; a capacity beyond the file's with a loss of nearly all energy would
    fit that as well."""
    runs = drawn_faster(drive(small), small, excess, reference_w=100.0)
    (found,) = shown(runs, small)[1]
    power_w = np.concatenate([run.channels["power_w"] for run in runs])
    true = np.mean(power_w * np.maximum(power_w / 100.0, 1.0) ** excess) / np.mean(power_w) - 1.0
    assert np.mean(found.contribution) / np.mean(power_w) == pytest.approx(true, abs=0.02)
