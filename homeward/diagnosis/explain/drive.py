"""One drive of the menu, simulated with the refitted robot: what it would record."""

from __future__ import annotations

import numpy as np

from homeward.diagnosis.explain.menu import KNOWN_MASS, Course
from homeward.diagnosis.fit.parameter_groups import MASS, ROLLING, WithEffects, derivatives
from homeward.diagnosis.fit.refit import Refit
from homeward.diagnosis.read.signals import Array, Unit


class Drive:
    """A drive, what it would record without any effect, and how the groups would change that."""

    def __init__(self, fit: Refit, course: Course, unit: Unit, usual_c: float) -> None:
        self.fit, self.course = fit, course
        self.runs = course.runs(unit, usual_c)
        self.plain = self.predict(fit.theta)

    def by_group(self) -> list[Array]:
        """What each group adds per unit of its scale, shape (samples,) each."""
        return derivatives(self.fit.parameters, self.fit.theta, self.plain, self.predict)

    def there(self, what: str | None) -> Array | float:
        """How much of the load, the ground or the route of the recordings is there, shape (samples,)."""
        return 1.0 if what is None else self.course.there.get(what, 1.0)

    def predict(self, theta: Array, extra: WithEffects | None = None) -> Array:
        """What would be recorded; nothing is drawn where everything is off."""
        predict = self.fit.parameters.predict
        power = predict(self.runs, theta, extra)
        if self.course.known_mass.any():
            loaded, on_top_kg = theta.copy(), KNOWN_MASS * self.fit.parameters.nominal.mass_kg
            loaded[ROLLING] *= 1.0 + on_top_kg / theta[MASS]
            loaded[MASS] += on_top_kg
            power = np.where(self.course.known_mass > 0.0, predict(self.runs, loaded, extra), power)
        return power * self.course.switched_on
