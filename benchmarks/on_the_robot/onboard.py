"""What a policy on a robot loses without forecasts, a map or the temperature, and by following
`turn_now`.

`python benchmarks/on_the_robot/onboard.py` drives missions of an environment by a policy that
ships, asked through `homeward.companion.Companion(policy=...)` with what the environment's
instruments read. Beforehand it is given all that the environment's agents know, the forecast of the
wind alone, or nothing, and nothing while it follows `turn_now`. It prints what docs/results.md
quotes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# as a script, it does not see the folder above its own
sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.tables import rate, table
from homeward import cli
from homeward.agents.learning.settings import DMAX
from homeward.agents.onboard import Onboard
from homeward.agents.registry import shipped
from homeward.agents.trained.policy_file import load_policy
from homeward.companion import Companion
from homeward.envs import IDS
from homeward.envs.actions import MODES, encode_actions
from homeward.envs.options import OptionError
from homeward.envs.state import RETURN
from tests.envs.conditions.reading import ReadRobot

GIVEN = ("all", "the wind", "nothing", "nothing, and heeds turn_now")
"""What the policy is given beforehand."""


@dataclass(frozen=True)
class Args:
    """What to drive."""

    env: str = "OutAndBack"
    """OutAndBack, Survey or Patrol."""
    missions: int = 200
    """Missions."""
    seed: int = 9_500_001
    """Seed of the first mission; nothing was trained or tuned on these."""


def driven(args: Args, given: str) -> Iterator[tuple[float, bool]]:
    """Score of each mission, and whether the robot stranded."""
    for seed in range(args.seed, args.seed + args.missions):
        robot = ReadRobot(args.env, seed)
        known = robot.env.batch.known
        is_over = False
        route, wind_mps, mean_grade = robot.prior_knowledge()
        policy = load_policy(shipped(args.env, DMAX), known)
        knows_wind = given in ("all", "the wind")
        knows_all = given == "all"
        onboard = Onboard(
            policy,
            known,
            route if knows_all else None,
            wind_mps if knows_wind else None,
            mean_grade if knows_all else None,
        )
        companion = Companion(known.robot, policy=onboard, window_s=onboard.decision_s)
        home = encode_actions(known, known.shared["cruise_mps"][0], 0.0, RETURN)[0]
        while not is_over:
            reads = robot.reads()
            if knows_all:
                for seen in robot.seen_ahead():
                    onboard.see(*seen)
            else:
                reads |= {"temperature_c": None, "interest": None}
            advice = companion.update(robot.time_s, **reads)
            action = home
            if advice.action is not None and not (given.endswith("turn_now") and advice.turn_now):
                speed_mps, sensing_hz, mode = advice.action
                action = encode_actions(known, speed_mps, sensing_hz, MODES.index(mode))[0]
            is_over = robot.drive(action)
        m = robot.env.batch.records[0]
        yield float(m["score"]) if m["home"] else 0.0, bool(m["depleted"])


def main(args: Args) -> None:
    """Drive, and print.

    Raises:
        OptionError: An argument cannot be used.
    """
    if args.env not in IDS or args.missions < 1:
        raise OptionError(f"give --env of {', '.join(IDS)}, and at least 1 of --missions")
    title = f"{args.missions} missions of {args.env}, uncertain, seeds from {args.seed}"
    shown = table(title, ("given",), ("mean score", "stranded (95 %)"))
    for given in GIVEN:
        scores, stranded = np.array(list(driven(args, given))).T
        count = int(stranded.sum())
        shown.add_row(
            given, f"{scores.mean():.5g}", f"{count}, {rate(count, args.missions, '.1%')}"
        )
    cli.Terminal().show(shown)


if __name__ == "__main__":
    sys.exit(cli.run(main, Args, __doc__, (OptionError,)))
