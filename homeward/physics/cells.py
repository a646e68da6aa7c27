"""What is known of cells by their chemistry, beside the open-circuit curve: its error, the cold,
the rate, the end.

Voltages are relative to the mean open-circuit voltage of a full charge (to the nominal one, if the
file states no curve), currents are per hour: 1 empties the rated charge in an hour. In these units
cells of all sizes and chemistries are alike.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.physics.battery import CHEMISTRIES, FLAT, Curve, curve_of, open_circuit_v
from homeward.physics.model import ZERO_CELSIUS_K
from homeward.physics.robot import Robot

_S_PER_H = 3600.0
OWN_CURVE = "own curve"
"""A robot whose file has an `open_circuit_v` instead of a chemistry."""


class CellFacts(NamedTuple):
    """Ranges of cells of a chemistry; a pair is the least and the most.

    Attributes:
        curve_sd: Standard deviation of the open-circuit voltage of one cell about the curve,
            relative; without a curve, about the mean of all chemistries.
        cold_per_k: Share of the capacity that is lost per kelvin below 25 C.
        label_h: Hours in which the charge on the label is drawn.
        peukert: Exponent of Peukert's law, for what a rate takes beyond what the voltage under load
            leaves in the cells below the cut-off.
        cutoff: Usual cut-off under load, relative; NaN: the voltage of the empty cell.
        cutoff_sd: Standard deviation of that.
    """

    curve_sd: float
    cold_per_k: tuple[float, float]
    label_h: tuple[float, float]
    peukert: tuple[float, float] = (1.0, 1.0)
    cutoff: float = math.nan
    cutoff_sd: float = 0.0


_LITHIUM_COLD = (0.002, 0.007)
_LITHIUM_LABEL_H = (1.0, 5.0)
"""Lithium-ion cells lose 15 to 30 % at -20 C (biolng.com.pl; with less at 0 C: Waag, Kaebitz &
Sauer, Applied Energy 102, 2013). Data sheets draw the label in 1 to 5 h. At a rate they give less
because the voltage under load reaches the cut-off earlier (Galushkin et al., J. Electrochem. Soc.
167, 120516, 2020). The companion counts that; an exponent of Peukert's law, such as the 1.05 of
Victron's battery monitors, would count it twice."""

FACTS = {
    # Spread of the cells behind each curve (homeward.physics.battery) in mid-charge: 15 to 45, 11
    # to 28, 8 to 16 with a hysteresis of 15, and 5 to 12 mV of 2 V.
    "nmc": CellFacts(0.030 / 3.75, _LITHIUM_COLD, _LITHIUM_LABEL_H),
    "lipo": CellFacts(0.020 / 3.84, _LITHIUM_COLD, _LITHIUM_LABEL_H),
    "lfp": CellFacts(0.020 / 3.29, _LITHIUM_COLD, _LITHIUM_LABEL_H),
    # 0.6 % at a 10 or 20 h rate and 1 % at a 1 or 3 h rate (velapower.com), 0.64 % for more than an
    # hour (Discover Energy). Exponents 1.05 to 1.15 of AGM and 1.1 to 1.25 of gel
    # (bdbatteries.com). Labels of sealed ones are of 20 h, those of traction batteries of 5 h. The
    # usual end is 1.75 V of 2.05. Its rest voltage takes hours, so that the spread counts three
    # times. Chosen.
    "lead_acid": CellFacts(
        0.030 / 2.05, (0.006, 0.010), (5.0, 20.0), peukert=(1.05, 1.25), cutoff=1.75 / 2.054
    ),
    # Of a chemistry that nobody told, so that a rate may take more than by the voltage. Chosen.
    OWN_CURVE: CellFacts(0.005, _LITHIUM_COLD, _LITHIUM_LABEL_H, peukert=(1.0, 1.05)),
    # The curves of homeward.physics.battery, over the voltages on their labels, are within 1 % of
    # their mean in mid-charge and within 5 % at the ends: 3 % (root of the mean square). Usual
    # cut-offs are 3.0 of 3.6 V (nmc), 3.3 of 3.7 V (lipo), 2.8 of 3.2 V (lfp), 1.75 of 2 V (lead)
    # and 1.0 of 1.2 V (nickel).
    FLAT: CellFacts(0.03, (0.0, 0.010), (1.0, 5.0), cutoff=0.86, cutoff_sd=0.025),
}
"""A curve that a user measured is within half a per cent: a meter's error. A flat battery may be of
any chemistry."""

WARM_C = 25.0
"""Temperature of labels, C."""

_COLD_C = -20.0
COLD_TIMES = 4.0
MOST_COLD_TIMES = 5.0
"""Resistance at -20 C over that of a warm cell: three to five times (ansh-bohrey.github.io)."""


def cold_resistance(temperature_c: float, times: float = COLD_TIMES) -> float:
    """Resistance of cells over that of warm ones, by Arrhenius' law.

    Args:
        temperature_c: Of the cells, C; NaN: they are warm.
        times: The same at -20 C.

    >>> round(cold_resistance(-20.0), 3), round(cold_resistance(0.0), 1), cold_resistance(30.0)
    (4.0, 2.0, 1.0)
    """
    if not temperature_c < WARM_C:
        return 1.0
    # The logarithm of the resistance is linear in the inverse of the absolute temperature.
    warm_per_k = 1.0 / (ZERO_CELSIUS_K + WARM_C)
    cold_per_k = 1.0 / (ZERO_CELSIUS_K + _COLD_C)
    present_per_k = 1.0 / (ZERO_CELSIUS_K + temperature_c)
    return float(times ** ((present_per_k - warm_per_k) / (cold_per_k - warm_per_k)))


_LABEL_V = {"nmc": 3.6, "lipo": 3.7, "lfp": 3.2, "lead_acid": 2.0}
"""Voltage that is printed on a cell, V."""
_CURVES = {name: curve_of(CHEMISTRIES[name]) for name in _LABEL_V}


def any_cell(charge: NDArray[np.float64]) -> NDArray[np.float64]:
    """Open-circuit voltage of a cell over that on its label, the mean of all chemistries.

    Args:
        charge: State of charge, 0 to 1.

    >>> any_cell(np.array([1.0, 0.5, 0.0])).round(2)
    array([1.1 , 1.03, 0.89])
    """
    of_chemistries = [
        open_circuit_v(_CURVES[name], charge) / label_v for name, label_v in _LABEL_V.items()
    ]
    return np.asarray(np.mean(of_chemistries, axis=0))


def most_fall(charge: NDArray[np.float64], drawn: float) -> NDArray[np.float64]:
    """Largest fall of the open-circuit voltage of a cell of any chemistry, over that on its label.

    Args:
        charge: State of charge, 0 to 1.
        drawn: Share of charge that is drawn.

    >>> most_fall(np.array([1.0, 0.5, 0.1]), 0.1).round(3)
    array([0.027, 0.021, 0.123])
    """
    charge_left = np.maximum(charge - drawn, 0.0)
    falls = [
        (open_circuit_v(_CURVES[name], charge) - open_circuit_v(_CURVES[name], charge_left))
        / label_v
        for name, label_v in _LABEL_V.items()
    ]
    return np.asarray(np.max(falls, axis=0))


class Cells(NamedTuple):
    """The cells of a robot.

    Attributes:
        chemistry: Name in `FACTS`.
        facts: What is known of them.
        curve: Open-circuit curve of the pack.
        mean_v: Its mean voltage, or the nominal one without a curve, V.
        rated_as: Charge on the label, A s.
    """

    chemistry: str
    facts: CellFacts
    curve: Curve
    mean_v: float
    rated_as: float

    @property
    def words(self) -> str:
        """What cells they are."""
        if self.chemistry == FLAT:
            return "cells of unknown chemistry"
        if self.chemistry == OWN_CURVE:
            return "cells with a curve of their own"
        return f"{self.chemistry} cells"

    @property
    def has_curve(self) -> bool:
        """Whether the voltage says anything about the charge."""
        return self.curve.mean_v > 0.0

    def rate_per_h(self, current_a: float) -> float:
        """A current as charges per hour."""
        return current_a * _S_PER_H / self.rated_as

    def beyond_label_per_h(self, rate_per_h: float) -> float:
        """A rate beyond that of the label, whose energy is without what the resistance takes at
        that one.

        A battery of constant voltage has no resistance but that of its file.
        """
        if not self.has_curve:
            return 0.0
        _, longest_h = self.facts.label_h
        return max(rate_per_h - 1.0 / longest_h, 0.0)

    def derating(self, temperature_c: float, rate_per_h: float) -> tuple[float, float]:
        """Least and most share of the label's charge that the cells give in the cold and at a rate.

        Args:
            temperature_c: Of the air, C; NaN: they are warm.
            rate_per_h: Mean rate of the discharge.
        """
        cold_k = 0.0
        if math.isfinite(temperature_c):
            cold_k = max(WARM_C - temperature_c, 0.0)
        least_per_k, most_per_k = self.facts.cold_per_k
        at_rate_least = 1.0
        at_rate_most = 1.0
        if rate_per_h > 0.0:
            # Peukert: the charge given falls with the rate over the label's, to the power of the
            # exponent less 1.
            gentle, steep = self.facts.peukert
            shortest_h, longest_h = self.facts.label_h
            at_rate_least = min((rate_per_h * longest_h) ** (1.0 - steep), 1.0)
            at_rate_most = min((rate_per_h * shortest_h) ** (1.0 - gentle), 1.0)
        in_cold_least = 1.0 - most_per_k * cold_k
        in_cold_most = 1.0 - least_per_k * cold_k
        return in_cold_least * at_rate_least, in_cold_most * at_rate_most

    def cutoff(self, cutoff_v: float | None) -> tuple[float, float]:
        """Cut-off under load, relative, and its standard deviation: the one that is known, or the
        usual one."""
        if cutoff_v is not None:
            return cutoff_v / self.mean_v, 0.0
        if math.isfinite(self.facts.cutoff):
            return self.facts.cutoff, self.facts.cutoff_sd
        voltage_when_empty = float(self.curve.relative_v[0])
        return voltage_when_empty, self.facts.cutoff_sd


def cells_of(robot: Robot) -> Cells:
    """The cells of a robot's file."""
    curve = robot.curve
    chemistry = robot.chemistry
    if chemistry == FLAT and curve.mean_v > 0.0:
        chemistry = OWN_CURVE
    mean_v = curve.mean_v or robot.nominal_voltage_v
    return Cells(
        chemistry=chemistry,
        facts=FACTS[chemistry],
        curve=curve,
        mean_v=mean_v,
        rated_as=robot.rated_energy_j / mean_v,
    )
