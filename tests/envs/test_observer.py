"""What a robot makes of its readings is what the environment shows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from homeward.envs.observer import Observer, Read
from tests.envs.conditions.reading import ReadRobot


def follow(robot: ReadRobot, observer: Observer, seed: int, most: int = 150) -> int:
    """Drive at random, with stops and returns now and then; every observation is to be the
    environment's."""
    rng, over, decisions = np.random.default_rng(seed), False, 0
    action: Any = None
    while not over and decisions < most:
        reads = robot.reads()
        outwards, slope = (
            robot.outwards,
            reads["grade_rad"] if robot.outwards else -reads["grade_rad"],
        )
        heading = reads["heading_rad"] + (0.0 if outwards else np.pi)
        observer.see(reads["position"], slope, reads["interest"], heading, outwards)
        for seen in robot.seen_ahead():
            observer.see(*seen)
        read = Read(
            *(reads[name] for name in ("position", "power_w", "soc", "speed_mps", "temperature_c"))
        )
        made = observer.begin(read) if action is None else observer.decide(action, read)
        np.testing.assert_allclose(made[0], robot.observation, rtol=2e-6, atol=2e-6)
        mode = rng.choice(3, p=[0.1, 0.75, 0.15])
        action = np.array([[rng.integers(5), rng.integers(5), mode]])
        if observer.known.shared["discrete"][0] == 0:
            action = np.array([[*rng.uniform(-1.0, 1.0, 2), (mode - 1.0) * 2.0 / 3.0]], np.float32)
        over, decisions = robot.drive(action[0]), decisions + 1
    return decisions


@pytest.mark.parametrize(
    ("mission", "options"),
    [
        ("OutAndBack", {"difficulty": "harsh", "robot": "husky"}),
        ("Survey", {"action_type": "continuous", "instruments": "exact"}),
        ("Survey", {"difficulty": "harsh", "decision_s": 100.0}),
        ("Patrol", {"decision_s": 50.0}),
    ],
)
def test_it_makes_the_observations_of_the_environment(
    mission: str, options: dict[str, Any]
) -> None:
    lengths = []
    for seed in range(4):
        robot = ReadRobot(mission, 8_100_001 + seed, **options)
        lengths.append(
            follow(robot, Observer(robot.env.batch.known, *robot.prior_knowledge()), seed)
        )
    assert max(lengths) > 20


def test_a_restored_one_goes_on_alike_and_refuses_what_is_of_another() -> None:
    robot = ReadRobot("Survey")
    one, other = (Observer(robot.env.batch.known, *robot.prior_knowledge()) for _ in range(2))
    follow(robot, one, 0, most=10)
    other.restore(one.state())
    action, read = np.array([[2, 2, 1]]), Read(50.0, 9.0, 0.98, 0.5, 10.0)
    np.testing.assert_array_equal(one.decide(action, read), other.decide(action, read))
    with pytest.raises(ValueError, match="another version or of another route"):
        Observer(ReadRobot("Patrol").env.batch.known).restore(one.state())
