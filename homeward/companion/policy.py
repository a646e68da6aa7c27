"""The interface of a policy that the companion runs, so that no agent is imported here."""

from __future__ import annotations

from typing import Any, Protocol

from homeward.physics import Robot


class OnboardPolicy(Protocol):
    """What `homeward.agents.onboard.load_onboard` returns."""

    @property
    def robot(self) -> Robot:
        """The robot that the policy is for."""

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
        """Process the readings of a moment, NaN where an instrument was not read, and return the
        command.

        That is a speed (m/s), a sensing rate (Hz) and `stop`, `go` or `return`; None if the mission
        is over.
        """

    def state(self) -> dict[str, Any]:
        """State for a restart, for JSON."""

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from `state`."""
