"""A shield around any policy: what it wants is done only while the robot would then still get home."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, Policy, feature
from homeward.agents.identification import Identification
from homeward.agents.shield.kernel import PLAN_DTYPE, spare
from homeward.envs.actions import Commands, decode_actions, encode_actions
from homeward.envs.options import Known
from homeward.envs.state import GO, RETURN
from homeward.physics import ancillary_power
from homeward.physics.model import drag_force

DEVIATIONS = {0.999: 6.0}
"""Standard deviations of the way home kept back, for each confidence that can be asked for; see docs/evaluation.md."""
_SHARE = 0.02
"""Share of the way home kept back beside them: chosen with them, on the same missions."""
_SPARE_DECISIONS = 3.0
"""Decisions by which a robot is home before the time limit."""
_PROBE = 0.5
"""Share of the range of speeds at which a probe is driven, as by the planner."""


@final
class Shield(Policy):
    """Lets a policy act as long as the robot would afterwards still get home; else it heads home.

    It heads home at cruise, without stops and with nothing sensed, and asks before every decision, on the way home too,
    whether what the policy wants leaves enough for that. The way home is costed by what `Identification` finds out: by
    each of the guesses that explain the drive, with some standard deviations on top; the worst counts. So that there is
    something to find out, every eighth decision of the way out is driven no faster than half speed, unless nothing is
    hidden. It reckons with strong winds everywhere, as they are on the routes `hidden_wind`. The time limit is minded
    as well.

    Args:
        policy: The policy to be shielded.
        known: Constants of the environment.
        confidence: That the robot gets home, one of `DEVIATIONS`.

    Raises:
        ValueError: There is no number of deviations for that confidence.
    """

    def __init__(self, policy: Policy, known: Known, confidence: float = 0.999) -> None:
        if confidence not in DEVIATIONS:
            raise ValueError(f"confidence = {confidence} is not allowed; choose from {', '.join(map(str, DEVIATIONS))}")
        s = known.shared[0]
        self._policy, self._known, self._deviations = policy, known, DEVIATIONS[confidence]
        self._identification = Identification(known, expects_strong_wind=True)
        self._safe_action = encode_actions(known, s["cruise_mps"], 0.0, RETURN)[0]
        home_mps = float(decode_actions(known, self._safe_action[None]).speed_mps[0])
        v, cruise_mps = self._identification.vehicle, float(s["cruise_mps"])
        drag_n = drag_force(v, home_mps) - drag_force(v, cruise_mps)
        self._home_mps = home_mps
        self._slower_j_per_m = v.idle_w / home_mps - v.idle_w / cruise_mps + drag_n * v.per_efficiency
        self._probe_mps = s["min_speed_mps"] + _PROBE * (s["max_speed_mps"] - s["min_speed_mps"])
        self._probes = not s["route_is_known"]

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        actions = np.array(self._policy.act(observations, begun))
        self._identification.learn(observations, begun)
        returning = feature(observations, "returning") >= 1.0
        if self._probes:
            self._slow_down_to_probe(actions, returning)
        wanted = decode_actions(self._known, actions)
        wanted = Commands(wanted.speed_mps, wanted.sensing_hz, np.where(returning, RETURN, wanted.mode))
        in_doubt = ~self._is_safe(wanted) & (feature(observations, "energy") > 0.0)
        overruled = self._spare_j(observations, wanted, in_doubt) < 0.0
        actions[overruled | self._late(observations, wanted)] = self._safe_action
        return actions

    def _slow_down_to_probe(self, actions: NDArray[Any], returning: NDArray[np.bool_]) -> None:
        wanted = decode_actions(self._known, actions)
        probes = self._identification.probes & ~returning & ~wanted.returns & (wanted.driven_mps > self._probe_mps)
        actions[probes, 0] = encode_actions(self._known, self._probe_mps, 0.0, GO)[0, 0]

    def _is_safe(self, wanted: Commands) -> NDArray[np.bool_]:
        """Where a policy wants what the shield would do."""
        return np.asarray(wanted.returns & (wanted.speed_mps == self._home_mps) & (wanted.sensing_hz == 0.0))

    def _spare_j(
        self, observations: Observations, wanted: Commands, in_doubt: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Energy beyond a decision and the way home after it, J; infinite where there is no doubt."""
        s, found = self._known.shared[0], self._identification
        position_m, way_m = found.position_m, wanted.driven_mps * s["decision_s"]
        inwards = wanted.returns | (feature(observations, "outbound") < 0.0)
        ends_m = np.where(inwards, np.maximum(position_m - way_m, 0.0), np.minimum(position_m + way_m, s["length_m"]))
        arrives = wanted.returns & (ends_m <= 0.0) & (wanted.driven_mps > 0.0)
        lasts_s = np.where(arrives, position_m / np.maximum(wanted.driven_mps, 1e-9), s["decision_s"])
        plans = np.zeros(len(observations), PLAN_DTYPE)
        plans["in_doubt"] = in_doubt
        plans["energy_j"] = feature(observations, "metered") * s["usable_j"]
        plans["home_cost_j"] = feature(observations, "home_cost") * s["usable_j"]
        plans["position_m"], plans["ends_m"] = position_m, ends_m
        plans["moves_m"] = np.where(inwards, position_m - ends_m, way_m)
        plans["speed_mps"] = wanted.driven_mps
        plans["ancillary_j"] = ancillary_power(self._known.robot, wanted.sensing_hz) * lasts_s
        plans["sine_near"] = 0.1 * feature(observations, "grade_1")
        spare_j = np.full(len(observations), np.inf)
        spare(
            found.vehicle, self._slower_j_per_m, plans, found.grounds, found.guesses, self._deviations, _SHARE, spare_j
        )
        return spare_j

    def _late(self, observations: Observations, wanted: Commands) -> NDArray[np.bool_]:
        """Where the time limit would come before the robot is home."""
        s = self._known.shared[0]
        left_s = (1.0 - feature(observations, "time")) * s["max_decisions"] * s["decision_s"]
        position_m = feature(observations, "distance") * s["reach_m"]
        ends_m = np.where(wanted.returns, position_m, position_m + wanted.driven_mps * s["decision_s"])
        return np.asarray(left_s < ends_m / self._home_mps + _SPARE_DECISIONS * s["decision_s"])
