"""Online estimation: from readings to a distribution of the robot's parameters, the wind and the
way home."""

from homeward.estimation.drive import Vehicle, vehicle_of
from homeward.estimation.estimator import Estimator, Margin, StateEstimate
from homeward.estimation.filter import READING_DTYPE
from homeward.estimation.margin import MARGIN_DTYPE, PLAN_DTYPE, WAY_DTYPE
from homeward.estimation.prior import Prior

__all__ = [
    "MARGIN_DTYPE",
    "PLAN_DTYPE",
    "READING_DTYPE",
    "WAY_DTYPE",
    "Estimator",
    "Margin",
    "Prior",
    "StateEstimate",
    "Vehicle",
    "vehicle_of",
]
