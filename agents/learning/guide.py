"""What a learner starts from: what a rule or the planner proposes, and what it believes of the way home."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Observations
from homeward.agents.planner import Planner
from homeward.agents.rules.dmax_adaptive import AdaptiveDmaxRule
from homeward.agents.rules.pace import Pace
from homeward.agents.rules.rule import BelievingRule, Outlook
from homeward.agents.rules.tuned import PACES, RESERVES
from homeward.envs.actions import LEVELS, decode_actions
from homeward.envs.options import Known
from homeward.envs.state import STOP

NO_GUIDE, ADAPTIVE, PLANNER = "none", "dmax_adaptive", "planner"
GUIDES = (NO_GUIDE, ADAPTIVE, PLANNER)

BELIEFS = ("spare", "spare_here", "need", "drive_ratio", "sensing_ratio", "deviation")
"""Further inputs: energy beyond the way home after the next decision and at once, share of the energy left that the way
home takes, by how much driving and sensing take more than modelled, and how much that varies."""
_LIMIT = 3.0


class Guide:
    """Runs a guide, `planner` or the rule `dmax_adaptive`, beside a policy, which sees what it proposes and believes.

    The inputs of the policy are the observation, the `BELIEFS`, and the proposal. In a discrete space that is one
    number a choice: 1 for the proposed speed and sensing rate; for stopping 1 or -1; for returning from -1 to 1,
    positive where the guide returns, and the nearer to 0 the less energy lies between it and the other decision: a
    policy that adds a little to it turns a little earlier or later. In a continuous space it is an action.

    Args:
        known: Constants of the environment.
        deviations: Standard deviations that the guide keeps back.
        pace: Speed and sensing rate of `dmax_adaptive`; `None` for the `planner`, which chooses them.
    """

    def __init__(self, known: Known, deviations: float, pace: Pace | None) -> None:
        self._known, self._pace, self._deviations = known, pace, deviations
        self._policy: Planner | AdaptiveDmaxRule
        if pace is None:
            self._policy = Planner(known, deviations)
            self._rule: BelievingRule = self._policy.rule
        else:
            self._policy = self._rule = AdaptiveDmaxRule(known, pace, deviations)
        self._discrete = bool(known.shared["discrete"][0])
        self.proposals = 2 * LEVELS + 3 if self._discrete else 3
        self.extra = len(BELIEFS) + self.proposals

    @property
    def description(self) -> dict[str, Any]:
        """JSON that `guide_from` makes an equal guide from."""
        if self._pace is None:
            return {"rule": PLANNER, "deviations": self._deviations}
        return {"rule": ADAPTIVE, "deviations": self._deviations, "pace": dataclasses.asdict(self._pace)}

    def inputs(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Inputs of the policy, shape (n, features + extra); arguments as in `homeward.agents.base.Policy.act`.

        An observation that is shown twice counts once.
        """
        returns = self._rule.turns(observations, begun)
        actions = self._policy.drive(observations, returns)
        again = np.zeros(len(begun), np.bool_)
        outlook = self._rule.look(observations, again)
        spare = self._rule.spare_by(outlook)
        beliefs = _beliefs(outlook)
        # The planner also heads home for a decision to look back.
        back = decode_actions(self._known, actions).returns
        returning = _agreeing(np.clip(-spare / self._rule.sharp, -1.0, 1.0), back)
        propose = self._choices if self._discrete else self._commands
        return np.concatenate((observations, beliefs, propose(actions, returning)), axis=1, dtype=np.float32)

    def _choices(self, actions: NDArray[Any], returning: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = np.zeros((len(actions), self.proposals))
        rows = np.arange(len(actions))
        columns[rows, actions[:, 0]] = 1.0
        columns[rows, LEVELS + actions[:, 1]] = 1.0
        columns[:, -3] = np.where(actions[:, 2] == STOP, 1.0, -1.0)
        columns[:, -1] = returning
        return columns

    def _commands(self, actions: NDArray[Any], returning: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = actions.astype(np.float64)
        # Each mode has a third of [-1, 1]: between the middles of go, 0, and return, 2 / 3, the rule is less sure.
        stops = columns[:, 2] < -1.0 / 3.0
        columns[:, 2] = np.where(stops, columns[:, 2], (1.0 + returning) / 3.0)
        return columns


def _beliefs(outlook: Outlook) -> NDArray[np.float64]:
    """Columns of `BELIEFS`."""
    both = outlook.home + outlook.onwards
    columns = (
        10.0 * (outlook.left - both),
        40.0 * (outlook.left - outlook.home),
        outlook.home / np.maximum(outlook.left, 1e-3),
        4.0 * (outlook.driving - 1.0),
        4.0 * (outlook.sensing - 1.0),
        5.0 * outlook.deviation / np.maximum(both, 1e-9),
    )
    return np.clip(np.stack(columns, axis=1), -_LIMIT, _LIMIT)


def _agreeing(sure: NDArray[np.float64], returns: NDArray[np.bool_]) -> NDArray[np.float64]:
    """How sure the rule is of returning: wholly where it decides for another reason than the energy."""
    return np.where((sure > 0.0) == returns, sure, np.where(returns, 1.0, -1.0))


def make_guide(name: str, mission: str, known: Known) -> Guide | None:
    """A guide by its name, with the numbers of `homeward.agents.rules.tuned`."""
    if name == NO_GUIDE:
        return None
    return Guide(known, RESERVES[name][mission], PACES[mission] if name == ADAPTIVE else None)


def guide_from(description: Mapping[str, Any], known: Known) -> Guide:
    """The guide that a description tells of.

    Raises:
        ValueError, KeyError, TypeError: It tells of none.
    """
    rule = description["rule"]
    if rule not in (ADAPTIVE, PLANNER):
        raise ValueError(f"rule {rule!r}")
    pace = {name: float(value) for name, value in description["pace"].items()} if rule == ADAPTIVE else None
    return Guide(known, float(description["deviations"]), None if pace is None else Pace(**pace))
