"""A shield around any policy: its action is taken only if the robot still gets home with high
probability."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents import thresholds
from homeward.agents.base import Observations, Policy, feature
from homeward.agents.belief import Belief
from homeward.envs.actions import Commands, decode_actions, encode_actions
from homeward.envs.options import Known
from homeward.envs.state import RETURN
from homeward.estimation import thresholds as estimation_thresholds
from homeward.physics import ancillary_power


@final
class Shield(Policy):
    """Replaces a policy's action by a return if the action violates a chance constraint.

    An action is safe if the energy left, after the action and the way home after it, is at least 0
    with probability 1 - risk under the belief about robot and wind (`homeward.estimation`). A
    return of the shield is at cruise, without stops and without sensing, and final. A return of the
    policy is checked at every decision as well. To make the parameters identifiable, the shield
    makes excitation steps (`Belief.looks_back`), unless nothing is hidden. The time limit is
    treated likewise, with a fixed reserve.

    Args:
        policy: The policy to shield.
        known: Constants of the environment.
        risk: Allowed probability of stranding in each decision, within (0, 0.5].
    """

    def __init__(self, policy: Policy, known: Known, risk: float = thresholds.RISK) -> None:
        self._policy = policy
        self._known = known
        self._risk = risk
        self._belief = Belief(known, estimation_thresholds.MISSED)
        self._safe_action = encode_actions(known, known.shared["cruise_mps"][0], 0.0, RETURN)[0]
        self._home_mps = float(decode_actions(known, self._safe_action[None]).speed_mps[0])
        self._overruled = np.zeros(0, np.bool_)

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action for each mission, see `Policy.act`."""
        actions = np.array(self._policy.act(observations, begun))
        self._belief.learn(observations, begun)
        if len(begun) != len(self._overruled):
            self._overruled = np.zeros(len(begun), np.bool_)
        self._overruled[begun] = False
        returning = feature(observations, "returning") >= 1.0
        decoded = decode_actions(self._known, actions)
        wanted = Commands(
            speed_mps=decoded.speed_mps,
            sensing_hz=decoded.sensing_hz,
            mode=np.where(returning, RETURN, decoded.mode),
        )
        unsafe = self._margin_j(observations, wanted) < 0.0
        # The shield's own action needs no check.
        unsafe &= ~(
            wanted.returns & (wanted.driven_mps == self._home_mps) & (wanted.sensing_hz == 0.0)
        )
        self._overruled |= unsafe & ~returning
        excites = self._belief.looks_back(observations) & ~returning & ~wanted.returns
        actions[excites] = self._belief.back_action
        heads_home = unsafe | self._overruled | self._late(observations, wanted)
        actions[heads_home] = self._safe_action
        return actions

    def _margin_j(self, observations: Observations, wanted: Commands) -> NDArray[np.float64]:
        """Quantile, at the risk, of the energy left after a decision and the way home after it, J,
        shape (n,)."""
        s = self._known.shared[0]
        position_m = feature(observations, "distance") * s["reach_m"]
        pit_stop_s = feature(observations, "pit_stop") * s["decision_s"]
        stands_s = np.minimum(pit_stop_s, s["decision_s"])
        way_m = wanted.driven_mps * (s["decision_s"] - stands_s)
        inwards = wanted.returns | (feature(observations, "outbound") < 0.0)
        ends_inwards_m = np.maximum(position_m - way_m, 0.0)
        ends_outwards_m = np.minimum(position_m + way_m, s["length_m"])
        ends_m = np.where(inwards, ends_inwards_m, ends_outwards_m)
        # Posts are those of a patrol; on other missions pit stops last 0 s.
        comes_to_post = (way_m > 0.0) & ((ends_m <= 0.0) | (ends_m >= s["length_m"]))
        asked_s = self._asked_s(observations, wanted)
        # A pit stop continues until the return is final, and a robot that is home before waits
        # there.
        stop_left_s = np.where(comes_to_post, s["pit_stop_s"], pit_stop_s - stands_s)
        waits_s = np.minimum(stop_left_s, asked_s)
        waits_s += np.maximum(asked_s - waits_s - ends_m / self._home_mps, 0.0)
        arrives = wanted.returns & (ends_m <= 0.0) & (wanted.driven_mps > 0.0) & (asked_s == 0.0)
        plans = self._belief.plans(observations, self._home_mps)
        plans["onwards_m"] = ends_m - position_m
        plans["speed_mps"] = np.where(way_m > 0.0, wanted.driven_mps, self._home_mps)
        arrives_after_s = position_m / np.maximum(wanted.driven_mps, 1e-9)
        plans["onwards_s"] = np.where(arrives, arrives_after_s, s["decision_s"])
        plans["onwards_j"] = (
            ancillary_power(self._known.robot, wanted.sensing_hz) * plans["onwards_s"]
        )
        plans["onwards_j"] += self._belief.estimator.vehicle.idle_w * waits_s
        plans["onwards_s"] += waits_s
        return np.asarray(self._belief.margin(plans, self._risk).total["margin_low_j"])

    def _asked_s(self, observations: Observations, wanted: Commands) -> NDArray[np.float64]:
        """Time after a decision for which the return must be chosen until it is final, s, shape
        (n,)."""
        s = self._known.shared[0]
        returning = feature(observations, "returning")
        asked = np.rint(returning * s["return_decisions"]) + 1.0
        decisions_left = s["return_decisions"] - np.where(wanted.returns, asked, 0.0)
        # With the last of them it is final at once.
        return np.where(
            returning >= 1.0, 0.0, np.maximum(decisions_left - 1.0, 0.0) * s["decision_s"]
        )

    def _late(self, observations: Observations, wanted: Commands) -> NDArray[np.bool_]:
        """Which missions would reach the time limit, less a reserve, before home, shape (n,)."""
        s = self._known.shared[0]
        left_s = (1.0 - feature(observations, "time")) * s["max_decisions"] * s["decision_s"]
        position_m = feature(observations, "distance") * s["reach_m"]
        ends_m = np.where(
            wanted.returns, position_m, position_m + wanted.driven_mps * s["decision_s"]
        )
        reserve_decisions = max(thresholds.SPARE_DECISIONS, float(s["return_decisions"]))
        reserve_s = reserve_decisions * s["decision_s"] + s["pit_stop_s"]
        return np.asarray(left_s < ends_m / self._home_mps + reserve_s)
