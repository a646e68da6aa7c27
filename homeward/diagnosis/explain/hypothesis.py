"""What a hypothesis is: one effect as the diagnosis tries it, tells it and has it checked.

An effect whose channels tell when it is at work needs no more than its entry: every other field has a default. What an
effect adds comes from the kernel: the replay with the effect less the replay without it. Where no channel tells, its
size follows a schedule that is found from the residual, and how it may change tells such effects apart: a load is put
on where the robot stands, the ground changes while it moves, a battery ages between runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from homeward.diagnosis import rules
from homeward.diagnosis.explain import change_points
from homeward.diagnosis.explain.change_points import Axis, Changes, Schedule
from homeward.diagnosis.explain.menu import Drive
from homeward.diagnosis.explain.residual_test import TESTED
from homeward.diagnosis.fit.parameter_groups import ROLLING, Parameters
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.fit.replay import Runs, WithEffects
from homeward.logs.channels import Array, Mask
from homeward.physics.effects import Effect, Parameter

TINY = 1e-6
"""Of the largest size of an effect: its response is linear there."""

CHECKS: Mapping[str, str] = {
    "force": "tow the robot over the ground with a spring balance, its drive disengaged",
    "drive": "lift the wheels off the ground and log the power at several speeds",
    "ancillary": "put a clamp meter on the lead of the {name}",
    "battery": "discharge a full battery through a known load and compare its energy with the rated one",
    "instrument": "compare the log with a second instrument",
}
"""The measurement that shows an effect where no drive does, by where it enters."""

_ALWAYS_GIVEN = ("time_s", "power_w", "distance_m")
_COST_OF_A_CHANGE = 3  # parameters: a moment that was searched for (Zhang & Siegmund, 2007)
_PIECES = 4  # of a function that only rises
_PREFERENCES = ("standing", "moving")  # between equals: mostly so; the other ways to change are what an effect means

Numbers = Mapping[str, float]
Spread = Mapping[str, tuple[float, float]]
Forms = Callable[["Hypothesis", "Setting"], Iterator["Term"]]


@dataclass(frozen=True)
class Instrument:
    """What is wrong with the reading and not with the robot; the fields mean what those of a physical effect mean.

    It corrects the reading of recordings only; no robot file takes it.
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
    """One form of a hypothesis: what a unit of its size adds, shape (windows, sizes), and bounds of the sizes.

    `hidden` counts what was searched for beside the sizes, for the comparison of models of different freedom.
    """

    hypothesis: Hypothesis
    columns: Array
    low: Array  # (sizes,)
    high: Array
    hidden: int = 0
    shape: Numbers = field(default_factory=dict)
    axis: Axis | Literal["steady"] = "steady"  # what the size depends on
    schedule: Schedule | None = None
    spread: Spread = field(default_factory=dict)  # interval of what the schedule shows
    fixed: bool = False  # whether its columns are no response of the kernel
    typical: bool = True  # whether the size changes as the sizes of this effect do
    of_rolling_kg: float | None = None  # C_rr m that its sizes are shares of, where they are: before the joint fit
    load: Array | None = None  # what a unit adds where it is at work, (windows,), where that is not everywhere
    at_work: Array | None = None  # how much of each size is at work, (windows, sizes)
    flexible: bool = False  # whether its sizes make up any function that only rises, which no file has
    plain: Term | None = None  # where this form is none that a robot file can say, the best that is

    @property
    def effect(self) -> str:
        """Id of the effect."""
        return self.hypothesis.id

    @property
    def linear(self) -> bool:
        """Whether its columns say all, so that no replay with other sizes is needed."""
        return self.axis != "steady" or self.fixed

    @property
    def misread(self) -> bool:
        """Whether it is what a meter reads beyond what was drawn."""
        return not self.hypothesis.physical and self.linear


@dataclass(frozen=True)
class Setting:
    """What hypotheses are made from: the runs, the refit's parameters, what is already in the model, what is left."""

    runs: Runs
    parameters: Parameters
    theta: Array
    present: WithEffects  # effects that are already in the model
    predicted: Array  # (windows,)
    residual: Array  # (windows,)

    @classmethod
    def of(cls, fit: Refit, runs: Runs, residual: Array | None = None) -> Setting:
        """What a refit leaves, or another residual of it, shape (windows,)."""
        left = runs.observed - fit.predicted if residual is None else residual
        return cls(runs, fit.parameters, fit.theta, WithEffects(), fit.predicted, left)

    @property
    def rolling_kg(self) -> float:
        """C_rr m, of the robot file where a fit without rough ground takes it for none."""
        fitted, assumed = float(self.theta[ROLLING]), float(self.parameters.start[ROLLING])
        return fitted if fitted > rules.MATERIAL_SHARE * assumed else assumed

    def response(self, one: Hypothesis, size: float, shape: Numbers) -> Array:
        """What an effect of this size adds, per unit of its size, shape (windows,)."""
        lacking = {name: numbers for name, numbers in one.beside.items() if name not in self.present.effects}
        start, without = self.present, self.predicted
        if lacking:
            start = replace(start, effects={**start.effects, **lacking})
            without = self.parameters.predict(self.runs, self.theta, start)
        added = replace(start, effects={**start.effects, one.id: {**shape, one.entry.switch.name: size}})
        return (self.parameters.predict(self.runs, self.theta, added) - without) / size


def responses(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    """At one size throughout, at each of a few values of its other parameters."""
    switch = one.entry.switch
    shapes = list(one.shapes(setting))
    for shape in shapes:
        column = setting.response(one, TINY * max(abs(switch.low), switch.high), shape)
        yield Term(one, column[:, None], *one.limits(1), int(len(shapes) > 1), shape)


def rising(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    """As any function that rises with the channel that tells it, W: which channel comes before which form."""
    values = setting.runs.context.get(one.rises_with.lstrip("-"))
    if not one.rises_with or values is None or not np.isfinite(values).all():
        return
    values = -values if one.rises_with.startswith("-") else values
    values = np.abs(values) if any(of.magnitude for of in TESTED if of.name == one.rises_with) else values
    edges = np.unique(np.quantile(np.unique(np.round(values, 6)), np.linspace(0.0, 1.0, _PIECES + 1)))
    if len(edges) < 3:
        return  # two values tell no form
    steps = np.clip((values[:, None] - edges[:-1]) / np.diff(edges), 0.0, 1.0)
    per_unit = setting.predicted[:, None] if one.entry.kind == "battery" else 1.0
    most = np.full(steps.shape[1], float(np.max(np.abs(setting.runs.observed))))
    yield Term(one, per_unit * steps, np.zeros(len(most)), most, fixed=True, flexible=True)


def levels(one: Hypothesis, setting: Setting) -> Iterator[Term]:
    """At levels that change at moments or places which the residual shows, or along the way as a smooth profile."""
    load = None if one.changes is None else one.load(one, setting)
    if one.changes is None or load is None:
        return
    runs = setting.runs
    rolling_kg = setting.rolling_kg if one.of_rolling else None
    axes: tuple[Axis, ...] = ("time", "place") if one.by_place else ("time",)
    met_again = change_points.place_of(runs) is not None
    for axis in axes:
        for schedule in one.search(
            axis, load, setting.residual, runs, np.ones(len(load), np.bool_), change_points.SHARES
        ):
            if one.changes == "repeatedly" and schedule.levels > 2:
                continue  # what is switched is on or off: more levels follow what creeps
            if axis == "time" and one.by_place and met_again and schedule.changes > one.most_changes:
                continue  # the ground of a place lasts
            typical = axis == "place" or change_points.may_change(one.changes, schedule, runs)
            if not typical and (one.changes not in _PREFERENCES or schedule.changes > rules.RARE_CHANGES):
                continue
            typical = typical and not one.seldom
            rhythm, spread = one.rhythm(schedule, runs)
            cost = 1 if change_points.clearly_apart(schedule) else _COST_OF_A_CHANGE
            at_work = schedule.at_work()
            yield Term(
                one, load[:, None] * at_work, *one.limits(schedule.levels - 1, one.signed),
                cost * schedule.changes + int(not typical), rhythm, axis, schedule, spread, typical=typical,
                of_rolling_kg=rolling_kg, load=load, at_work=at_work,
            )  # fmt: skip
    for hats in change_points.profiles(runs) if one.by_place else []:
        yield Term(one, load[:, None] * hats, *one.limits(hats.shape[1]), axis="place", of_rolling_kg=rolling_kg,
                   load=load, at_work=hats)  # fmt: skip


def everywhere(one: Hypothesis, setting: Setting) -> Array:
    """A load of one watt."""
    return np.ones(len(setting.runs.observed))


def temperatures(of: Parameter) -> Callable[[Setting], Iterator[Numbers]]:
    """Values of a temperature that are tried: among those recorded, above all of them, and 20 degC."""

    def shapes(setting: Setting) -> Iterator[Numbers]:
        temperature_c = setting.runs.context["temperature_c"]
        known = temperature_c[np.isfinite(temperature_c)]
        quantiles = np.round(np.quantile(known, [0.3, 0.5, 0.7, 0.85]), 1).tolist() if len(known) else []
        for value in dict.fromkeys([*quantiles, float(np.max(known, initial=-100.0)) + 0.1, 20.0]):
            if of.low <= value <= of.high:
                yield {of.name: float(value)}

    return shapes


def _response(one: Hypothesis, setting: Setting) -> Array:
    return setting.response(one, TINY * one.entry.switch.high, {})


def _level_names(term: Term) -> list[tuple[str, str]]:
    switch, sizes = term.hypothesis.entry.switch, term.columns.shape[1]
    if term.flexible and term.hypothesis.rises_with:
        unit = "1" if term.hypothesis.entry.kind == "battery" else "W"
        return [(f"step_{size + 1}", unit) for size in range(sizes)]
    return [(level_name(switch.name, size, sizes), switch.unit) for size in range(sizes)]


def level_name(name: str, size: int, sizes: int) -> str:
    """Name of one of the sizes of a term."""
    return name if sizes == 1 else f"{name}_level_{size + 1}"


def _as_effect(one: Hypothesis, so_far: WithEffects, numbers: Numbers, runs: Runs) -> WithEffects:
    return replace(so_far, effects={**so_far.effects, one.id: dict(numbers)})


def _on_drive(one: Hypothesis, drive: Drive, size: float, shape: Numbers) -> Array:
    base = WithEffects(one.beside)
    with_it = one.within(one, base, {**shape, one.entry.switch.name: size}, drive.runs)
    theta = drive.fit.theta
    without = drive.predict(theta, base) if one.beside else drive.plain
    return drive.there(one.lies_in) * (drive.predict(theta, with_it) - without)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One effect, or one fault of an instrument: how it is tried by what channels tell, how where none does, how it is
    fitted, and how it is told and checked."""

    entry: Effect | Instrument

    needs: tuple[str, ...] | None = None  # channels without which none tells when it is at work; None: those of `entry`
    beside: Mapping[str, Numbers] = field(default_factory=dict)  # effects without which it has no effect
    shapes: Callable[[Setting], Iterator[Numbers]] = lambda setting: iter([{}])  # values of its other parameters
    rises_with: str = ""  # channel that its power rises with, whatever the form, or falls with, with a minus
    steady: Forms | None = responses  # forms of one size; None where no channel ever tells when it is at work

    changes: Changes | None = None  # how its size changes for no recorded reason, if it may
    signed: bool = False  # whether it may then be below the usual size
    seldom: bool = False  # whether such a change is rare
    by_place: bool = False  # whether its size may change from place to place
    most_changes: int = rules.RARE_CHANGES  # times that it may change in places that are met again
    of_rolling: bool = False  # whether it is a share of the rolling resistance, which a file says as rough ground
    load: Callable[[Hypothesis, Setting], Array | None] = _response  # as if always at work; None where a channel tells
    rhythm: Callable[[Schedule, Runs], tuple[Numbers, Spread]] = lambda schedule, runs: (
        {},
        {},
    )  # what else a schedule shows
    varying: Forms = levels  # forms whose size changes for no recorded reason

    bounds: tuple[float, float] | None = None  # of its size, where they are not those of its first parameter
    size_names: Callable[[Term], Sequence[tuple[str, str]]] = _level_names  # name and unit of each size
    searched: tuple[Parameter, ...] = ()  # what recordings may determine beside the size
    within: Callable[[Hypothesis, WithEffects, Numbers, Runs], WithEffects] = _as_effect  # adds it to a replay
    reach: Callable[[Runs], Numbers] = lambda runs: {}  # numbers in its file that say how far recordings reach
    is_weather: bool = False  # whether it is weather, of which no robot file says anything

    map_channel: str = ""  # without which it may be but what that channel would have told

    shown_by: tuple[str, ...] | None = None  # channels that say when it is at work; None: those that it needs
    otherwise: str = "while driving"  # when it is at work, where no channel says so
    check: str = ""  # the measurement that shows it where no drive does; that of its kind if left out
    at_wheels: bool = False  # whether it shows in motor current, as every force does
    lies_in: Literal["load", "ground", "route"] | None = None  # what must be there on a test drive
    on_drive: Callable[[Hypothesis, Drive, float, Numbers], Array] = _on_drive  # what a size and shape add to one

    @property
    def id(self) -> str:
        """Its id."""
        return self.entry.id

    @property
    def name(self) -> str:
        """Its name in a sentence."""
        return self.id.replace("_", " ")

    @property
    def physical(self) -> bool:
        """Whether it is of the robot or its surroundings, and no fault of an instrument."""
        return self.entry.kind != "instrument"

    @property
    def of_current(self) -> bool:
        """Whether it shows in motor current: of what is no force at the wheels, a torque sensor sees nothing."""
        return self.at_wheels or self.entry.kind == "force"

    @property
    def measurement(self) -> str:
        """What a drive cannot show but a measurement does."""
        return self.check or CHECKS[self.entry.kind].format(name=self.name)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels whose values say when it is at work, the most telling first."""
        known = {channel.name for channel in TESTED}
        return tuple(name for name in self.entry.needs if name in known) if self.shown_by is None else self.shown_by

    def limits(self, sizes: int, signed: bool = True) -> tuple[Array, Array]:
        """Least and largest value of each of its sizes."""
        low, high = self.bounds or (self.entry.switch.low, self.entry.switch.high)
        return np.full(sizes, low if signed else 0.0), np.full(sizes, high)

    def forms(self, setting: Setting, varying: bool) -> Iterator[Term]:
        """Every form that these runs allow, those whose size changes for no recorded reason only if asked for."""
        if self.steady is not None and not self.missing(setting.runs):
            yield from self.steady(self, setting)
            yield from rising(self, setting)
        if varying:
            yield from self.varying(self, setting)

    def search(
        self, axis: Axis, load: Array, residual: Array, runs: Runs, chosen: Mask, shares: Sequence[float]
    ) -> list[Schedule]:
        """Schedules that a search in the windows that it is `told`, shape (windows,), finds, of few changes to many.

        Others have the level of those before them. A unit of its size adds `load`, shape (windows,), where it is at
        work, and a change must explain such `shares` of the squared residual, the largest first.
        """
        found = change_points.search(axis, load * chosen, residual * chosen, runs, self.signed, shares)
        # What begins once was not there before, however long it lasts.
        return [one.from_the_first() for one in found] if self.changes == "once" and self.signed else found

    def missing(self, runs: Runs) -> tuple[str, ...]:
        """Channels that it needs to be seen and that no run has."""
        given = {*runs.context, *_ALWAYS_GIVEN}
        if runs.unit == "W":
            given |= {"voltage_v", "current_a"}
        if "wheel_difference_mps" in given:
            given.add("yaw_rate_radps")
        return tuple(name for name in (self.entry.needs if self.needs is None else self.needs) if name not in given)

    def looks_like(self, other: Hypothesis, runs: Runs) -> bool:
        """Whether the two are known to look alike and no channel of these runs shows the difference."""
        known = other.id in self.entry.confused_with or self.id in other.entry.confused_with
        return known and bool({*self.entry.needs, *other.entry.needs} - {*runs.context, *_ALWAYS_GIVEN})
