"""The battery's open-circuit voltage: a state of charge is a share of charge, and what drives is
energy.

A full battery gives more energy for a share of its charge than an empty one, because its voltage is
higher. The energy of a share of charge is the integral of the open-circuit voltage over it; over a
full charge that is `rated_energy_j`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from homeward.physics.jit import inline

MOST_KNOTS = 32
"""Most points of a curve. Chosen: published tables have 11 to 21."""

CHEMISTRIES: dict[str, tuple[tuple[float, float], ...]] = {
    # Mean of six cells: LG INR18650MJ1 and Sanyo UR18650E (SimSES 1.3.12, TU Munich; Schmalstieg
    # and others, Journal of Power Sources 257, 2014), Molicel INR21700-P42A and Samsung
    # INR21700-40T (Sunil, Pattipati & Balasingam, IEEE Transactions on Instrumentation and
    # Measurement, 2025), and two cells of open battery managers. Above a tenth of the charge they
    # are within 75 mV of it.
    "nmc": (
        (0.0, 3.000), (0.02, 3.162), (0.05, 3.268), (0.1, 3.391), (0.15, 3.457), (0.2, 3.513), (0.25, 3.559),
        (0.3, 3.597), (0.4, 3.664), (0.5, 3.739), (0.6, 3.829), (0.7, 3.921), (0.75, 3.969), (0.8, 4.017),
        (0.85, 4.059), (0.9, 4.085), (0.95, 4.113), (0.98, 4.144), (1.0, 4.175),
    ),
    # Mean of six: a TCL PL-383562 (Chen & Rincon-Mora, IEEE Transactions on Energy Conversion 21,
    # 2006), a hobby chart (Ampow), the tables of X-Powers' chargers, and a phone's cell (Longcheer
    # L8150 device tree). Within 50 mV.
    "lipo": (
        (0.0, 3.300), (0.02, 3.509), (0.05, 3.617), (0.1, 3.668), (0.15, 3.694), (0.2, 3.714), (0.25, 3.729),
        (0.3, 3.745), (0.4, 3.778), (0.5, 3.812), (0.6, 3.858), (0.7, 3.921), (0.75, 3.953), (0.8, 3.988),
        (0.85, 4.028), (0.9, 4.071), (0.95, 4.118), (0.98, 4.150), (1.0, 4.170),
    ),
    # Mean of five: Sony US26650FTC1 (Naumann, thesis, TU Munich, 2018), Lithium Werks APR18650M1B
    # (Sunil and others, 2025), and A123, TI and SinoPoly cells of a table by Burkitt (2017). Within
    # 25 mV, beside a hysteresis of 15 mV.
    "lfp": (
        (0.0, 2.800), (0.02, 2.949), (0.05, 3.080), (0.1, 3.193), (0.15, 3.213), (0.2, 3.236), (0.25, 3.258),
        (0.3, 3.270), (0.4, 3.288), (0.5, 3.296), (0.6, 3.303), (0.7, 3.315), (0.75, 3.322), (0.8, 3.328),
        (0.85, 3.335), (0.9, 3.341), (0.95, 3.348), (0.98, 3.354), (1.0, 3.400),
    ),
    # Mean of six gel and AGM tables at five charges, interpolated between them. Three were read
    # (meeknet.co.uk; RV Solar Connection; Clearpath's battery monitor, after doi
    # 10.1088/1742-6596/1367/1/012077): their mean is within 4 mV a cell of 2 V. The other three
    # (Trojan, Deka) are from memory.
    "lead_acid": (
        (0.0, 1.957), (0.1, 1.973), (0.2, 1.989), (0.25, 1.997), (0.3, 2.009), (0.4, 2.032), (0.5, 2.053),
        (0.6, 2.071), (0.7, 2.089), (0.75, 2.097), (0.8, 2.105), (0.9, 2.121), (1.0, 2.136),
    ),
}  # fmt: skip
"""Open-circuit voltage of a cell, V, over its share of charge, at 25 C after rest. Share 0 is a
cell that was emptied to its usual cut-off and has recovered; its voltage, and that near full of
`lipo` and `lfp`, are chosen, as the sources end at different voltages."""

FLAT = "flat"
"""The battery of the paper: its voltage is constant, so that a share of charge is the same share of
energy."""


CURVE_DTYPE = np.dtype(
    [
        ("knots", np.int64),
        ("charge", np.float64, (MOST_KNOTS,)),
        ("relative_v", np.float64, (MOST_KNOTS,)),
        ("energy", np.float64, (MOST_KNOTS,)),
        ("mean_v", np.float64),
    ],
    align=True,
)
"""A `Curve` as a record."""

CELLS = 31
"""Even parts of the energy in which the step interpolates the square of the voltage. Chosen: above
a tenth of the energy within 16 mV of each curve above, and within 61 mV below; twice as many slow
4,096 missions by 3 %."""


class Curve(NamedTuple):
    """An open-circuit curve in the form of the formulas. The arrays have shape (MOST_KNOTS,), of
    which `knots` count.

    Attributes:
        knots: Number of points.
        charge: Shares of charge, from 0 to 1, increasing; 2 where no point is.
        relative_v: Voltage there over the mean voltage of a full charge.
        energy: Share of the energy below each point, from 0 to 1; 2 where no point is.
        mean_v: Mean voltage of a full charge, V; 0 for a battery of constant voltage.
    """

    knots: int
    charge: NDArray[np.float64]
    relative_v: NDArray[np.float64]
    energy: NDArray[np.float64]
    mean_v: float


def curve_of(points: Sequence[tuple[float, float]]) -> Curve:
    """The curve through points (share of charge, V of the pack); none: a constant voltage."""
    charge, volts = np.array(points or [(0.0, 1.0), (1.0, 1.0)], dtype=np.float64).T
    # energy between two points over the full charge
    between = 0.5 * (volts[1:] + volts[:-1]) * np.diff(charge)
    below = np.concatenate([[0.0], np.cumsum(between)])
    mean_v = below[-1]
    relative_v = volts / mean_v
    energy = below / mean_v
    if not points:
        mean_v = 0.0  # a constant voltage, which the curve does not tell
    beyond = MOST_KNOTS - len(charge)
    return Curve(
        knots=len(charge),
        charge=np.pad(charge, (0, beyond), constant_values=2.0),
        relative_v=np.pad(relative_v, (0, beyond), constant_values=1.0),
        energy=np.pad(energy, (0, beyond), constant_values=2.0),
        mean_v=float(mean_v),
    )


@inline
def energy_share(curve: Any, charge: Any) -> Any:
    """Share of a full battery's energy that a share of its charge is; both within 0 and 1.

    >>> lipo = curve_of(CHEMISTRIES["lipo"])
    >>> [round(float(energy_share(lipo, share)), 3) for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    [0.0, 0.238, 0.483, 0.736, 1.0]
    """
    above = np.minimum(np.searchsorted(curve.charge, charge, side="right"), curve.knots - 1)
    k = np.maximum(above - 1, 0)  # the point at or below
    beyond = charge - curve.charge[k]
    rise = (curve.relative_v[k + 1] - curve.relative_v[k]) / (curve.charge[k + 1] - curve.charge[k])
    return curve.energy[k] + (curve.relative_v[k] + 0.5 * rise * beyond) * beyond


@inline
def charge_share(curve: Any, energy: Any) -> Any:
    """Share of a full battery's charge that a share of its energy is, the inverse of
    `energy_share`.

    >>> lfp = curve_of(CHEMISTRIES["lfp"])
    >>> round(float(charge_share(lfp, energy_share(lfp, 0.3))), 12)
    0.3
    """
    above = np.minimum(np.searchsorted(curve.energy, energy, side="right"), curve.knots - 1)
    k = np.maximum(above - 1, 0)  # the point at or below
    beyond = energy - curve.energy[k]
    rise = (curve.relative_v[k + 1] - curve.relative_v[k]) / (curve.charge[k + 1] - curve.charge[k])
    # The root of a quadratic: energy is the integral of a voltage that is linear in the charge.
    root = np.sqrt(curve.relative_v[k] * curve.relative_v[k] + 2.0 * rise * beyond)
    return curve.charge[k] + 2.0 * beyond / (curve.relative_v[k] + root)


def squares_of(curve: Curve) -> NDArray[np.float32]:
    """Square of the open-circuit voltage at `CELLS` + 1 even shares of the energy, V^2, shape
    (CELLS + 1,).

    It is linear in the energy between the points of the curve, and so between these.
    """
    shares = np.linspace(0.0, 1.0, CELLS + 1)
    squares: NDArray[np.float32] = np.square(
        open_circuit_v(curve, charge_share(curve, shares))
    ).astype(np.float32)
    return squares


@inline
def square_v2(squares_v2: Any, energy: Any) -> Any:
    """Square of the open-circuit voltage at a share of the energy within 0 and 1, V^2, from
    `squares_of`.

    >>> squares_v2 = squares_of(curve_of(CHEMISTRIES["lipo"]))
    >>> round(float(square_v2(squares_v2, 0.483) ** 0.5), 2)
    3.81
    """
    cell = np.int64(np.minimum(energy * CELLS, CELLS - 1.0))
    low_v2 = squares_v2[cell]
    return low_v2 + (squares_v2[cell + 1] - low_v2) * (energy * CELLS - cell)


@inline
def share_at(squares_v2: Any, wanted_v2: Any) -> Any:
    """Share of the energy at which the square of the open-circuit voltage is a given one, the
    inverse of `square_v2`; 0 below the voltage of an empty battery, 1 above that of a full one.

    >>> squares_v2 = squares_of(curve_of(CHEMISTRIES["lipo"]))
    >>> round(float(share_at(squares_v2, square_v2(squares_v2, 0.3))), 9)
    0.3
    """
    if wanted_v2 <= squares_v2[0]:
        return 0.0
    cell = 0
    while cell < CELLS and squares_v2[cell + 1] < wanted_v2:
        cell += 1
    if cell == CELLS:
        return 1.0
    low_v2 = squares_v2[cell]
    return (cell + (wanted_v2 - low_v2) / (squares_v2[cell + 1] - low_v2)) / CELLS


@inline
def share_below_cutoff(p: Any, terminal_w: Any) -> Any:
    """Share of a full battery's energy that stays in it below its cut-off voltage at a load.

    Under a load P the voltage V satisfies V (V_rest - V) = R P. So the battery holds a voltage V if
    it has V + R P / V at rest; of all V, it is sqrt(R P) that needs the least: there a battery
    gives its most power, and with less it does not carry the load at any voltage.

    Args:
        p: Robot record of a battery with a cut-off.
        terminal_w: Power P at the battery's terminals, W, negative while it is charged.
    """
    drop_v2 = p.internal_resistance_ohm * terminal_w
    held_v = np.maximum(p.cutoff_v, np.sqrt(np.maximum(drop_v2, 0.0)))
    rest_v = np.maximum(held_v + drop_v2 / held_v, 0.0)
    return share_at(p.squares_v2, rest_v * rest_v)


def charge_at(curve: Curve, open_circuit: Any) -> Any:
    """Share of charge at an open-circuit voltage over its mean, the inverse of `open_circuit_v`; 0
    below empty.

    >>> nmc = curve_of(CHEMISTRIES["nmc"])
    >>> round(float(charge_at(nmc, open_circuit_v(nmc, 0.3) / nmc.mean_v)), 12)
    0.3
    """
    return np.interp(open_circuit, curve.relative_v[: curve.knots], curve.charge[: curve.knots])


@inline
def open_circuit_v(curve: Any, charge: Any) -> Any:
    """Open-circuit voltage at a share of charge within 0 and 1, V; 0 for a battery of constant
    voltage."""
    above = np.minimum(np.searchsorted(curve.charge, charge, side="right"), curve.knots - 1)
    k = np.maximum(above - 1, 0)  # the point at or below
    beyond = charge - curve.charge[k]
    rise = (curve.relative_v[k + 1] - curve.relative_v[k]) / (curve.charge[k + 1] - curve.charge[k])
    return curve.mean_v * (curve.relative_v[k] + rise * beyond)
