"""Time by the stamps of messages: it goes on as they do, or by this computer's clock where they jump or stand still."""

from __future__ import annotations

from homeward import quantities

_JUMP_S = 2.0
"""By how much a stamp may differ from what has passed since the one before: more than a message is ever late."""
_BEHIND_S = 1.0
"""By how much the clock keeps back where it goes on without messages, so that the next one is not late."""


class Stamps:
    """Joins the stamps of messages into a time that never goes back.

    Attributes:
        time_s: Time since the first message, s.
        said: What was last wrong, None if nothing is.
    """

    def __init__(self) -> None:
        self.time_s = 0.0
        self.said: str | None = None
        self._stamp_s: float | None = None
        self._now_s: float | None = None

    def see(self, stamp_s: float | None, now_s: float) -> float | None:
        """The time of a message; None where it is not later than the one before.

        Args:
            stamp_s: When its content was measured, by its header, s; None where it has no stamp.
            now_s: When it came, by a clock that only goes on, s.
        """
        self.said = None
        if self._now_s is None:
            self._stamp_s, self._now_s = stamp_s, now_s
            return self.time_s
        passed_s = now_s - self._now_s
        step_s = passed_s if stamp_s is None or self._stamp_s is None else stamp_s - self._stamp_s
        if abs(step_s - passed_s) > _JUMP_S:
            way = "stood still" if step_s == 0.0 else f"was set {'forward' if step_s > passed_s else 'back'}"
            by = quantities.duration(abs(step_s - passed_s))
            self.said = f"the clock of the messages {way} by {by}: time goes on as before"
            step_s = passed_s
        elif step_s <= 0.0:
            return None
        self.time_s += step_s
        self._stamp_s, self._now_s = stamp_s, now_s
        return self.time_s

    def without(self, now_s: float) -> float:
        """The time now where no message comes, s: a second behind."""
        passed_s = 0.0 if self._now_s is None else now_s - self._now_s
        return self.time_s + max(passed_s - _BEHIND_S, 0.0)
