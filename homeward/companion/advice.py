"""What the companion returns: estimates with their uncertainty, and the readings and assumptions
behind them."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from homeward import quantities
from homeward.estimation.tails import deviations

HOME = "home"
"""Name of home among homes and docks."""
_COVERED = 0.9  # probability of the interval that is shown; chosen, and stated wherever it is shown


class UncertainValue(NamedTuple):
    """An uncertain number, distributed as Student's t (`homeward.estimation.tails`).

    Attributes:
        mean: Mean.
        sd: Standard deviation.
        least: What it cannot be below.
        most: What it cannot exceed.
    """

    mean: float
    sd: float
    least: float = -math.inf
    most: float = math.inf

    def within(self, least: float, most: float) -> UncertainValue:
        """The same number, known to be within limits."""
        return UncertainValue(min(max(self.mean, least), most), self.sd, least, most)

    def quantile(self, share: float) -> float:
        """Quantile: the number is below it with this probability.

        >>> round(UncertainValue(100.0, 10.0).quantile(0.05), 1)
        81.1
        """
        return min(max(self.mean + self.sd * deviations(share), self.least), self.most)

    @property
    def low(self) -> float:
        """Lower end of the central 90 % interval."""
        return self.quantile(0.5 - 0.5 * _COVERED)

    @property
    def high(self) -> float:
        """Upper end of the central 90 % interval."""
        return self.quantile(0.5 + 0.5 * _COVERED)


class Action(NamedTuple):
    """Command of a policy until its next decision.

    Attributes:
        speed_mps: Speed, m/s; 0 to stop.
        sensing_hz: Sensing rate, Hz.
        mode: `stop`, `go` or `return`.
    """

    speed_mps: float
    sensing_hz: float
    mode: str

    def __str__(self) -> str:
        moving = "" if self.mode == "stop" else f" at {self.speed_mps:.3g} m/s"
        return f"{self.mode}{moving}, {self.sensing_hz:.3g} Hz"


class HomeOption(NamedTuple):
    """A home or dock beside the advised one; energies as in `Advice`.

    Attributes:
        name: Its name.
        way_m: Length of the way there, m.
        energy_j: Energy that the way there consumes, going now.
        margin_j: Energy left less that.
        chance: Probability of getting there.
        reachable: Whether that is enough at the accepted risk.
    """

    name: str
    way_m: float
    energy_j: UncertainValue
    margin_j: UncertainValue
    chance: float
    reachable: bool


@dataclass(frozen=True)
class Advice:
    """Advice at a moment of a drive. Energies are in J as the robot's own power meter would measure
    them.

    With docks, "home" is the home or dock that is advised: of those that are reachable at the
    accepted risk, the one with the largest margin at that risk; if none is, the one with the
    highest probability of getting there.

    Attributes:
        time_s: Time of the reading, s since the first one.
        way_home_m: Length of the way home that the robot would take, m.
        energy_left_j: Energy in the battery, down to the cut-off voltage if one was given: from 0
            to what a full battery holds by the robot's file.
        energy_home_j: Energy that the way home consumes, turning now, at the speed that `rests_on`
            names; at least 0.
        margin_j: Energy left less that of the way home; negative if it is not enough.
        chance_home: Probability of getting home when turning now.
        risk: Accepted probability of not getting home, used for the next three.
        turn_in_m: How far the robot may drive on before it must turn, m; 0 if it must turn now.
        turn_in_s: The time that this takes at its present pace, s.
        turn_now: Whether it must turn now, or, before it leaves home, must not leave. Once it has
            left, it stays true, whatever the estimates become, until the robot comes home, within
            `Companion(arrived_m=...)`, or another battery, charge or home is told.
        chance_there_and_back: Probability of getting to the end of the route and home, to no dock;
            None without a route.
        looks_back: Whether an excitation step now, driving towards home for a moment, would
            distinguish wind from rolling resistance.
        rests_on: Readings and assumptions behind the advice, a sentence each.
        warnings: Present faults of the readings, a sentence each.
        action: Command of the policy; None without a policy and once its mission is over.
        home: Name of the advised home: `home`, or that of a dock.
        others: The other homes and docks, those that are reachable first, by falling margin.
    """

    time_s: float
    way_home_m: float
    energy_left_j: UncertainValue
    energy_home_j: UncertainValue
    margin_j: UncertainValue
    chance_home: float
    risk: float
    turn_in_m: float
    turn_in_s: float
    turn_now: bool
    chance_there_and_back: float | None
    looks_back: bool
    rests_on: tuple[str, ...]
    warnings: tuple[str, ...]
    action: Action | None = None
    home: str = HOME
    others: tuple[HomeOption, ...] = ()

    @property
    def is_sound(self) -> bool:
        """Whether every number is finite, every interval in order, and what is left not
        negative."""
        values = [self.energy_left_j, self.energy_home_j, self.margin_j]
        numbers = [self.time_s, self.way_home_m, self.turn_in_m, self.turn_in_s]
        for value in values:
            numbers += [value.mean, value.sd, value.low, value.high]
        are_in_order = all(value.low <= value.mean <= value.high for value in values)
        are_possible = (
            self.energy_left_j.low >= 0.0
            and self.energy_home_j.low >= 0.0
            and 0.0 <= self.chance_home <= 1.0
        )
        return all(map(math.isfinite, numbers)) and are_in_order and are_possible

    def to_json(self) -> dict[str, Any]:
        """Numbers, texts and lists for JSON; a spread includes its 90 % interval."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        values = {name: _for_json(value) for name, value in values.items()}
        values["others"] = [_option_for_json(option) for option in self.others]
        return values

    def __str__(self) -> str:
        energy_left = _with_interval(self.energy_left_j)
        consumption = _with_interval(self.energy_home_j)
        way = quantities.distance(self.way_home_m)
        if self.home == HOME:
            where = "home"
            destination = "home"
        else:
            where = f"to {self.home}"
            destination = "there"
        if self.turn_now:
            turn = "turn now"
        else:
            turn = f"turn within {quantities.distance(self.turn_in_m)}, {quantities.duration(self.turn_in_s)}"
        text = (
            f"{energy_left} left; the way {where}, {way}, consumes {consumption}; "
            f"probability of getting {destination} {self.chance_home:.2%}; {turn}"
        )
        for option in self.others:
            text += f"; {option.name}: {quantities.distance(option.way_m)}, {option.chance:.2%}"
        if self.action is not None:
            text += f"; action of the policy: {self.action}"
        return text


def _with_interval(value: UncertainValue) -> str:
    """An energy with its 90 % interval, in words."""
    return f"{quantities.energy(value.mean)} ({quantities.energy(value.low)} to {quantities.energy(value.high)})"


def _option_for_json(option: HomeOption) -> dict[str, Any]:
    """A home or dock for JSON."""
    return {name: _for_json(value) for name, value in option._asdict().items()}


def _for_json(value: Any) -> Any:
    """A field's value for JSON."""
    if isinstance(value, UncertainValue):
        return {"mean": value.mean, "sd": value.sd, "low": value.low, "high": value.high}
    if isinstance(value, Action):
        return value._asdict()
    return value
