"""Uncertainty of a robot file: of its parameters after a diagnosis, and of the robot's
instruments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from homeward.physics import thresholds

_MOST_NUMBERS = 64  # chosen: more than the 32 parameters of all effects with those of a robot
_OF = ("energy", "charge", "force")
_MEANT = {
    "charge": "of the motors: shares below refer to their current",
    "force": "at the wheels: the losses of the drive are no part of it",
}
_INSTRUMENTS: dict[str, float] = {
    "power_gain": thresholds.MOST_ERROR, "power_noise": 10.0, "reading_s": 3600.0, "soc_step": thresholds.MOST_ERROR,
    "soc_noise": thresholds.MOST_ERROR, "soc_lag_s": thresholds.MOST_LAG_S, "speed_noise": thresholds.MOST_ERROR,
    "grade_noise": thresholds.MOST_ERROR,
}  # fmt: skip
"""Sizes of the instruments' errors, standard deviations unless
`homeward.envs.conditions.instruments` says otherwise, and the upper limit of each. `reading_s` is
the time between the readings of power that have its noise."""


class UncertaintyError(ValueError):
    """An `[uncertainty]` table that cannot be used; the message says what is allowed."""


@dataclass(frozen=True)
class Uncertainty:
    """The table `[uncertainty]` of a robot file; shares are relative to the file's value.

    Attributes:
        source: Where it comes from.
        fitted: Names of the fitted parameters: `idle_power`, `sample_energy`, `rolling`, `drag`,
            `mass`, `capacity`, or those of effects, such as `turning.scrub`.
        covariance: Covariance of their relative errors, shape (fitted, fitted).
        between_runs: Relative standard deviation of a run's energy about the prediction; None if
            not known.
        unexplained: Standard deviation of unexplained power, relative to the mean power.
        unexplained_m: Correlation length of unexplained power, m.
        instruments: Sizes of the instruments' errors by name, as far as known.
        of: `energy`, or `charge` if motor current was recorded, which follows torque and not power:
            shares then refer to the charge; or `force` of a coast-down test and a scale
            (`homeward.physics.coast_down`): shares of the forces at the wheels and of the mass, of
            which the losses of the drive are no part.

    Raises:
        UncertaintyError: A value is not allowed.
    """

    source: str = ""
    fitted: tuple[str, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    between_runs: float | None = None
    unexplained: float = 0.0
    unexplained_m: float = 0.0
    instruments: tuple[tuple[str, float], ...] = ()
    of: str = "energy"

    def __post_init__(self) -> None:
        if self.of not in _OF:
            raise UncertaintyError(f"of = {self.of!r} is not allowed; choose from {', '.join(_OF)}")
        if not isinstance(self.source, str):
            raise UncertaintyError(f"source = {self.source!r} is not a text")
        count = len(self.fitted)
        names = all(isinstance(name, str) for name in self.fitted)
        if not names or count > _MOST_NUMBERS or len(set(self.fitted)) != count:
            raise UncertaintyError(
                f"fitted = {list(self.fitted)!r}; give at most {_MOST_NUMBERS} names, each once"
            )
        self._check_covariance(count)
        if self.between_runs is not None:
            _check("between_runs", self.between_runs, highest=10.0)
        _check("unexplained", self.unexplained, highest=100.0)
        _check("unexplained_m", self.unexplained_m, highest=1e6)
        for name, value in self.instruments:
            if name not in _INSTRUMENTS:
                raise UncertaintyError(
                    f"instruments.{name} = {value!r} is not a known field; known: {', '.join(_INSTRUMENTS)}"
                )
            _check(f"instruments.{name}", value, _INSTRUMENTS[name])

    def _check_covariance(self, count: int) -> None:
        if count == 0 and not self.covariance:
            return
        try:
            matrix = np.array(self.covariance, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            matrix = np.full((1, 1), np.nan)  # which is refused
        if matrix.shape != (count, count) or not np.isfinite(matrix).all():
            raise UncertaintyError(
                f"covariance is not a table of {count} x {count} numbers, one for each of fitted"
            )
        rounding = 1e-6 * max(np.abs(matrix).max(), 1e-300)
        if np.abs(matrix - matrix.T).max() > rounding:
            raise UncertaintyError(
                "covariance is not symmetric; give the covariance of each pair twice"
            )
        if np.linalg.eigvalsh(matrix).min() < -rounding:
            raise UncertaintyError(
                "covariance has a negative eigenvalue: no numbers vary so together"
            )

    def variance(self, name: str) -> float | None:
        """Variance of a fitted parameter's relative error; None if it was not fitted.

        >>> Uncertainty(fitted=("mass",), covariance=((0.01,),)).variance("mass")
        0.01
        """
        if name not in self.fitted:
            return None
        index = self.fitted.index(name)
        return self.covariance[index][index]

    def unexplained_over(self, way_m: float) -> float:
        """Standard deviation of unexplained power averaged over a distance, relative to the mean
        power.

        For an exponential correlation of length L, the mean over a distance x has the variance 2 L
        / x - 2 (L / x)^2 (1
        - exp(-x / L)), relative to that at a point.

        >>> uncertainty = Uncertainty(unexplained=0.3, unexplained_m=10.0)
        >>> round(uncertainty.unexplained_over(0.001), 3), round(uncertainty.unexplained_over(2000.0), 4)
        (0.3, 0.0299)
        """
        if way_m <= 1e-6 * self.unexplained_m:  # a point
            return self.unexplained
        if self.unexplained == 0.0 or self.unexplained_m == 0.0:
            return 0.0
        share = self.unexplained_m / way_m
        variance = 2.0 * share * (1.0 - share * -math.expm1(-1.0 / share))
        return self.unexplained * math.sqrt(max(variance, 0.0))

    def to_toml(self) -> str:
        """Text of the table, readable by `from_table`."""
        lines = ["[uncertainty]", f"source = {_quoted(self.source)}"]
        if self.of != "energy":
            lines.append(f'of = "{self.of}"  # {_MEANT[self.of]}')
        lines.append(f"fitted = [{', '.join(map(_quoted, self.fitted))}]")
        rows = ", ".join(map(_row_text, self.covariance))
        lines.append(f"covariance = [{rows}]  # of their relative errors")
        if self.between_runs is not None:
            lines.append(
                f"between_runs = {self.between_runs:.6g}  # relative standard deviation of a run's {self.of}"
            )
        lines.append(
            f"unexplained = {self.unexplained:.6g}  # relative standard deviation of unexplained power"
        )
        lines.append(f"unexplained_m = {self.unexplained_m:.6g}  # its correlation length, m")
        if self.instruments:
            lines += [
                "",
                "[uncertainty.instruments]",
                *(f"{name} = {value:.6g}" for name, value in self.instruments),
            ]
        return "\n".join(lines) + "\n"


def from_table(table: Any) -> Uncertainty:
    """Read the table `[uncertainty]` of a robot file.

    Raises:
        UncertaintyError: A field is unknown or a value not allowed.
    """
    if not isinstance(table, Mapping):
        raise UncertaintyError(f"uncertainty = {table!r} is not a table")
    allowed = [table_field.name for table_field in fields(Uncertainty)]
    for name in table:
        if name not in allowed:
            raise UncertaintyError(f"{name} is not a known field; known: {', '.join(allowed)}")
    values = dict(table)
    instruments = values.pop("instruments", {})
    if not isinstance(instruments, Mapping):
        raise UncertaintyError(f"instruments = {instruments!r} is not a table")
    for name in ("fitted", "covariance"):
        if not isinstance(values.get(name, []), list):
            raise UncertaintyError(f"{name} = {values[name]!r} is not a list")
    rows = values.pop("covariance", [])
    if not all(isinstance(row, list) for row in rows):
        raise UncertaintyError("covariance is not a list of lists of numbers")
    values["fitted"] = tuple(values.get("fitted", ()))
    values["covariance"] = tuple(map(tuple, rows))
    values["instruments"] = tuple(instruments.items())
    return Uncertainty(**values)


def _check(name: str, value: Any, highest: float) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= highest:
        raise UncertaintyError(
            f"{name} = {value!r} is not allowed; give a number in [0, {highest:g}]"
        )


def _row_text(row: tuple[float, ...]) -> str:
    """A row of a matrix in TOML."""
    values = ", ".join(f"{value:.6g}" for value in row)
    return f"[{values}]"


def _quoted(text: str) -> str:
    """A text in quotes, with a question mark for each sign that would need an escape."""
    plain = "".join(sign if sign.isprintable() and sign not in '"\\' else "?" for sign in text)
    return f'"{plain}"'
