"""The battery: a grid of possible ones, each weighed by how well it predicts what is read.

A possible battery has a capacity and a state of charge at the start. The energy drawn, which the
power integrates to, gives its charge at any time. Three witnesses weigh it:

* The robot drives: a battery that would be empty is out. If hardly any was expected to hold what
  was drawn, it is another one or the meter errs, and what is left is as unsure as that was wrong.
* The voltage: the open-circuit voltage at its charge, less the resistance times the current, of
  which one half acts at once and the other slowly (Thevenin's circuit with one pair of resistance
  and capacity; Plett, Journal of Power Sources 134, 2004). Both, and by how much these cells are
  above their curve, are estimated for each possible battery by a Kalman filter. What the voltage
  under load keeps below the cut-off is not counted, within the errors of all.
* The gauge, as far as it is believed (`homeward.companion.gauge`).

Energies are as metered, over the energy of a full battery by the robot's file.
"""

from __future__ import annotations

import math
from functools import lru_cache, reduce
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from homeward.companion import thresholds
from homeward.companion.gauge import FOLLOWS, JUMPED, GaugeTrust
from homeward.estimation import Prior
from homeward.physics.battery import charge_at, charge_share, energy_share, open_circuit_v
from homeward.physics.cells import MOST_COLD_TIMES, Cells, any_cell, cold_resistance, most_fall

Floats = NDArray[np.float64]

CAPACITIES, STARTS = 61, 25
"""Points of the grid along either axis. Chosen: neighbours differ by less than what readings tell
apart."""
_PARTS = np.array(
    [0.0, 1e-4, 1e-3, 5e-3, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 1.0]
)
"""Ends of the shares of probability in which the energy left is told; chosen: fine where risks
are."""
PARTS = len(_PARTS) - 1
_SPREAD = -np.diff(np.exp(-0.5 * ndtri(_PARTS) ** 2)) / math.sqrt(2.0 * math.pi) / np.diff(_PARTS)
"""Means of a normal distribution of deviation 1 in these shares of its probability."""
_SAG_ENDS = np.array([-np.inf, -1.0, 0.0, 1.0, 2.0, 2.5, 3.09, np.inf])
_SAG_WEIGHTS = np.diff(ndtr(_SAG_ENDS))
_SAGS = -np.diff(np.exp(-0.5 * _SAG_ENDS**2)) / math.sqrt(2.0 * math.pi) / _SAG_WEIGHTS
"""Deviations of the voltage under load for which the end is asked, the means of these parts of a
normal distribution, and their probabilities. Chosen: the last has the default risk."""
_OFFSET, _FAST, _SLOW = range(3)
_S_PER_H = 3600.0
_FACTOR_STEPS = 41
_LEAST_LIKELIHOOD = 1e-12
_LEAST_RISE = 1e-12  # of a relative voltage; above 0, because it divides
_IMPOSSIBLE = 1e-300  # added to weights before they are divided by their sum, which may be zero


class Start(NamedTuple):
    """The charge at the start.

    Attributes:
        charge: State of charge, 0 to 1.
        told: Whether a person or program said so; otherwise the gauge showed it.
    """

    charge: float = 1.0
    told: bool = True


class Conditions(NamedTuple):
    """What the capacity depends on, beside the age.

    Attributes:
        temperature_c: Of the air, C; NaN: not read.
        rate_per_h: Mean rate of the discharge.
        gain_sd: Relative standard deviation of the energy drawn, as of the meter.
        modelled_sd: The same, if no power is read and the model takes the meter's place; 0
            otherwise.
        metered_share: Share of the energy out of the cells that the meter measures.
        models_cold: Whether the robot's own model counts what the cold takes from the battery.
    """

    temperature_c: float = math.nan
    rate_per_h: float = 0.0
    gain_sd: float = 0.0
    modelled_sd: float = 0.0
    metered_share: float = 1.0
    models_cold: bool = False

    @property
    def cells_c(self) -> float:
        """Temperature by which the cells give less, C: what the robot's own model counts does not
        count twice."""
        if self.models_cold:
            return math.nan
        return self.temperature_c


class Witnesses(NamedTuple):
    """What is read of the battery in a window.

    Attributes:
        used: Energy drawn since the start.
        used_sd: Its standard deviation, beyond the meter's gain.
        voltage_v: Mean voltage, V; NaN: not read, like the next two.
        current_a: Mean current, A.
        peak_a: Largest current, A; minus infinity: none was read.
        gauge: State of charge as shown, 0 to 1.
        time_s: Length of the window, s.
    """

    used: float
    used_sd: float
    voltage_v: float
    current_a: float
    peak_a: float
    gauge: float
    time_s: float = math.inf


class BatteryBelief:
    """Probabilities of the possible batteries.

    Args:
        cells: The robot's cells.
        prior: Prior of the estimator: the capacity, and the errors of the gauge.
        capacity_is_fitted: Whether the capacity was measured, so that it is normally distributed;
            otherwise it is within a range.
        cutoff_v: Voltage under load at which the battery is cut off, V, if it is known.

    Attributes:
        trust: What is believed of the gauge.
        totals: Energy from the start until empty or cut off, by parts of the probability, shape
            (PARTS,), rising.
        weights: Probability of each part, shape (PARTS,).
        fails: Probability that the voltage under load falls to the cut-off within as long as the
            robot drove, full or not.
    """

    SAVED: ClassVar = (
        "trust", "totals", "weights", "_capacity", "_holds", "_volts", "_volts_covariance", "_charge",
        "_cutoff", "_rate", "_planned_rate", "_time_s", "_slow_rate", "_most_slow_rate", "_start_charge", "_told",
        "_most", "_drawn", "_cold", "_most_cold", "_used", "_capacity_weights", "fails",
    )  # fmt: skip

    def __init__(
        self, cells: Cells, prior: Prior, capacity_is_fitted: bool, cutoff_v: float | None
    ) -> None:
        self._cells = cells
        self._prior = prior
        self._capacity_is_fitted = capacity_is_fitted
        self._cutoff_v = -math.inf
        if cutoff_v is not None:
            self._cutoff_v = cutoff_v
        self._usual_cutoff, self._cutoff_sd = cells.cutoff(cutoff_v)
        self.begin(Start(), Conditions())

    def begin(self, start: Start, conditions: Conditions) -> None:
        """Begin with a battery of which only the prior is known."""
        derating = self._cells.derating(conditions.cells_c, conditions.rate_per_h)
        capacity, self._capacity_weights = self._capacities(derating, conditions)
        charge, charge_weight = _starts(start)
        self._start_charge = start.charge
        self._told = start.told
        self._capacity = np.repeat(capacity, STARTS)
        starts = np.tile(charge, CAPACITIES)
        weights = np.outer(self._capacity_weights, charge_weight).ravel()
        rate_per_h = conditions.rate_per_h
        self.trust = GaugeTrust(weights, self._prior, starts, *self._counted(derating), rate_per_h)
        self._holds = np.ones(CAPACITIES * STARTS)
        self._cutoff = self._usual_cutoff
        self._rate = rate_per_h
        self._planned_rate = rate_per_h
        self._slow_rate = 0.0
        self._most_slow_rate = rate_per_h
        self._time_s = 0.0
        self._most = math.inf
        self._drawn = 0.0
        self._used = 0.0
        self._charge = starts.copy()
        self._cold = cold_resistance(conditions.temperature_c)
        self._most_cold = cold_resistance(conditions.temperature_c, MOST_COLD_TIMES)
        self._volts = np.zeros((CAPACITIES * STARTS, 3))
        self._volts[:, _FAST] = self._cold * thresholds.RESISTANCE
        self._volts[:, _SLOW] = self._cold * thresholds.RESISTANCE
        self._volts_covariance = np.diag(
            [self._curve_variance, self._resistance_variance, self._resistance_variance]
        )
        gauge = start.charge
        if start.told:  # nothing was shown yet
            gauge = math.nan
        self.see(
            Witnesses(
                used=0.0,
                used_sd=0.0,
                voltage_v=math.nan,
                current_a=math.nan,
                peak_a=-math.inf,
                gauge=gauge,
                time_s=0.0,
            )
        )

    def recharge(self, charge: float) -> None:
        """Go on with the same battery at another charge, which somebody tells.

        What is believed of its capacity, its resistance and the gauge's gain stays; a gauge that
        has jumped is believed again, one with a course of its own is not. The charge is as
        uncertain as any that is told, and the error of the open-circuit curve is that of another
        charge.
        """
        moved = abs(charge - self.charge)
        charges, charge_weight = _starts(Start(charge))
        joint = self.trust.joint.reshape(-1, CAPACITIES, STARTS).sum(axis=2)
        # What looked like a jump may have been the charge itself, and a charge sets gauges anew.
        joint[FOLLOWS] += joint[JUMPED]
        joint[JUMPED] = 0.0
        by_capacity = self.trust.weights.reshape(CAPACITIES, STARTS) + _IMPOSSIBLE
        within = by_capacity / by_capacity.sum(axis=1, keepdims=True)

        def merged(values: Floats) -> tuple[Floats, Floats]:
            """Mean over the former starts of each capacity, and the deviations from it, shape (n,
            ...)."""
            of_starts = values.reshape(CAPACITIES, STARTS, -1)
            mean = np.einsum("cs,csa->ca", within, of_starts)
            apart = (of_starts - mean[:, None]).reshape(values.shape)
            return np.repeat(mean, STARTS, axis=0).reshape(values.shape), apart

        gain, gain_variance = self.trust.gain
        gain_mean, gain_apart = merged(gain)
        gain_variance, _ = merged(gain_variance + gain_apart**2)
        self._volts, volts_apart = merged(self._volts)
        between = volts_apart.T @ (self.trust.weights[:, None] * volts_apart)
        self._volts_covariance = self._volts_covariance + between
        self._volts_covariance = self._fade_curve(moved)
        starts = np.tile(charges, CAPACITIES)
        new_joint = (joint[:, :, None] * charge_weight).reshape(len(joint), -1)
        self.trust.recharge(new_joint, starts, gain_mean, gain_variance)
        self._start_charge = charge
        self._told = True
        self._charge = starts.copy()
        self._holds = np.ones_like(starts)
        self._most = math.inf
        # At the charger the cells have rested, and the way from here is a new one.
        self._slow_rate = 0.0
        self._drawn = 0.0
        self._used = 0.0
        self._time_s = 0.0
        self._tell()

    def _fade_curve(self, moved: float) -> Floats:
        """Fade what is known of the curve over a change of the charge; returns the covariance
        then."""
        stays, covariance = self._predicted(moved)
        self._volts[:, _OFFSET] *= stays
        return covariance

    def _capacities(
        self, derating: tuple[float, float], conditions: Conditions
    ) -> tuple[Floats, Floats]:
        """Capacities and their probabilities: the product of what is uncertain about them."""
        prior = self._prior
        shares = (np.arange(_FACTOR_STEPS) + 0.5) / _FACTOR_STEPS
        half_range = math.sqrt(3.0) * prior.capacity_sd
        if self._capacity_is_fitted:
            aged = prior.capacity + prior.capacity_sd * ndtri(shares)
        else:
            aged = prior.capacity + half_range * (2.0 * shares - 1.0)
        self._aged = np.maximum(aged, 0.05)
        steps = shares[:: _FACTOR_STEPS // 8]
        derated = derating[0] + (derating[1] - derating[0]) * shares
        # What is lost in the resistance is not metered at the terminals.
        half_ohms = thresholds.RESISTANCE + math.sqrt(3.0) * thresholds.RESISTANCE_SD * (
            2.0 * steps - 1.0
        )
        ohms = 2.0 * cold_resistance(conditions.cells_c) * half_ohms
        sag = 1.0 - self._cells.beyond_label_per_h(conditions.rate_per_h) * ohms
        metered = np.maximum(1.0 + conditions.gain_sd * ndtri(steps), 0.1)
        modelled = 1.0 + math.sqrt(3.0) * conditions.modelled_sd * (2.0 * steps - 1.0)
        factors = [self._aged, derated, np.maximum(sag, 0.1), metered, np.maximum(modelled, 0.1)]
        # What is certain counts once.
        product = (
            conditions.metered_share
            * np.asarray(reduce(np.multiply.outer, map(np.unique, factors))).ravel()
        )
        counts, edges = np.histogram(product, CAPACITIES)
        return 0.5 * (edges[1:] + edges[:-1]), counts / counts.sum()

    def _counted(self, derating: tuple[float, float]) -> tuple[Floats, Floats]:
        """Fall of a counter over the fall of the charge that can be drawn, by battery: mean and
        standard deviation.

        A counter has learned the charge of a warm battery that is drawn slowly. Whether it knows
        the cold and the rate is unknown, so that the ratio is between what these leave of the
        capacity and 1.
        """
        oldest, newest = self._aged[[0, -1]]
        # A capacity that is low for its age is so by the cold or the rate.
        low = np.clip(self._capacity / newest, *derating)
        high = np.clip(self._capacity / oldest, *derating)
        mean_derating = 0.5 * (low + high)
        # Two uniform distributions: between the mean derating and 1, and of the derating.
        sd = np.hypot(1.0 - mean_derating, 0.5 * (high - low)) / math.sqrt(12.0)
        return 0.5 * (1.0 + mean_derating), sd

    @property
    def _curve_variance(self) -> float:
        return self._cells.facts.curve_sd**2 + thresholds.VOLTAGE_GAIN_SD**2

    @property
    def _resistance_variance(self) -> float:
        return (self._cold * thresholds.RESISTANCE_SD) ** 2

    def see(self, read: Witnesses) -> None:
        """Weigh the possible batteries by what was read in a window."""
        charge_before = self._charge
        self._used = read.used
        energy = energy_share(self._cells.curve, self.trust.start) - read.used / self._capacity
        self._charge = charge_share(self._cells.curve, np.clip(energy, 0.0, 1.0))
        likelihood = self._drives(energy, read) * self._fits_voltage(charge_before, read)
        charge_sd = np.full_like(self._charge, read.used_sd / self._capacity.mean())
        if read.voltage_v <= self._cutoff_v:
            self._most = read.used  # it is cut off: nothing is left
        self.trust.see(read.gauge, self.trust.start - self._charge, charge_sd**2, likelihood)
        self._tell()

    def _drives(self, energy: Floats, read: Witnesses) -> Floats:
        """Likelihood of driving still, given that it did before."""
        energy_sd = np.hypot(read.used_sd / self._capacity, thresholds.EMPTY_SD)
        holds = np.minimum(ndtr(energy / energy_sd), self._holds)
        likelihood = np.maximum(holds / self._holds, _LEAST_LIKELIHOOD)
        self._holds = np.maximum(holds, _LEAST_LIKELIHOOD)
        return np.asarray(likelihood)

    def _fits_voltage(self, charge_before: Floats, read: Witnesses) -> Floats:
        """Likelihood of the voltage, and update of resistance and curve."""
        cells = self._cells
        if math.isfinite(read.time_s):
            self._time_s += read.time_s
        if not math.isfinite(read.voltage_v + read.current_a):
            self._polarise(self._planned_rate, read.time_s)
            return np.ones_like(self._charge)
        rate = cells.rate_per_h(read.current_a)
        # Protections cut off within seconds: the largest load on the way counts, not the mean.
        self._rate = max(self._rate, rate, cells.rate_per_h(read.peak_a))
        slow_rate = self._polarise(rate, read.time_s)
        moved = abs(float(self.trust.weights @ (self._charge - charge_before)))
        self._drawn += moved
        covariance = self._fade_curve(moved)
        jacobian = np.array([1.0, -rate, -slow_rate])
        predicted = self._at_rest() + self._volts @ jacobian
        innovation = read.voltage_v / cells.mean_v - predicted
        noise = math.hypot(thresholds.VOLTAGE_NOISE, thresholds.SAG_ERROR * rate * self.resistance)
        variance = float(jacobian @ covariance @ jacobian) + noise**2
        # Relative densities: that of an outlier is the same over the whole range of voltages.
        inlier = (1.0 - thresholds.VOLTAGE_OUTLIERS) * np.exp(-0.5 * innovation**2 / variance)
        outlier = (
            thresholds.VOLTAGE_OUTLIERS
            * math.sqrt(2.0 * math.pi * variance)
            / thresholds.VOLTAGE_RANGE
        )
        gain = covariance @ jacobian / variance
        self._volts += (innovation * inlier / (inlier + outlier))[:, None] * gain
        self._volts_covariance = covariance - np.outer(gain, gain) * variance
        if not math.isfinite(self._cutoff_v):
            # Nobody said where it is cut off: not there, for it drives.
            self._cutoff = min(self._cutoff, read.voltage_v / cells.mean_v)
        # the voltage of cells of unknown chemistry does not tell their charge
        if not cells.has_curve:
            return np.ones_like(self._charge)
        return np.asarray(inlier + outlier)

    def _polarise(self, rate: float, time_s: float) -> float:
        """Mean rate that the slow half of the resistance feels in a window."""
        rate_before = self._slow_rate
        lag_at_end = math.exp(-time_s / thresholds.POLARISES_S)
        mean_lag = lag_at_end
        if 0.0 < time_s < math.inf:
            mean_lag = (1.0 - lag_at_end) * thresholds.POLARISES_S / time_s
        self._slow_rate = rate + (rate_before - rate) * lag_at_end
        self._most_slow_rate = max(self._most_slow_rate, self._slow_rate)
        return rate + (rate_before - rate) * mean_lag

    def _predicted(self, moved: float) -> tuple[float, Floats]:
        """What stays of the curve's error when a share of the charge was drawn, and the covariance
        of the voltage then.

        The error of the curve is another one some tenths of the charge further on, the resistance a
        little.
        """
        stays = math.exp(-moved / thresholds.CURVE_ERROR_LASTS)
        fade = np.diag([stays, 1.0, 1.0])
        ohms = self._resistance_variance * moved
        renewed = np.diag([self._curve_variance * (1.0 - stays * stays), ohms, ohms])
        return stays, fade @ self._volts_covariance @ fade + renewed

    def _at_rest(self) -> Floats:
        """Open-circuit voltage by the curve, or by the mean of all chemistries, relative."""
        cells = self._cells
        if not cells.has_curve:
            return any_cell(self._charge)
        return np.asarray(open_circuit_v(cells.curve, self._charge) / cells.mean_v)

    def _tell(self) -> None:
        """Tell the energy from the start until empty by parts of the probability."""
        unusable, lasts_s, sag_weights = self._under_load()
        until_empty = energy_share(self._cells.curve, self.trust.start) - unusable
        drawn_per_s = self._planned_rate / _S_PER_H
        if self._used > 0.0 and self._time_s > 0.0:
            drawn_per_s = self._used / self._time_s
        is_cut_off = np.isfinite(lasts_s)
        until_cut_off = np.where(
            is_cut_off, self._used + drawn_per_s * np.where(is_cut_off, lasts_s, 0.0), math.inf
        )
        totals = np.minimum(np.maximum(until_empty * self._capacity, self._used), until_cut_off)
        totals = np.minimum(totals, self._most).ravel()
        weights = (sag_weights[:, None] * self.trust.weights).ravel()
        order = np.argsort(totals, kind="stable")
        totals = totals[order]
        weights = weights[order]
        probabilities = np.concatenate([[0.0], np.cumsum(weights)])
        probabilities /= probabilities[-1]
        # Mass and moment up to each end, so that a possible battery may be in two parts.
        moments = np.concatenate([[0.0], np.cumsum(weights * totals)])
        moment_at_end = np.interp(_PARTS, probabilities, moments / weights.sum())
        self.weights = np.diff(_PARTS)
        self.totals = np.diff(moment_at_end) / self.weights
        if self.is_overdrawn and math.isinf(self._most):  # at its cut-off nothing is left
            self.totals = self._used + self._overdraft * _SPREAD

    @property
    def _overdraft(self) -> float:
        """Root mean square of what was drawn beyond what those possible batteries hold: so wrong
        was what was believed of the energy, and so unsure is what is left."""
        holds = energy_share(self._cells.curve, self.trust.start) * self._capacity
        return math.sqrt(float(self._prior_weights @ (self._used - holds) ** 2))

    @property
    def _prior_weights(self) -> Floats:
        """Probability of each battery before anything was read, shape (n,)."""
        _, of_charge = _starts(self.start)
        return np.outer(self._capacity_weights, of_charge).ravel()

    def _under_load(self) -> tuple[Floats, Floats, Floats]:
        """How a battery ends under the largest load so far, by deviation of its voltage and
        battery.

        Returns:
            Share of the energy that stays in it below the cut-off, shape (deviations, n); time
            until its slow half takes the voltage to the cut-off although it is not empty, s,
            infinite if that does not happen, of the same shape; and the probability of each
            deviation.
        """
        cells = self._cells
        knows_voltage = self._volts_covariance[_FAST, _FAST] < self._resistance_variance
        if cells.has_curve:
            at_rest = self._at_rest()
        elif knows_voltage:
            # Where on its curve a battery of unknown chemistry is, nobody knows.
            at_rest = self._at_rest() - most_fall(self._charge, self._drawn)
        else:
            # Nothing is known of its voltage: it ends when it is empty, or if its load is too much
            # for a full one.
            at_rest = any_cell(np.ones_like(self._charge))
        needs_now = self._needs(self._slow_rate)
        needs_settled = self._needs(max(self._most_slow_rate, self._slow_rate))
        rise = needs_settled - needs_now
        # Share of its rise that the need has made when it reaches the voltage at rest; without a
        # rise all or nothing.
        without_rise = np.where(at_rest > needs_now, 1.0, 0.0)
        share = np.where(
            rise > 0.0, (at_rest - needs_now) / np.maximum(rise, _LEAST_RISE), without_rise
        )
        with np.errstate(divide="ignore"):  # it settles without reaching it
            lasts_s = -thresholds.POLARISES_S * np.log(1.0 - np.clip(share, 0.0, 1.0))
        self.fails = float(_SAG_WEIGHTS @ (lasts_s < self._time_s) @ self.trust.weights)
        if not cells.has_curve:
            return np.zeros_like(needs_now), lasts_s, _SAG_WEIGHTS
        # What is cut off before it settles counts by its time, not by its charge.
        needs = np.where(needs_settled > at_rest, -math.inf, needs_settled)
        unusable = energy_share(cells.curve, charge_at(cells.curve, needs))
        return np.asarray(unusable), lasts_s, _SAG_WEIGHTS

    def _needs(self, slow_rate: float) -> Floats:
        """Open-circuit voltage at which the battery is cut off, by deviation and battery, shape
        (deviations, n).

        It is asked for after the way home, which takes as much as the way out took.

        Args:
            slow_rate: Rate that the slow half of the resistance feels then.
        """
        moved = 0.0
        if self._cells.has_curve:
            moved = self._drawn
        jacobian = np.array([1.0, -max(self._rate, 0.0), -max(slow_rate, 0.0)])
        stays, covariance = self._predicted(moved)
        above_curve = stays * self._volts[:, _OFFSET]
        sags = -self._volts[:, _FAST:] @ jacobian[_FAST:]
        sag_error = thresholds.SAG_ERROR * float(self.trust.weights @ sags)
        voltage_sd = math.hypot(math.sqrt(float(jacobian @ covariance @ jacobian)), sag_error)
        curve_sd = math.sqrt(covariance[_OFFSET, _OFFSET])
        # Cut-offs and resistances have limits, which the tails of a normal distribution have not.
        half_cutoff_range = math.sqrt(3.0) * self._cutoff_sd
        half_ohms = self._most_cold * (
            thresholds.RESISTANCE + math.sqrt(1.5) * thresholds.RESISTANCE_SD
        )
        most_sags = np.maximum(sags, -half_ohms * float(jacobian[_FAST:].sum()))
        beyond_sags = np.minimum(
            _SAGS * math.hypot(voltage_sd, self._cutoff_sd), half_cutoff_range + _SAGS * voltage_sd
        )
        beyond_most_sags = half_cutoff_range + _SAGS * curve_sd
        needs = np.minimum(sags + beyond_sags[:, None], most_sags + beyond_most_sags[:, None])
        return np.asarray(self._cutoff - above_curve + needs)

    @property
    def start(self) -> Start:
        """The charge at the start, as it was told or shown."""
        return Start(self._start_charge, self._told)

    @property
    def resistance(self) -> float:
        """Sag of the voltage at a rate of one charge an hour, over the mean open-circuit
        voltage."""
        return float(self.trust.weights @ (self._volts[:, _FAST] + self._volts[:, _SLOW]))

    @property
    def charge(self) -> float:
        """State of charge, 0 to 1."""
        return float(self.trust.weights @ self._charge)

    @property
    def charge_sd(self) -> float:
        """Standard deviation of that."""
        return math.sqrt(max(float(self.trust.weights @ (self._charge - self.charge) ** 2), 0.0))

    @property
    def is_overdrawn(self) -> bool:
        """Whether hardly any battery that was possible before anything was read holds what was
        drawn: it is another one, or the meter reads too much."""
        return float(self._prior_weights @ self._holds) < thresholds.RISK

    @property
    def total(self) -> float:
        """Mean energy from the start until empty."""
        return float(self.weights @ self.totals)

    @property
    def total_sd(self) -> float:
        """Standard deviation of that."""
        return math.sqrt(max(float(self.weights @ (self.totals - self.total) ** 2), 0.0))


@lru_cache(maxsize=4)
def _starts(start: Start) -> tuple[Floats, Floats]:
    """States of charge at the start and their probabilities, each of shape (STARTS,): kept, as
    every update asks for them, and not to be changed."""
    charge, weight = _drawn_starts(start)
    charge.flags.writeable = False
    weight.flags.writeable = False
    return charge, weight


def _drawn_starts(start: Start) -> tuple[Floats, Floats]:
    if start.told:
        # Chargers end, and cells lose, some per cent; nobody tells more than full.
        charge = np.linspace(
            max(start.charge - 4.0 * thresholds.TOLD_SD, 0.005),
            min(start.charge + thresholds.TOLD_SD, 1.0),
            STARTS,
        )
        weight = np.exp(-0.5 * ((charge - start.charge) / thresholds.TOLD_SD) ** 2)
        return charge, weight / weight.sum()
    coarse = np.linspace(0.04, 1.0, STARTS // 2 + 1)
    fine = np.clip(start.charge + np.linspace(-0.05, 0.05, STARTS // 2), 0.005, 1.0)
    charge = np.sort(np.concatenate([coarse, fine]))
    width = np.gradient(charge)
    full = np.exp(-0.5 * ((1.0 - charge) / thresholds.TOLD_SD) ** 2) * width
    any_charge = width / width.sum()
    weight = (
        thresholds.STARTS_FULL * full / full.sum() + (1.0 - thresholds.STARTS_FULL) * any_charge
    )
    return charge, weight / weight.sum()
