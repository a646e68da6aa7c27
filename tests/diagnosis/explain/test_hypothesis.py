"""A hypothesis adds what the kernel says of its effect, in every form that the recordings allow."""

import dataclasses

import numpy as np
import pytest

from homeward.diagnosis.explain.catalogue import CATALOGUE
from homeward.diagnosis.explain.hypothesis import (
    Hypothesis,
    Setting,
    level_name,
    levels,
    responses,
    rising,
    temperatures,
)
from homeward.diagnosis.fit.parameter_groups import ROLLING
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.physics.effects import Effect, Parameter

WARM = Parameter("warm_c", "degC", -20.0, 30.0, "temperature")
SWITCH = Parameter("power_w", "W", 0.0, 10.0, "power")


def invented(kind: str = "ancillary", **needs: tuple[str, ...]) -> Effect:
    """An effect that no robot has."""
    return Effect(
        id="invented", kind=kind, function=lambda p, s, x, load: 0.0, parameters=(SWITCH,),  # type: ignore[arg-type]
        sentence="", equation="", source="", needs=needs.get("needs", ("time_s",)),
        confused_with=needs.get("confused_with", ()),
    )  # fmt: skip


def with_context(runs: Runs, **channels: np.ndarray) -> Runs:
    return dataclasses.replace(runs, context={**runs.context, **channels})


def test_a_response_is_the_replay_with_the_effect_less_that_without_it(
    short_fit: Refit, short_runs: Runs
) -> None:
    """Turning is linear in its size while the drive does not feed back: per unit, any size gives
    the same."""
    (term,) = responses(CATALOGUE["turning"], Setting.of(short_fit, short_runs))
    with_it = short_fit.parameters.predict(
        short_runs, short_fit.theta, WithEffects({"turning": {"scrub": 0.3}})
    )
    going = short_fit.predicted > 1.2 * short_fit.predicted.min()
    np.testing.assert_allclose(
        0.3 * term.columns[going, 0], (with_it - short_fit.predicted)[going], rtol=1e-3, atol=1e-3
    )
    assert term.columns.max() > 10.0 and (term.hidden, term.linear) == (0, False)


def test_an_effect_beside_another_does_not_count_what_the_other_does(
    short_fit: Refit, short_runs: Runs
) -> None:
    """A watt of standby is a watt, whatever turning takes."""
    setting = Setting.of(short_fit, short_runs)
    beside = dataclasses.replace(CATALOGUE["standby"], beside={"turning": {"scrub": 0.3}})
    np.testing.assert_allclose(setting.response(beside, 5.0, {}), 1.0)


def test_a_rising_function_holds_every_line_and_never_falls(
    short_fit: Refit, short_runs: Runs
) -> None:
    one = dataclasses.replace(CATALOGUE["viscous"], rises_with="speed_mps")
    (term,) = rising(one, Setting.of(short_fit, short_runs))
    speed = short_runs.context["speed_mps"]
    steps = term.columns
    # Steps as high as their range of the channel is wide add up to the channel.
    weights = np.linalg.lstsq(steps, speed - speed.min(), rcond=None)[0]
    np.testing.assert_allclose(steps @ weights, speed - speed.min(), atol=1e-6)
    assert (weights > 0.0).all() and weights.sum() == pytest.approx(np.ptp(speed))
    assert (np.diff((steps @ np.arange(1.0, steps.shape[1] + 1.0))[np.argsort(speed)]) >= 0.0).all()
    assert term.flexible and (term.low == 0.0).all()
    (falling,) = rising(
        dataclasses.replace(one, rises_with="-speed_mps"), Setting.of(short_fit, short_runs)
    )
    total = falling.columns.sum(axis=1)
    assert (
        total[np.argmin(speed)] == pytest.approx(falling.columns.shape[1])
        and total[np.argmax(speed)] == 0.0
    )


@pytest.mark.parametrize("channel", ["yaw_rate_radps", "wheel_difference_mps"])
def test_of_turning_only_its_size_counts_for_a_rising_function(
    channel: str, short_fit: Refit, short_runs: Runs
) -> None:
    one, turning = (
        dataclasses.replace(CATALOGUE["viscous"], rises_with=channel),
        short_runs.context["yaw_rate_radps"],
    )
    both = (with_context(short_runs, **{channel: sign * turning}) for sign in (1.0, -1.0))
    (left,), (right,) = (list(rising(one, Setting.of(short_fit, runs))) for runs in both)
    np.testing.assert_allclose(left.columns, right.columns)


@pytest.mark.parametrize("values", [[1.0], [1.0, 2.0], [np.nan, 1.0, 2.0, 3.0]])
def test_two_values_or_a_gap_determine_no_form(
    short_fit: Refit, short_runs: Runs, values: list[float]
) -> None:
    runs = with_context(short_runs, temperature_c=np.resize(values, len(short_runs.observed)))
    one = dataclasses.replace(CATALOGUE["heater"], rises_with="temperature_c")
    assert list(rising(one, Setting.of(short_fit, runs))) == []


def test_three_values_determine_a_form(short_fit: Refit, short_runs: Runs) -> None:
    temperature_c = np.resize([1.0, 2.0, 4.0], len(short_runs.observed))
    one = dataclasses.replace(CATALOGUE["heater"], rises_with="temperature_c")
    (term,) = rising(
        one, Setting.of(short_fit, with_context(short_runs, temperature_c=temperature_c))
    )
    # As many steps as it takes to give each of them a value of its own.
    assert np.linalg.matrix_rank(term.columns) == 2


def test_a_step_of_the_residual_is_a_level_of_its_size(short_fit: Refit, short_runs: Runs) -> None:
    on = short_runs.time_s > 60.0
    residual = 20.0 * on + np.random.default_rng(0).standard_normal(len(on))
    found = list(levels(CATALOGUE["standby"], Setting.of(short_fit, short_runs, residual)))
    steps = [
        one
        for one in found
        if one.columns.shape[1] == 1 and ((one.columns[:, 0] > 0.0) == on).mean() > 0.98
    ]
    assert steps
    size = float(np.linalg.lstsq(steps[0].columns, residual, rcond=None)[0][0])
    assert size == pytest.approx(20.0, abs=0.5) and steps[0].linear and not steps[0].misread
    assert steps[0].hidden >= steps[0].schedule.changes  # type: ignore[union-attr]  # each is a parameter, for BIC


def test_a_switched_load_comes_and_goes_between_two_levels(
    short_fit: Refit, short_runs: Runs
) -> None:
    time_s, noise = (
        short_runs.time_s,
        np.random.default_rng(0).standard_normal(len(short_runs.time_s)),
    )

    def sizes(effect: str, residual: np.ndarray) -> set[int]:
        return {
            one.columns.shape[1]
            for one in levels(CATALOGUE[effect], Setting.of(short_fit, short_runs, residual))
        }

    comes_and_goes = noise + 20.0 * (np.floor(time_s / 20.0) % 2)
    assert sizes("intermittent_load", comes_and_goes) == {1}
    once = noise + np.where(time_s > 60.0, np.where(short_runs.run < 2, 20.0, 40.0), 0.0)
    assert 2 in sizes("standby", once) and 2 not in sizes("intermittent_load", once)
    in_one_run = noise + 20.0 * ((time_s > 60.0) & (short_runs.run == 0))
    assert sizes("standby", in_one_run) == {1} and sizes("intermittent_load", in_one_run) == set()


def test_an_effect_that_does_not_change_has_no_levels(short_fit: Refit, short_runs: Runs) -> None:
    residual = np.where(short_runs.time_s > 60.0, 20.0, 0.0)
    assert list(levels(CATALOGUE["turning"], Setting.of(short_fit, short_runs, residual))) == []
    setting = Setting.of(short_fit, short_runs, residual)
    assert {one.axis for one in CATALOGUE["standby"].forms(setting, varying=False)} <= {"steady"}
    assert {one.axis for one in CATALOGUE["standby"].forms(setting, varying=True)} >= {"time"}


@pytest.mark.parametrize(("theta_share", "rolling_share"), [(0.5, 0.5), (1e-6, 1.0)])
def test_rolling_that_a_fit_takes_for_none_is_that_of_the_file(
    short_fit: Refit, short_runs: Runs, theta_share: float, rolling_share: float
) -> None:
    theta = short_fit.theta.copy()
    assumed = short_fit.parameters.start[ROLLING]
    theta[ROLLING] = theta_share * assumed
    setting = dataclasses.replace(Setting.of(short_fit, short_runs), theta=theta)
    assert setting.rolling_kg == pytest.approx(rolling_share * assumed)


def test_temperatures_tried_are_recorded_ones_one_above_and_twenty(
    short_fit: Refit, short_runs: Runs
) -> None:
    temperature_c = np.linspace(0.0, 10.0, len(short_runs.observed))
    temperature_c[:10] = np.nan
    setting = Setting.of(short_fit, with_context(short_runs, temperature_c=temperature_c))
    tried = [one["warm_c"] for one in temperatures(WARM)(setting)]
    assert tried == pytest.approx([3.0, 5.0, 7.0, 8.5, 10.1, 20.0], abs=0.15)
    narrow = dataclasses.replace(WARM, low=4.0, high=9.0)
    assert [one["warm_c"] for one in temperatures(narrow)(setting)] == tried[1:4]


def test_channels_that_no_run_has_are_missing(short_runs: Runs) -> None:
    one = Hypothesis(
        invented(needs=("time_s", "power_w", "voltage_v", "yaw_rate_radps", "temperature_c"))
    )
    # power is voltage times current, and turning was recorded
    assert one.missing(short_runs) == ("temperature_c",)
    current = dataclasses.replace(
        short_runs, unit="A", context={"speed_mps": short_runs.context["speed_mps"]}
    )
    assert one.missing(current) == ("voltage_v", "yaw_rate_radps", "temperature_c")
    wheels = with_context(current, wheel_difference_mps=current.context["speed_mps"])
    assert one.missing(wheels) == ("voltage_v", "temperature_c")
    assert dataclasses.replace(one, needs=("speed_mps",)).missing(current) == ()


def test_without_its_channels_an_effect_has_no_steady_form(
    short_fit: Refit, short_runs: Runs
) -> None:
    assert list(CATALOGUE["heater"].forms(Setting.of(short_fit, short_runs), varying=False)) == []


def test_two_effects_look_alike_until_a_channel_tells_them_apart(short_runs: Runs) -> None:
    heater = Hypothesis(invented(needs=("temperature_c",), confused_with=("standby",)))
    standby = CATALOGUE["standby"]
    assert heater.looks_like(standby, short_runs) and standby.looks_like(heater, short_runs)
    warm = with_context(short_runs, temperature_c=np.zeros(len(short_runs.observed)))
    told_apart = set(standby.entry.needs) <= {*warm.context, "time_s", "power_w"}
    assert told_apart and not heater.looks_like(standby, warm)
    assert not Hypothesis(invented(needs=("temperature_c",))).looks_like(standby, short_runs)


def test_sizes_have_the_bounds_of_the_switch_or_their_own() -> None:
    one = Hypothesis(invented())
    np.testing.assert_array_equal(one.limits(2), [[0.0, 0.0], [10.0, 10.0]])
    either = dataclasses.replace(one, bounds=(-5.0, 5.0))
    np.testing.assert_array_equal(either.limits(1), [[-5.0], [5.0]])
    np.testing.assert_array_equal(either.limits(1, signed=False), [[0.0], [5.0]])
    assert (
        level_name("mass_kg", 0, 1) == "mass_kg"
        and level_name("mass_kg", 1, 2) == "mass_kg_level_2"
    )
