"""A shield around any policy: what it wants is done only while the robot would then still get home."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations, Policy, feature
from homeward.agents.shield_belief import Belief, Commands
from homeward.envs.actions import encode_actions
from homeward.envs.kernel import LEVELS
from homeward.envs.options import Options, Setting
from homeward.envs.state import RETURN, STOP

MARGINS = {0.999: 0.05}
"""Share of the way home kept beyond it, for each confidence that can be asked for; see docs/evaluation.md."""
_SPARE_DECISIONS = 3.0
"""Decisions by which a robot is home before the time limit."""


@final
class Shield(Policy):
    """Lets a policy act as long as the robot would afterwards still get home; else it heads home.

    It heads home at cruise, without stops and with nothing sensed, and asks before every decision, on the way home too,
    whether what the policy wants leaves enough for that. The way home is costed over the ground that was driven, on
    each of many imagined days that explain the energy used so far (`homeward.agents.shield_belief`); the worst counts.
    The time limit is minded as well.

    Args:
        policy: The policy to be shielded.
        options: Of the environment.
        setting: Its constants.
        confidence: That the robot gets home, one of `MARGINS`.

    Raises:
        ValueError: There is no margin for that confidence.
    """

    def __init__(self, policy: Policy, options: Options, setting: Setting, confidence: float = 0.999) -> None:
        if confidence not in MARGINS:
            raise ValueError(f"confidence = {confidence} is not allowed; choose from {', '.join(map(str, MARGINS))}")
        self._policy, self._setting, self._margin = policy, setting, MARGINS[confidence]
        self._safe_action = encode_actions(setting, setting.shared["cruise_mps"][0], 0.0, RETURN)[0]
        self._safe = decode_actions(setting, self._safe_action[None])
        self._belief = Belief(options, setting, float(self._safe.speed_mps[0]))
        self._last: Commands | None = None

    def act(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[Any]:
        """Choose one action a mission, see `Policy.act`."""
        actions = np.array(self._policy.act(observations, begun))
        if self._last is not None and len(self._last.homeward) != len(begun):
            self._last = None
        self._belief.learn(observations, begun, self._last)
        wanted = decode_actions(self._setting, actions)
        returning = feature(observations, "returning") > 0.0
        wanted = Commands(wanted.speed_mps, wanted.sensing_hz, wanted.homeward | returning)
        in_doubt = ~self._is_safe(wanted) & (feature(observations, "energy") > 0.0)
        overruled = self._belief.spare(observations, wanted, in_doubt, self._margin) < 0.0
        actions[overruled | self._late(observations, wanted)] = self._safe_action
        self._last = decode_actions(self._setting, actions)
        return actions

    def _is_safe(self, wanted: Commands) -> NDArray[np.bool_]:
        """Where a policy wants what the shield would do."""
        fast_enough = wanted.speed_mps == self._safe.speed_mps[0]
        return np.asarray(wanted.homeward & fast_enough & (wanted.sensing_hz == 0.0))

    def _late(self, observations: Observations, wanted: Commands) -> NDArray[np.bool_]:
        """Where the time limit would come before the robot is home."""
        s = self._setting.shared[0]
        left_s = (1.0 - feature(observations, "time")) * s["max_decisions"] * s["decision_s"]
        position_m = feature(observations, "distance") * s["reach_m"]
        ends_m = np.where(wanted.homeward, position_m, position_m + wanted.speed_mps * s["decision_s"])
        return np.asarray(left_s < ends_m / self._safe.speed_mps[0] + _SPARE_DECISIONS * s["decision_s"])


def decode_actions(setting: Setting, actions: NDArray[Any]) -> Commands:
    """What actions of shape (n, 3) command: the way back from what `encode_actions` makes."""
    s = setting.shared[0]
    if s["discrete"]:
        speed, sensing, mode = actions[:, 0] / (LEVELS - 1), actions[:, 1] / (LEVELS - 1), actions[:, 2]
    else:
        shares = 0.5 * (actions.astype(np.float64) + 1.0)
        speed, sensing, mode = shares[:, 0], shares[:, 1], np.minimum((3.0 * shares[:, 2]).astype(np.int64), 2)
    speed_mps = s["min_speed_mps"] + speed * (s["max_speed_mps"] - s["min_speed_mps"])
    return Commands(np.where(mode == STOP, 0.0, speed_mps), sensing * s["max_sensing_hz"], mode == RETURN)
