"""A trained policy on a robot: evaluated once per decision, on the observation of its environment
made from readings.

`homeward.companion.Companion(policy=load_onboard("ppo", "OutAndBack"))` evaluates it with its
updates; without a companion, `Onboard.update` does the same.
"""

from __future__ import annotations

import base64
import math
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from homeward.agents.base import Policy
from homeward.agents.learning.settings import DMAX, SCRATCH
from homeward.agents.registry import FROM_FILES, AgentError, shipped
from homeward.agents.trained.environment import options_of
from homeward.agents.trained.inputs import BeliefInputs
from homeward.agents.trained.onnx_policy import load_onnx
from homeward.agents.trained.policy_file import load_policy
from homeward.envs import IDS
from homeward.envs.actions import MODES, decode_actions, encode_actions
from homeward.envs.features import FEATURES, INDEX
from homeward.envs.observer import Observer, Read
from homeward.envs.options import Known, known_of
from homeward.envs.routes import Route, load_route
from homeward.envs.state import GO
from homeward.physics import Robot
from homeward.physics.battery import energy_share
from homeward.physics.jit import announce_compilation

Action = tuple[float, float, str]
"""Speed (m/s, 0 where it stops), sensing rate (Hz), and `stop`, `go` or `return`; no `go` once a
return is final."""

_MOST_BYTES = 100_000_000  # of an unpacked state; chosen: bounds the memory for a damaged text
_SOON = 1e-6
"""Share of a decision by which a reading may be too early to end it: times are rounded. Chosen:
above the rounding of seconds since 1970 in double precision for decisions of a second and more."""


class Onboard:
    """Evaluates a policy once per `decision_s`, and keeps the state in between.

    The mission is that of the environment: it begins at home with the first reading, a return is
    final once it was chosen in several decisions in a row, and a patrol stands at its posts for the
    pit stop.

    Args:
        policy: A `homeward.agents.Policy` for the environment of `known`.
        known: Constants of that environment, such as decisions, distances and times.
        forecast: The route as forecast, see `homeward.envs.observer.Observer`.
        forecast_mps: Forecast of the wind: components towards where it comes from, east and north,
            m/s. By default the belief allows any wind, and a policy without a belief assumes calm.
        mean_grade: Mean sine of the route's slope; by default that of the forecast.

    Attributes:
        robot: The robot of the environment.
        decision_s: Time between decisions, s.

    Raises:
        ValueError: The forecast has other places than the environment.
    """

    def __init__(
        self,
        policy: Policy,
        known: Known,
        forecast: Route | None = None,
        forecast_mps: tuple[float, float] | None = None,
        mean_grade: float | None = None,
    ) -> None:
        self._policy = policy
        self.known = known
        self._forecasts = forecast, forecast_mps or (0.0, 0.0), mean_grade
        inputs = getattr(policy, "inputs", None)
        self._beliefs: BeliefInputs | None = None
        if isinstance(inputs, BeliefInputs):
            self._beliefs = inputs
            if forecast_mps is None:
                inputs.forget_forecast()
        self.robot: Robot = known.robot
        self.decision_s = float(known.shared["decision_s"][0])
        self._most = int(known.shared["max_decisions"][0])
        self.begin()
        for time_s in (0.0, 1.0):  # compile its kernels
            self.update(time_s * self.decision_s, 0.0)
        self.begin()

    def begin(self) -> None:
        """Begin a mission with the next reading, as after a swap of the battery."""
        self._observer = Observer(self.known, *self._forecasts)
        self._observations: list[NDArray[np.float32]] = []
        self._action = encode_actions(self.known, 0.0, 0.0, GO)
        self._due_s = math.nan
        self._time_s = math.nan
        self._position_m = 0.0
        self._outwards = True
        self._energy_j = 0.0
        self._read_s = 0.0

    def see(
        self, position_m: float, grade_rad: float = math.nan, interest: float = math.nan
    ) -> None:
        """Store what the robot sees of a place ahead, better than the forecast.

        Args:
            position_m: Position, m from home along the route.
            grade_rad: Slope along the way out, rad.
            interest: Its interest, a weight.
        """
        self._observer.see(position_m, grade_rad, interest)

    def update(
        self,
        time_s: float,
        position_m: float,
        *,
        speed_mps: float = math.nan,
        power_w: float = math.nan,
        soc: float = math.nan,
        grade_rad: float = math.nan,
        heading_rad: float = math.nan,
        temperature_c: float = math.nan,
        interest: float = math.nan,
    ) -> Action | None:
        """Process the readings of a moment, NaN where an instrument was not read, and return the
        present command.

        Args:
            time_s: Time, s, later than before.
            position_m: Metres from home along the way.
            speed_mps: Speed, m/s.
            power_w: Mean power out of the battery since the reading before, W.
            soc: State of charge, 0 to 1: a share of charge, as gauges show it.
            grade_rad: Slope in the direction of travel, rad, uphill positive.
            heading_rad: Direction of travel, rad counter-clockwise from east.
            temperature_c: Air temperature, C.
            interest: Interest here, a weight.

        Returns:
            Speed (m/s), sensing rate (Hz) and mode, until the next decision; None if the mission is
            over.
        """
        is_first = math.isnan(self._due_s)
        if math.isfinite(power_w) and not is_first:
            since_s = time_s - self._time_s
            self._energy_j += power_w * since_s
            self._read_s += since_s
        moved_m = position_m - self._position_m
        if moved_m:
            self._outwards = moved_m > 0.0
        if moved_m or is_first:
            # Slope and heading of the way are those on the way out.
            if not self._outwards:
                grade_rad = -grade_rad
                heading_rad += math.pi
            self._observer.see(position_m, grade_rad, interest, heading_rad, self._outwards)
        else:  # a standing robot may have turned round, and reads no other slope
            self._observer.see(position_m, interest=interest, outwards=self._outwards)
        soc = float(energy_share(self.robot.curve, soc))
        read = Read(position_m, soc=soc, speed_mps=speed_mps, temperature_c=temperature_c)
        if is_first:
            self._due_s = time_s + self.decision_s
            self._time_s = time_s
            self._ask(self._observer.begin(read))
        self._follow(time_s, read)
        self._time_s = time_s
        self._position_m = position_m
        return self.action

    def _follow(self, time_s: float, read: Read) -> None:
        """Decide as often as is due: several times after a gap in the readings."""
        due = math.floor((time_s - self._due_s) / self.decision_s + _SOON) + 1
        if due <= 0:
            return
        power_w = math.nan
        if self._read_s:
            power_w = self._energy_j / self._read_s
        self._energy_j = 0.0
        self._read_s = 0.0
        for remaining in range(min(due, self._most), 0, -1):
            if self.action is None:
                return
            # Where the robot was when the decision was due, between the reading before and this
            # one.
            share = min((self._due_s - self._time_s) / (time_s - self._time_s) + _SOON, 1.0)
            position_m = read.position_m
            if share < 1.0:
                position_m = self._position_m + share * (read.position_m - self._position_m)
            reading = Read(position_m)
            if remaining == 1:
                reading = read
            reading = reading._replace(position_m=position_m, power_w=power_w)
            self._ask(self._observer.decide(self._action, reading))
            self._due_s += self.decision_s

    def _ask(self, observation: NDArray[np.float32]) -> None:
        """Pass an observation to the policy, and store its command."""
        begun = not self._observations
        self._observations.append(observation)
        self._action = self._policy.act(observation, np.array([begun]))
        soc = float(observation[0, INDEX["energy"]])
        if begun and soc < 1.0 and self._beliefs is not None:
            self._beliefs.recharge(soc)

    @property
    def action(self) -> Action | None:
        """The present command, see `update`; None also before the first reading."""
        if not self._observations or len(self._observations) > self._most or self._observer.home:
            return None
        commands = decode_actions(self.known, self._action)
        mode = MODES[int(commands.mode[0])]
        if mode == "go" and self._observer.returning:
            mode = "return"
        return float(commands.driven_mps[0]), float(commands.sensing_hz[0]), mode

    def state(self) -> dict[str, Any]:
        """State for a restart, for JSON: some tens of kilobytes."""
        observations = b"".join(observation.tobytes() for observation in self._observations)
        return {
            "observer": _packed(self._observer.state()), "observations": _packed(observations),
            "due_s": self._due_s, "time_s": self._time_s, "position_m": self._position_m, "outwards": self._outwards,
            "energy_j": self._energy_j, "read_s": self._read_s,
        }  # fmt: skip

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from `state`, with the same arguments: past observations are passed to the
        policy again.

        Raises:
            KeyError, TypeError, ValueError, zlib.error: The state is invalid, or of other
                arguments.
        """
        self.begin()
        self._observer.restore(_unpacked(state["observer"]))
        for row in np.frombuffer(_unpacked(state["observations"]), np.float32).reshape(
            -1, 1, len(FEATURES)
        ):
            self._ask(row)
        for name in ("due_s", "time_s", "position_m", "energy_j", "read_s"):
            setattr(self, f"_{name}", float(state[name]))
        self._outwards = bool(state["outwards"])


def load_onboard(
    policy: str | Path,
    mission: str | None = None,
    *,
    robot: str | Path | Robot | None = None,
    route: str | Path | Route | None = None,
    forecast_mps: tuple[float, float] | None = None,
) -> Onboard:
    """A trained policy, ready for a robot.

    Args:
        policy: `ppo` or `ppo_scratch` (shipped), the folder that `train.py` wrote, or a file that
            `homeward.agents.trained.onnx_export` wrote.
        mission: `OutAndBack`, `Survey` or `Patrol`, for a shipped policy.
        robot: Preset name, path of a robot file, or a `Robot`; by default that of the training.
            With another robot the policy is used outside its training.
        route: The route as forecast: path of a profile or track, or a `Route`. By default flat,
            with the length and the mean interest of generated routes.
        forecast_mps: Forecast of the wind, see `Onboard`.

    Raises:
        AgentError: The policy does not exist.
        PolicyFileError, OptionError, RobotError, RouteError: Its file or another argument is
            invalid.

    >>> onboard = load_onboard("ppo", "OutAndBack")
    >>> onboard.robot.name, onboard.decision_s
    ('rusti_computer', 30.0)
    >>> onboard.update(0.0, 0.0, soc=1.0)  # top speed, nothing sensed
    (1.0, 0.0, 'go')
    """
    announce_compilation()
    if str(policy) in FROM_FILES:
        if mission not in IDS:
            raise AgentError(f"mission = {mission!r} is not allowed; choose from {', '.join(IDS)}")
        start = SCRATCH if str(policy) == f"ppo_{SCRATCH}" else DMAX
        policy = shipped(mission, start)
    options: dict[str, Any] = {}
    if robot is not None:
        options["robot"] = robot
    loaded, known = _load(policy, options)
    forecast = None
    if route is not None:
        if not isinstance(route, Route):
            route = load_route(route, float(known.shared["place_m"][0]))
        forecast = route
        loaded, known = _load(policy, options | {"route": forecast})
    return Onboard(loaded, known, forecast, forecast_mps)


def _load(policy: str | Path, options: dict[str, Any]) -> tuple[Policy, Known]:
    """A policy and constants of its environment, with some keywords changed from those of its
    training."""
    if Path(policy).suffix == ".onnx":
        return load_onnx(policy, **options)
    known = known_of(options_of(load_policy(policy), **options))
    return load_policy(policy, known), known


def _packed(content: bytes) -> str:
    return base64.b85encode(zlib.compress(content, 9)).decode()


def _unpacked(text: str) -> bytes:
    return zlib.decompressobj().decompress(base64.b85decode(text), _MOST_BYTES)
