"""What no recorded channel tells: power that comes and goes, beyond what the noise of all channels makes."""

from typing import NamedTuple

from homeward.diagnosis import rules
from homeward.diagnosis.fit.doubt import doubted
from homeward.diagnosis.fit.fitted import Fitted
from homeward.diagnosis.fit.replay import Runs
from homeward.diagnosis.read.channels import Array
from homeward.diagnosis.read.noise import white_noise
from homeward.diagnosis.read.signals import usual_step_s


class Tells(NamedTuple):
    """What power follows beside speed, and the channels that tell it."""

    what: str
    channels: tuple[str, ...]
    record: str


_TELLS = (
    Tells("slopes", ("grade_rad",), "grade_rad or elevation_m"),
    Tells("turns", ("yaw_rate_radps", "wheel_difference_mps"), "yaw_rate_radps"),
    Tells("the sensing rate", ("sensing_hz",), "sensing_hz"),
)


def unrecorded(runs: Runs) -> list[Tells]:
    """What was not recorded of what power follows; the sensing rate shows in no motor current."""
    missing = [one for one in _TELLS if not any(name in runs.context for name in one.channels)]
    return missing if runs.unit == "W" else [one for one in missing if "sensing_hz" not in one.channels]


def lasts(left: Array, runs: Runs) -> bool:
    """Whether what a model leaves, shape (windows,), goes on from window to window, as no noise of power does."""
    together = runs.run[1:] == runs.run[:-1]
    return float((left[1:] * left[:-1])[together].sum()) >= rules.LASTS * float(left @ left)


def untold(fit: Fitted, runs: Runs) -> bool:
    """Whether a fit leaves what no channel tells, though all were recorded: much of it, lasting, and no noise."""
    goes_on = is_much(fit, runs) and lasts(runs.observed - fit.predicted, runs)
    return goes_on and not unrecorded(runs) and times_noise(fit, runs) > rules.BEYOND_NOISE


def is_much(fit: Fitted, runs: Runs) -> bool:
    """Whether what a fit leaves is more than a meter and a few per cent of forms account for."""
    left = runs.observed - fit.predicted
    return float(left @ left) >= rules.MATTERS**2 * float(runs.observed @ runs.observed)


def times_noise(fit: Fitted, runs: Runs) -> float:
    """Squared error of a fit over that which the noise of power and of the other channels makes."""
    noise = doubted(fit, runs)
    for number, run in enumerate(runs.signals):
        here = runs.duration_s[runs.run == number]
        noise += float((white_noise(run.observed) ** 2 * usual_step_s(run.time_s) / here).sum())
    left = runs.observed - fit.predicted
    return float(left @ left) / max(noise, 1e-300)
