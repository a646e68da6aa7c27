"""A hypothesis: one effect or fault, the regressors that it adds to the refit, and how it is
reported and verified.

An effect whose channels show when it is at work needs only its entry: every other field has a
default. Its regressor comes from the kernel: the replay with the effect less the replay without it.
Where no channel shows it, its size follows a schedule with change points found from the residual,
and the way it changes distinguishes such effects: a load is added at standstill, the ground changes
while the robot moves, a battery ages between runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from homeward.diagnosis import thresholds
from homeward.diagnosis.explain import change_points
from homeward.diagnosis.explain.change_points import Axis, Changes, Schedule
from homeward.diagnosis.explain.menu import Drive
from homeward.diagnosis.explain.residual_test import TESTED
from homeward.diagnosis.fit.parameter_groups import ROLLING, Parameters
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.logs.channels import Array, Mask
from homeward.physics import Robot
from homeward.physics.effects import Effect, Parameter

TINY = 1e-6
"""Share of the largest size of an effect at which its response is linear. Chosen: small, and above
rounding."""
# of a number, for difference quotients; chosen: small beside it, large beside rounding
SMALL_STEP = 1e-3

CHECKS: Mapping[str, str] = {
    "force": "tow the robot over the ground with a spring balance, its drive disengaged",
    "drive": "lift the wheels off the ground and log the power at several speeds",
    "ancillary": "put a clamp meter on the lead of the {name}",
    "battery": "discharge a full battery through a known load and compare its energy with the rated one",
    "instrument": "compare the log with a second instrument",
}
"""The measurement that identifies an effect where no drive does, by where it enters."""

_ALWAYS_GIVEN = ("time_s", "power_w", "distance_m")
_PIECES = 4  # of a rising function; chosen: three bends
_SWITCHED = ("repeatedly", "in the cold", "in the heat")
_SUDDEN = ("standing", "once", *_SWITCHED)
# ways to change that are only typical; the others define an effect
_PREFERENCES = ("standing", "moving")

Numbers = Mapping[str, float]
Spread = Mapping[str, tuple[float, float]]
Forms = Callable[["Hypothesis", "Setting"], Iterator["Term"]]


@dataclass(frozen=True)
class Instrument:
    """A fault of the reading and not of the robot; the fields are those of a physical effect.

    It corrects the reading of recordings only; no robot file contains it.
    """

    id: str
    parameters: tuple[Parameter, ...]
    sentence: str
    equation: str
    source: str
    needs: tuple[str, ...]
    confused_with: tuple[str, ...] = ()
    kind: Literal["instrument"] = "instrument"

    @property
    def switch(self) -> Parameter:
        """The magnitude."""
        return self.parameters[0]


@dataclass(frozen=True)
class Term:
    """One form of a hypothesis: its regressors, (windows, sizes), in W or A per unit of size, and
    bounds of the sizes.

    `hidden` counts parameters that were searched beside the sizes, for BIC.
    """

    hypothesis: Hypothesis
    columns: Array
    low: Array  # (sizes,)
    high: Array
    hidden: int = 0
    shape: Numbers = field(default_factory=dict)  # values of the effect's other parameters
    axis: Axis | Literal["steady"] = "steady"  # what the size depends on
    schedule: Schedule | None = None
    # intervals of parameters estimated from the schedule
    spread: Spread = field(default_factory=dict)
    fixed: bool = False  # whether its columns are not computed by the kernel
    typical: bool = True  # whether the size changes in the way typical of this effect
    # C_rr m, by the refit or an earlier joint fit, where its sizes are shares of it
    of_rolling_kg: float | None = None
    # contribution per unit where it is at work, (windows,), None if everywhere
    load: Array | None = None
    at_work: Array | None = None  # share of each size that is at work, (windows, sizes)
    flexible: bool = False  # whether its sizes form any rising function, which no file can express
    plain: Term | None = None  # the best form that a robot file can express, where this one is not

    @property
    def effect(self) -> str:
        """Id of the effect."""
        return self.hypothesis.id

    @property
    def linear(self) -> bool:
        """Whether its contribution is linear in its sizes, so that no replay with other sizes is
        needed.

        Rough ground is replayed: where the drive draws nothing downhill, it may draw something over
        rougher ground.
        """
        return self.of_rolling_kg is None and (self.axis != "steady" or self.fixed)

    @property
    def misread(self) -> bool:
        """Whether it is a reading error of the power meter."""
        return not self.hypothesis.physical and self.linear


@dataclass(frozen=True)
class Setting:
    """Inputs of hypotheses: the runs, the refit's parameters, the effects in the model, the
    residual."""

    runs: Runs
    parameters: Parameters
    theta: Array  # (groups,)
    present: WithEffects  # effects that are already in the model
    predicted: Array  # (windows,)
    residual: Array  # (windows,)

    @classmethod
    def of(cls, fit: Refit, runs: Runs, residual: Array | None = None) -> Setting:
        """Setting of a refit with its own residual or another, shape (windows,)."""
        if residual is None:
            residual = runs.observed - fit.predicted
        return cls(
            runs=runs,
            parameters=fit.parameters,
            theta=fit.theta,
            present=WithEffects(),
            predicted=fit.predicted,
            residual=residual,
        )

    @property
    def rolling_kg(self) -> float:
        """C_rr m, of the robot file where a fit without rough ground estimates it near zero."""
        fitted_kg = float(self.theta[ROLLING])
        assumed_kg = float(self.parameters.start[ROLLING])
        is_material = fitted_kg > thresholds.MATERIAL_SHARE * assumed_kg
        return fitted_kg if is_material else assumed_kg

    def response(self, hypothesis: Hypothesis, size: float, shape: Numbers) -> Array:
        """Contribution of an effect of this size beyond the robot file's, per unit of size, shape
        (windows,)."""
        in_model = {**self.parameters.nominal.effects, **self.present.effects}
        lacking = {
            name: numbers for name, numbers in hypothesis.beside.items() if name not in in_model
        }
        base = self.present
        predicted = self.predicted
        if lacking:  # what the effect requires is no part of its contribution
            base = replace(base, effects={**base.effects, **lacking})
            predicted = self.parameters.predict(self.runs, self.theta, base)
        switch = hypothesis.entry.switch
        size_in_file, numbers_in_file = hypothesis.in_file(self.parameters.nominal)
        if size_in_file + size > switch.high:  # at the bound, the response from below
            size = -size
        numbers = {**shape, **numbers_in_file, switch.name: size_in_file + size}
        with_effect = replace(base, effects={**base.effects, hypothesis.id: numbers})
        return (self.parameters.predict(self.runs, self.theta, with_effect) - predicted) / size


def responses(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """Forms of one constant size, at each of a few values of its other parameters, or at the robot
    file's."""
    switch = hypothesis.entry.switch
    size_in_file, numbers_in_file = hypothesis.in_file(setting.parameters.nominal)
    shapes = [numbers_in_file]
    if not size_in_file:
        shapes = list(hypothesis.shapes(setting))
    low, high = hypothesis.limits(1)
    tiny = TINY * max(abs(switch.low), switch.high)
    for shape in shapes:
        column = setting.response(hypothesis, tiny, shape)
        searched = len(shapes) > 1 and bool(shape)
        yield Term(
            hypothesis,
            column[:, None],
            low=low - size_in_file,
            high=high - size_in_file,
            hidden=int(searched),
            shape=shape,
        )


def rising(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """Form as any increasing, piecewise linear function of its channel: the channel is identified
    before the form."""
    values = setting.runs.context.get(hypothesis.rises_with.lstrip("-"))
    if not hypothesis.rises_with or values is None or not np.isfinite(values).all():
        return
    if hypothesis.rises_with.startswith("-"):
        values = -values
    if hypothesis.rises_with in {channel.name for channel in TESTED if channel.magnitude}:
        values = np.abs(values)
    distinct = np.unique(np.round(values, 6))
    if len(distinct) < 3:
        return  # two values determine no form
    edges = np.unique(np.quantile(distinct, np.linspace(0.0, 1.0, _PIECES + 1)))
    # Each piece rises from 0 to 1 between two edges: with sizes from 0 up, their sum never falls.
    pieces = np.clip((values[:, None] - edges[:-1]) / np.diff(edges), 0.0, 1.0)
    columns = pieces
    if hypothesis.entry.kind == "battery":  # a share of the power drawn
        columns = setting.predicted[:, None] * pieces
    largest = float(np.max(np.abs(setting.runs.observed)))
    sizes = columns.shape[1]
    yield Term(
        hypothesis,
        columns,
        low=np.zeros(sizes),
        high=np.full(sizes, largest),
        fixed=True,
        flexible=True,
    )


def levels(hypothesis: Hypothesis, setting: Setting) -> Iterator[Term]:
    """Forms whose size has change points, in time or place, found from the residual, or a smooth
    profile by place."""
    if hypothesis.changes is None:
        return
    load = hypothesis.load(hypothesis, setting)
    if load is None:
        return
    rolling_kg = setting.rolling_kg if hypothesis.of_rolling else None
    yield from _changing(hypothesis, hypothesis.changes, setting, load, "time", rolling_kg)
    if hypothesis.by_place:
        yield from _changing(hypothesis, hypothesis.changes, setting, load, "place", rolling_kg)
        yield from _along_the_way(hypothesis, setting, load, rolling_kg)


def _changing(
    hypothesis: Hypothesis,
    how: Changes,
    setting: Setting,
    load: Array,
    axis: Axis,
    rolling_kg: float | None,
) -> Iterator[Term]:
    """Forms whose size has change points along one axis."""
    runs = setting.runs
    all_windows = np.ones(len(load), np.bool_)
    for schedule in hypothesis.search(
        axis, load, setting.residual, runs, all_windows, change_points.SHARES
    ):
        if _cannot_be(hypothesis, schedule, runs):
            continue
        typical = axis == "place" or change_points.may_change(how, schedule, runs)
        changes_rarely = change_points.most_in_a_run(schedule, runs) <= thresholds.RARE_CHANGES
        if not typical and (how not in _PREFERENCES or not changes_rarely):
            continue
        typical = typical and not hypothesis.seldom
        rhythm, spread = hypothesis.rhythm(schedule, runs)
        cost_of_a_change = (
            1 if change_points.clearly_apart(schedule) else thresholds.COST_OF_A_CHANGE
        )
        hidden = cost_of_a_change * schedule.changes
        if not typical:
            # of two effects with the same schedule, the one that it is typical of has the lower BIC
            hidden += 1
        at_work = schedule.at_work()
        low, high = hypothesis.limits(schedule.levels - 1, hypothesis.signed)
        yield Term(
            hypothesis,
            load[:, None] * at_work,
            low=low,
            high=high,
            hidden=hidden,
            shape=rhythm,
            axis=axis,
            schedule=schedule,
            spread=spread,
            typical=typical,
            of_rolling_kg=rolling_kg,
            load=load,
            at_work=at_work,
        )


def _cannot_be(hypothesis: Hypothesis, schedule: Schedule, runs: Runs) -> bool:
    """Whether the effect cannot have such a schedule, whatever its size."""
    if hypothesis.is_switched and schedule.levels > 2:
        return True  # a switched load is on or off: more levels would fit a drift
    if (
        schedule.axis == "place"
        or not hypothesis.by_place
        or schedule.changes <= hypothesis.most_changes
    ):
        return False
    # where places are revisited, their ground does not change
    return change_points.place_of(runs) is not None


def _along_the_way(
    hypothesis: Hypothesis, setting: Setting, load: Array, rolling_kg: float | None
) -> Iterator[Term]:
    """Forms whose size is a smooth profile along the way from base."""
    for hats in change_points.profiles(setting.runs):
        low, high = hypothesis.limits(hats.shape[1])
        yield Term(
            hypothesis,
            load[:, None] * hats,
            low=low,
            high=high,
            axis="place",
            of_rolling_kg=rolling_kg,
            load=load,
            at_work=hats,
        )


def everywhere(hypothesis: Hypothesis, setting: Setting) -> Array:
    """A load of one watt in all windows, shape (windows,)."""
    return np.ones(len(setting.runs.observed))


def temperatures(parameter: Parameter) -> Callable[[Setting], Iterator[Numbers]]:
    """Values tried for a temperature: quantiles of the recorded ones, one beyond them, and 20
    degC."""

    def shapes(setting: Setting) -> Iterator[Numbers]:
        temperature_c = setting.runs.context["temperature_c"]
        recorded_c = temperature_c[np.isfinite(temperature_c)]
        tried_c: list[float] = []
        if len(recorded_c):
            tried_c += np.round(np.quantile(recorded_c, [0.3, 0.5, 0.7, 0.85]), 1).tolist()
        tried_c += [float(np.max(recorded_c, initial=-100.0)) + 0.1, 20.0]
        for value_c in dict.fromkeys(tried_c):
            if parameter.low <= value_c <= parameter.high:
                yield {parameter.name: float(value_c)}

    return shapes


def _defaults(setting: Setting) -> Iterator[Numbers]:
    yield {}


def _no_rhythm(schedule: Schedule, runs: Runs) -> tuple[Numbers, Spread]:
    return {}, {}


def _no_reach(runs: Runs) -> Numbers:
    return {}


def _response(hypothesis: Hypothesis, setting: Setting) -> Array:
    return setting.response(hypothesis, TINY * hypothesis.entry.switch.high, {})


def _level_names(term: Term) -> list[tuple[str, str]]:
    switch = term.hypothesis.entry.switch
    sizes = term.columns.shape[1]
    if term.flexible and term.hypothesis.rises_with:
        unit = "1" if term.hypothesis.entry.kind == "battery" else "W"
        return [(f"step_{size + 1}", unit) for size in range(sizes)]
    return [(level_name(switch.name, size, sizes), switch.unit) for size in range(sizes)]


def level_name(name: str, size: int, sizes: int) -> str:
    """Name of one of the sizes of a term."""
    if sizes == 1:
        return name
    return f"{name}_level_{size + 1}"


def _as_effect(
    hypothesis: Hypothesis, so_far: WithEffects, numbers: Numbers, runs: Runs
) -> WithEffects:
    return replace(so_far, effects={**so_far.effects, hypothesis.id: dict(numbers)})


def _on_drive(hypothesis: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    base = WithEffects(hypothesis.beside)
    size_in_file, _ = hypothesis.in_file(drive.fit.parameters.nominal)
    numbers = {**shape, hypothesis.entry.switch.name: size_in_file + size}
    with_effect = hypothesis.within(hypothesis, base, numbers, drive.runs)
    theta = drive.fit.theta
    predicted = drive.predict(theta, base) if hypothesis.beside else drive.plain
    return drive.there(hypothesis.lies_in) * (drive.predict(theta, with_effect) - predicted)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One effect or fault of an instrument: its forms with and without a channel that shows it, fit
    and report."""

    entry: Effect | Instrument

    # channels that show when it is at work, all needed; None: those of `entry`
    needs: tuple[str, ...] | None = None
    beside: Mapping[str, Numbers] = field(default_factory=dict)  # effects that it requires
    shapes: Callable[[Setting], Iterator[Numbers]] = _defaults  # values of its other parameters
    rises_with: str = ""  # channel that its power rises with in any form; with a minus, falls with
    steady: Forms | None = responses  # forms of one size; None if no channel shows it

    changes: Changes | None = None  # how its size changes for no recorded reason, if it may
    signed: bool = False  # whether its size may then also fall below the reference
    seldom: bool = False  # whether such a change is rare
    by_place: bool = False  # whether its size may change from place to place
    # changes in time that it may have in places that are revisited
    most_changes: int = thresholds.RARE_CHANGES
    # whether it is a share of the rolling resistance, in a file as rough ground
    of_rolling: bool = False
    # as if always at work; None if a channel shows it
    load: Callable[[Hypothesis, Setting], Array | None] = _response
    # numbers that a schedule shows
    rhythm: Callable[[Schedule, Runs], tuple[Numbers, Spread]] = _no_rhythm
    varying: Forms = levels  # forms whose size changes for no recorded reason

    # whether it counts forces at the wheels that the others count over the efficiency of the drive:
    # only its product with that efficiency is known
    times_efficiency: bool = False
    # of its size, where they are not those of its first parameter
    bounds: tuple[float, float] | None = None
    # name and unit of each size
    size_names: Callable[[Term], Sequence[tuple[str, str]]] = _level_names
    searched: tuple[Parameter, ...] = ()  # parameters that recordings may identify beside the size
    # adds it to a replay
    within: Callable[[Hypothesis, WithEffects, Numbers, Runs], WithEffects] = _as_effect
    # numbers in its file that give the range of the recordings
    reach: Callable[[Runs], Numbers] = _no_reach
    is_weather: bool = False  # whether it is weather, which no robot file contains

    map_channel: str = ""  # without it the effect may be that channel's influence

    # channels that show when it is at work; None: those of `entry`
    shown_by: tuple[str, ...] | None = None
    otherwise: str = "while driving"  # when it is at work, if no channel shows it
    check: str = ""  # measurement that identifies it where no drive does; default by kind
    at_wheels: bool = False  # whether it shows in motor current, as every force does
    lies_in: Literal["load", "ground", "route"] | None = None  # what a test drive must include
    # its contribution to a test drive
    on_drive: Callable[[Hypothesis, Drive, float, Numbers], Array] = _on_drive

    @property
    def id(self) -> str:
        """Its id."""
        return self.entry.id

    @property
    def name(self) -> str:
        """Its name in a sentence."""
        return self.id.replace("_", " ")

    def in_file(self, robot: Robot) -> tuple[float, Numbers]:
        """Its size and other numbers in a robot file: 0 and none if it is not there."""
        numbers = robot.effects.get(self.id, {})
        switch = self.entry.switch.name
        return numbers.get(switch, 0.0), {
            name: value for name, value in numbers.items() if name != switch
        }

    @property
    def physical(self) -> bool:
        """Whether it is of the robot or its surroundings, and no fault of an instrument."""
        return self.entry.kind != "instrument"

    @property
    def is_switched(self) -> bool:
        """Whether it is switched on and off where no channel shows it."""
        return self.changes in _SWITCHED

    @property
    def is_sudden(self) -> bool:
        """Whether it changes from one moment to the next where no channel shows it: what is
        switched, loaded or breaks, but neither ground nor weather."""
        return self.changes in _SUDDEN

    @property
    def of_current(self) -> bool:
        """Whether it shows in motor current, which measures only forces at the wheels."""
        return self.at_wheels or self.entry.kind == "force"

    @property
    def depends_on_force(self) -> bool:
        """Whether its power depends on that of the drive."""
        return self.entry.kind in ("force", "drive", "battery")

    @property
    def measurement(self) -> str:
        """The measurement that identifies it where no drive does."""
        return self.check or CHECKS[self.entry.kind].format(name=self.name)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels whose values show when it is at work, the most informative first."""
        if self.shown_by is not None:
            return self.shown_by
        tested = {channel.name for channel in TESTED}
        return tuple(name for name in self.entry.needs if name in tested)

    def limits(self, sizes: int, signed: bool = True) -> tuple[Array, Array]:
        """Least and largest value of each of its sizes."""
        low, high = self.bounds or (self.entry.switch.low, self.entry.switch.high)
        if not signed:
            low = 0.0
        return np.full(sizes, low), np.full(sizes, high)

    def forms(self, setting: Setting, varying: bool) -> Iterator[Term]:
        """Every form that these runs allow, those whose size changes for no recorded reason only if
        `varying`."""
        if self.steady is not None and not self.missing(setting.runs):
            yield from self.steady(self, setting)
            yield from rising(self, setting)
        if varying:
            yield from self.varying(self, setting)

    def search(
        self,
        axis: Axis,
        load: Array,
        residual: Array,
        runs: Runs,
        windows: Mask,
        shares: Sequence[float],
    ) -> list[Schedule]:
        """Schedules found by a search in these `windows`, shape (windows,), of few changes to many.

        Other windows have the level of those before them. A unit of size adds `load`, shape
        (windows,), where the effect is at work, and a change must explain such `shares` of the
        squared residual, the largest first.
        """
        load = load * windows
        residual = residual * windows
        schedules = change_points.search(
            axis, load, residual, runs, self.signed, shares, several=self.is_sudden
        )
        # An effect that begins once was absent before, however long it lasts.
        if self.changes == "once" and self.signed:
            return [schedule.from_the_first() for schedule in schedules]
        return schedules

    def missing(self, runs: Runs) -> tuple[str, ...]:
        """Channels that it needs and that no run has."""
        recorded = {*runs.context, *_ALWAYS_GIVEN}
        if runs.unit == "W":
            recorded |= {"voltage_v", "current_a"}
        if "wheel_difference_mps" in recorded:
            recorded.add("yaw_rate_radps")
        needs = self.entry.needs if self.needs is None else self.needs
        return tuple(name for name in needs if name not in recorded)

    def looks_like(self, rival: Hypothesis, runs: Runs) -> bool:
        """Whether the two are known to be confounded and no channel of these runs separates
        them."""
        confused = rival.id in self.entry.confused_with or self.id in rival.entry.confused_with
        separating = {*self.entry.needs, *rival.entry.needs}
        not_recorded = separating - {*runs.context, *_ALWAYS_GIVEN}
        return confused and bool(not_recorded)
