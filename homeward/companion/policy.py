"""A policy beside the companion: what it must be able to do, so that no agent is imported here."""

from __future__ import annotations

from typing import Any, Protocol

from homeward.physics import Robot


class OnboardPolicy(Protocol):
    """Such as `homeward.agents.onboard.load_onboard` makes."""

    @property
    def robot(self) -> Robot:
        """The robot that it decides for."""

    def begin(self) -> None:
        """Begin a mission with the next reading."""

    def update(
        self,
        time_s: float,
        position_m: float,
        *,
        speed_mps: float,
        power_w: float,
        soc: float,
        grade_rad: float,
        heading_rad: float,
        temperature_c: float,
        interest: float,
    ) -> tuple[float, float, str] | None:
        """Take in what was read, NaN where an instrument was silent, and answer what to do.

        That is a speed (m/s), a sensing rate (Hz) and `stop`, `go` or `return`; None where the mission is over.
        """

    def state(self) -> dict[str, Any]:
        """What a restart needs, for JSON."""

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from `state`."""
