"""Inputs of a policy that starts from d_max, beside the observation, and the first policies.

The columns are computed outside the network from the estimates of robot and wind
(`homeward.agents.belief`); none of them is an action of another agent.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.agents import thresholds
from homeward.agents.base import Observations, feature
from homeward.agents.belief import Belief
from homeward.agents.rules.dmax_mapped import MappedDmaxRule
from homeward.agents.rules.pace import NO_SENSING
from homeward.agents.rules.reserves import pace_of, reserve_of
from homeward.agents.rules.turn_back import sees_posts
from homeward.envs.actions import LEVELS, MODES, encode_actions
from homeward.envs.features import GAINS, INDEX, INTEREST_UNIT, NAMES, names_of
from homeward.envs.options import Known
from homeward.envs.state import GO, RETURN, STOP
from homeward.estimation.prior import (
    EAST,
    GAIN,
    GUST_EAST,
    GUST_NORTH,
    NORTH,
    PER_CAPACITY,
    ROLLING,
    WEIGHT,
)
from homeward.physics import ancillary_power

COLUMNS: tuple[tuple[str, str], ...] = (
    (
        "spare",
        "30 times the margin less the reserve of `dmax_belief`, clipped to -1 and 1; less if time is short",
    ),
    (
        "margin",
        "estimated energy left, less that of going on to the next chance to turn and then home",
    ),
    *((f"margin_{gain:g}", f"the same times {gain:g}, clipped to -1 and 1") for gain in GAINS),
    ("deviation", "20 times the standard deviation of the margin"),
    (
        "margin_in_deviations",
        "a quarter of the margin over its standard deviation, clipped to -1 and 2",
    ),
    (
        "way",
        "estimated energy of going on and home over that of the robot's own model, minus 1, clipped to -1 and 1",
    ),
    ("rolling", "estimated energy of rolling over the model's, both of a full battery, minus 1"),
    ("weight", "the same of climbing"),
    ("rest", "the same of all else"),
    ("headwind", "estimated wind against the direction of travel, in 10 m/s"),
    (
        "full",
        "100 times the used share of the memory beyond that at which the rules stop, clipped to -1 and 1",
    ),
    ("to_send", "decisions of standing here that send all samples on board, minus 1, at most 1"),
    (
        "worth",
        "3 times the logarithm of the interest here over the rules' threshold for sensing, clipped to -1 and 1",
    ),
    ("look_back", "1 where `Belief.looks_back` would make an excitation step to estimate the wind"),
)
"""Name and meaning of each column; energies are shares of the usable energy. After a final return
all are 0, because nothing can be decided, which saves half of the time."""
_BELIEVED = tuple(name for name, _ in COLUMNS)
_SPARE = len(NAMES)
_DOCKS = len(NAMES) + len(COLUMNS)  # column from which the features of docks follow
_FLEETING = (
    "power", "speed", "sensing", "temperature", "forecast_east", "forecast_north", "east", "north", "full", "to_send",
    "worth", "look_back",
)  # fmt: skip
"""Inputs that do not predict the end of a mission beyond the potential, like slopes and
interest."""

# Logits of the first policies. Chosen so that other choices are explored occasionally, at a small
# cost: at first cruise has a probability of 93 %, no sensing 83 % (40 % on surveys), a stop 0.7 %
# and a return 1.5 %.
_CRUISE = 4.0
_NO_SENSING = 3.0
_STOP = -3.0
_GO = 2.0
_RETURN = -2.2
_NO_SENSING_ON_SURVEYS = 1.0  # less than elsewhere: a survey scores by sensing
_AGAIN = 12.0
"""Weight of the share of the decisions that make a return final. Without it, an explored return is
hardly ever followed by the others, and the value of a return is not learned. Chosen: after one of
three such decisions, the next has a probability of 45 %, after two 98 %."""
_CRUISE_BY_RULE = 4.0
_NO_SENSING_BY_RULE = 6.0
_STOP_BY_RULE = -3.0
_RETURN_BY_RULE = 10.0
_AGAIN_BY_RULE = 12.0
"""The same if the first policy is the rule; `_RETURN_BY_RULE` is the weight of the negated spare
energy. Chosen: greater, so that the rule is followed."""
_SENSE = 2.5
_WORTH = 4.0
"""On surveys by the rule: weight of the rule's sensing rate, and of no sensing by `worth`. Chosen,
as are the next: the first policy then senses and stops where the rules do."""
_STOP_ON_SURVEYS = -4.0
_STOP_BY_FULL = 4.0
_STOP_BY_TO_SEND = 5.0
_STOP_RETURNING = -20.0
"""Weights of a stop for the radio: constant, by `full`, by `to_send` and on the way home."""
_ANY = 1e-6  # keeps divisors above 0; chosen


class BeliefInputs:
    """Computes the inputs of a policy: the observation, followed by `COLUMNS`.

    Args:
        known: Constants of the environment.
        deviations: Reserve of the rule in standard deviations of the margin.
    """

    def __init__(self, known: Known, deviations: float) -> None:
        self._known = known
        self._deviations = deviations
        # By the file, with nothing sensed.
        self._rule = MappedDmaxRule(known, NO_SENSING, 0.0)
        self._belief = Belief(known, thresholds.MISSED)
        s = known.shared[0]
        idle_w = float(ancillary_power(known.robot, 0.0))
        self._shuttles = bool(s["shuttles"])
        self._sees_posts = sees_posts(known)
        self._pace = pace_of(known.mission)
        # of the memory, at base
        self._sent = float(s["radio_hz"] * s["decision_s"] / s["backlog_limit"])
        sensing_w = (
            float(ancillary_power(known.robot, self._pace.rate * s["max_sensing_hz"])) - idle_w
        )
        # The next chance to turn is the next decision; of a patrol that notices its posts, a lap
        # with its stops away.
        onwards_m = float(s["length_m"] if self._shuttles else s["cruise_mps"] * s["decision_s"])
        onwards_s = onwards_m / float(s["cruise_mps"])
        stops_s = 2.0 * float(s["pit_stop_s"]) if self._shuttles else 0.0
        onwards_j = idle_w * (onwards_s + stops_s) + sensing_w * onwards_s
        self._onwards = {"onwards_m": onwards_m, "onwards_s": onwards_s, "onwards_j": onwards_j}
        self._round_s = 2.0 * onwards_s + stops_s

    @property
    def description(self) -> dict[str, Any]:
        """JSON from which `inputs_from` makes equal inputs."""
        return {"columns": [name for name, _ in COLUMNS], "deviations": self._deviations}

    def __call__(self, observations: Observations, begun: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Inputs, float32, shape (n, features + columns); arguments as in
        `homeward.agents.base.Policy.act`.

        A repeated observation counts once. Features of docks come last.
        """
        going = feature(observations, "returning") < 1.0
        inputs = np.zeros((len(observations), observations.shape[1] + len(COLUMNS)), np.float32)
        inputs[:, : len(NAMES)] = observations[:, : len(NAMES)]
        inputs[:, _DOCKS:] = observations[:, len(NAMES) :]
        self._belief.learn(observations, begun, going)
        # After a final return nothing is decided: the columns of the belief stay 0.
        inputs[going, _SPARE:_DOCKS] = self._believed(observations, going)[going]
        return inputs

    def forget_forecast(self) -> None:
        """Ignore the forecast of the wind, whatever missions observe; to be called before they
        begin."""
        self._belief.forget_forecast()

    def recharge(self, soc: float) -> None:
        """Set another state of charge at the start of missions, 0 to 1; to be called after the
        first call."""
        self._belief.recharge(soc)

    def _margin(
        self, observations: Observations, margin: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """A margin; less if time is short, negative at the end of the route, and 1 between
        posts."""
        s = self._known.shared[0]
        distance_m = feature(observations, "distance") * s["reach_m"]
        left_s = (1.0 - feature(observations, "time")) * s["max_decisions"] * s["decision_s"]
        home_s = thresholds.HOME_TIME * (distance_m / s["cruise_mps"] + self._round_s)
        decisions_left = (left_s - home_s) / s["decision_s"]
        # A decision consumes 0.5 % of the battery at cruise; chosen: twice that, as it may also
        # sense.
        margin = np.minimum(margin, 0.01 * decisions_left)
        if self._sees_posts:
            return np.where(distance_m <= 0.0, margin, 1.0)
        ends = np.asarray(distance_m >= thresholds.AT_END * s["length_m"]) & (not self._shuttles)
        return np.where(ends, -1.0, margin)

    def _believed(
        self, observations: Observations, going: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        s = self._known.shared[0]
        belief = self._belief
        plans = belief.plans(observations)
        modelled = plans["home_cost_j"] / s["usable_j"]
        plans["home_cost_j"][~going] = np.nan
        for name, value in self._onwards.items():
            plans[name] = value
        total = belief.margin(plans, 0.0).total
        margin = total["margin_j"] / s["usable_j"]
        deviation = total["margin_sd_j"] / s["usable_j"]
        way = total["cost_j"] / s["usable_j"]
        mean = belief.estimator.mean()
        ratios = mean[:, [ROLLING, WEIGHT, GAIN]] * mean[:, [PER_CAPACITY]] - 1.0
        headwind_mps = (mean[:, EAST] + mean[:, GUST_EAST]) * feature(observations, "east")
        headwind_mps += (mean[:, NORTH] + mean[:, GUST_NORTH]) * feature(observations, "north")
        above_reserve = self._margin(observations, margin - self._deviations * deviation)
        by_file = modelled + self._rule.cost_of_going_on(observations)
        backlog = feature(observations, "backlog")
        sent = np.maximum(self._sent * feature(observations, "link"), _ANY)
        threshold = max(self._pace.interest, _ANY)
        interest = np.maximum(INTEREST_UNIT * feature(observations, "interest"), _ANY)
        # In the order of `COLUMNS`.
        columns = (
            np.clip(30.0 * above_reserve, -1.0, 1.0),
            margin,
            *(np.clip(gain * margin, -1.0, 1.0) for gain in GAINS),
            20.0 * deviation,
            np.clip(0.25 * margin / np.maximum(deviation, 1e-6), -1.0, 2.0),
            np.clip(way / by_file - 1.0, -1.0, 1.0),
            *ratios.T,
            0.1 * headwind_mps,
            np.clip(100.0 * (backlog - self._pace.full), -1.0, 1.0),
            np.minimum(backlog / sent - 1.0, 1.0),
            np.clip(3.0 * np.log(interest / threshold), -1.0, 1.0),
            belief.looks_back(observations),
        )
        return np.stack(columns, axis=1)


def make_inputs(known: Known) -> BeliefInputs:
    """Inputs with the reserve of the rule `dmax_belief` (`homeward.agents.rules.reserves`)."""
    return BeliefInputs(known, reserve_of("dmax_belief", known.mission))


def inputs_from(description: Mapping[str, Any], known: Known) -> BeliefInputs:
    """The inputs of a description.

    Raises:
        ValueError, KeyError, TypeError: It has none, or those of another version.
    """
    if description["columns"] != [name for name, _ in COLUMNS]:
        raise ValueError("other columns than this version has")
    return BeliefInputs(known, number(description["deviations"]))


def number(value: Any) -> float:
    """A finite number of a file, which may hold integers of any length, texts or infinities.

    Raises:
        ValueError: It is none.
    """
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not abs(value) <= sys.float_info.max
    ):
        raise ValueError(f"{value!r} is not a finite number"[:100])
    return float(value)


def valued(known: Known) -> NDArray[np.bool_]:
    """Which inputs, with the belief, the value sees, shape (inputs,): from the others it would
    learn noise."""
    fleeting = (*_FLEETING, "interest", "grade")
    steady = (
        name not in fleeting and not name.startswith(("interest_", "grade_"))
        for name in NAMES + _BELIEVED + _docks_of(known)
    )
    return np.fromiter(steady, np.bool_)


def _docks_of(known: Known) -> tuple[str, ...]:
    """Names of the features of docks, none without docks."""
    return names_of(bool(known.shared["dock_count"][0]))[len(NAMES) :]


def first_policy(
    known: Known, inputs: BeliefInputs | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Weight (outputs, inputs) and bias (outputs,) of the policy that training starts from.

    With `inputs` it turns back as the d_max rule does, by the belief: where `spare` is negative. On
    a survey it senses and stops for the radio as the rules do. Without `inputs` it has no knowledge
    of energy: it cruises, mostly without sensing, occasionally tries a return or a stop, and
    continues a return that it has begun.

    Args:
        known: Constants of the environment.
        inputs: Inputs of the policy; only the observation if None.
    """
    columns = len(NAMES) + len(_docks_of(known))
    if inputs is not None:
        columns += len(COLUMNS)
    survey = pace_of(known.mission).rate > 0.0
    build = _discrete if known.shared["discrete"][0] else _continuous
    weight, bias = build(known, columns, survey, by_rule=inputs is not None)
    return weight.astype(np.float32), bias.astype(np.float32)


def _column(name: str) -> int:
    """Index of a column of the belief among the inputs."""
    return len(NAMES) + _BELIEVED.index(name)


def _discrete(
    known: Known, columns: int, survey: bool, by_rule: bool
) -> tuple[NDArray[Any], NDArray[Any]]:
    outputs = 2 * LEVELS + len(MODES)
    weight = np.zeros((outputs, columns))
    bias = np.zeros(outputs)
    cruise = int(encode_actions(known, float(known.shared["cruise_mps"][0]), 0.0, GO)[0, 0])
    stop = 2 * LEVELS + STOP
    go = 2 * LEVELS + GO
    back = 2 * LEVELS + RETURN
    no_sensing = LEVELS
    returning = INDEX["returning"]
    if not by_rule:
        bias[cruise] = _CRUISE
        bias[no_sensing] = _NO_SENSING
        if survey:
            bias[no_sensing] = _NO_SENSING_ON_SURVEYS
        bias[stop] = _STOP
        bias[go] = _GO
        bias[back] = _RETURN
        weight[back, returning] = _AGAIN
        return weight, bias
    bias[cruise] = _CRUISE_BY_RULE
    bias[no_sensing] = _NO_SENSING_BY_RULE
    bias[stop] = _STOP_BY_RULE
    weight[back, _SPARE] = -_RETURN_BY_RULE
    weight[back, returning] = _AGAIN_BY_RULE
    if survey:
        sense = LEVELS + round((LEVELS - 1) * pace_of(known.mission).rate)
        bias[no_sensing] = _SENSE
        bias[sense] = _SENSE
        weight[no_sensing, _column("worth")] = -_WORTH
        bias[stop] = _STOP_ON_SURVEYS
        weight[stop, _column("full")] = _STOP_BY_FULL
        weight[stop, _column("to_send")] = _STOP_BY_TO_SEND
        weight[stop, returning] = _STOP_RETURNING
    return weight, bias


def _continuous(
    known: Known, columns: int, survey: bool, by_rule: bool
) -> tuple[NDArray[Any], NDArray[Any]]:
    weight = np.zeros((3, columns))
    bias = np.zeros(3)
    bias[:2] = encode_actions(known, float(known.shared["cruise_mps"][0]), 0.0, GO)[0, :2]
    if by_rule:
        # Each mode has a third of [-1, 1]: stop, go and return.
        weight[2, _SPARE] = -1.0 / 3.0
        weight[2, INDEX["returning"]] = 1.0
        bias[2] = 1.0 / 3.0
        if survey:
            bias[1] = 0.0
    return weight, bias
