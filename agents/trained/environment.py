"""The environment of a policy's training, from its file."""

from __future__ import annotations

import dataclasses
from typing import Any

from homeward.agents.trained.policy_file import NetworkPolicy, PolicyFileError
from homeward.agents.trained.provenance import robot_hash
from homeward.envs import IDS
from homeward.envs.options import Known, Options, known_of


def options_of(policy: NetworkPolicy, **other: Any) -> Options:
    """Keywords of the environment of a policy's training.

    Args:
        policy: The policy.
        **other: Keywords to use instead of those of the training.

    Raises:
        PolicyFileError: The description lacks it.
        OptionError: Its content is invalid.
    """
    training = policy.description.get("training")
    missions = {env_id: mission for mission, env_id in IDS.items()}
    if not isinstance(training, dict) or str(training.get("env")) not in missions:
        raise PolicyFileError(
            "policy.json does not say which environment the policy was trained in: train it with `homeward train`"
        )
    names = {field.name for field in dataclasses.fields(Options)} - {"mission"}
    keywords = {name: value for name, value in training.items() if name in names}
    return Options(missions[training["env"]], **keywords | other)


def setting_of(policy: NetworkPolicy, robot: str | None = None) -> tuple[Options, Known]:
    """The environment of a policy's training, from its description.

    Args:
        policy: The policy.
        robot: Robot file to use instead of the one that the description names.

    Raises:
        PolicyFileError: The description lacks it, or the robot is not that of the training.
        OptionError, RobotError, RouteError: Its content is invalid.
    """
    options = options_of(policy, **({} if robot is None else {"robot": robot}))
    known = known_of(options)
    made_with = policy.description.get("made_with")
    if isinstance(made_with, dict) and made_with.get("robot", robot_hash(known)) != robot_hash(known):
        raise PolicyFileError(
            f"robot {str(options.robot)!r} has other parameters than that of the policy's training: "
            "give the file of that one with --robot, or train again"
        )
    return options, known
