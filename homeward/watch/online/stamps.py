"""Time by the stamps of messages; if they jump or stand still, time by this computer's clock."""

from __future__ import annotations

from homeward import quantities
from homeward.watch import thresholds


class Stamps:
    """Converts the stamps of messages to a time that never decreases.

    Attributes:
        time_s: Time since the first message, s.
        said: The last fault, None if there is none.
    """

    def __init__(self) -> None:
        self.time_s = 0.0
        self.said: str | None = None
        self._stamp_s: float | None = None
        self._now_s: float | None = None

    def see(self, stamp_s: float | None, now_s: float) -> float | None:
        """The time of a message; None if it is not later than the last one.

        Args:
            stamp_s: Time of measurement by its header, s; None if it has no stamp.
            now_s: Time of receipt by a monotonic clock, s.
        """
        self.said = None
        if self._now_s is None:
            self._stamp_s = stamp_s
            self._now_s = now_s
            return self.time_s
        passed_s = now_s - self._now_s
        step_s = passed_s
        if stamp_s is not None and self._stamp_s is not None:
            step_s = stamp_s - self._stamp_s
        if abs(step_s - passed_s) > thresholds.JUMP_S:
            what = _jump(step_s, passed_s)
            difference = quantities.duration(abs(step_s - passed_s))
            self.said = (
                f"the clock of the messages {what} by {difference}: time continues as before"
            )
            step_s = passed_s
        elif step_s <= 0.0:
            return None
        self.time_s += step_s
        self._stamp_s = stamp_s
        self._now_s = now_s
        return self.time_s

    def without(self, now_s: float) -> float:
        """The present time if no message arrives, s: a second behind."""
        passed_s = 0.0 if self._now_s is None else now_s - self._now_s
        return self.time_s + max(passed_s - thresholds.BEHIND_S, 0.0)


def _jump(step_s: float, passed_s: float) -> str:
    """What happened to a clock whose stamps differ by `step_s` after a time that passed, in
    words."""
    if step_s == 0.0:
        return "stood still"
    return "was set forward" if step_s > passed_s else "was set back"
