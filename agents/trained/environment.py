"""The environment of a policy's training, from its file."""

from __future__ import annotations

import dataclasses
from typing import Any

from homeward.agents.trained.policy_file import NetworkPolicy, PolicyFileError
from homeward.agents.trained.provenance import robot_hash
from homeward.envs import IDS
from homeward.envs.options import Known, Options, known_of


def options_of(policy: NetworkPolicy, **keywords: Any) -> Options:
    """Keywords of the environment of a policy's training.

    Args:
        policy: The policy.
        **keywords: Keywords to use instead of those of the training.

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
    of_training = {name: value for name, value in training.items() if name in names}
    return Options(missions[training["env"]], **of_training | keywords)


def setting_of(policy: NetworkPolicy, robot: str | None = None) -> tuple[Options, Known]:
    """The environment of a policy's training, from its description.

    Args:
        policy: The policy.
        robot: Robot file to use instead of the one that the description names.

    Raises:
        PolicyFileError: The description lacks it, or the robot is not that of the training.
        OptionError, RobotError, RouteError: Its content is invalid.
    """
    keywords = {}
    if robot is not None:
        keywords["robot"] = robot
    options = options_of(policy, **keywords)
    known = known_of(options)
    made_with = policy.description.get("made_with")
    own_hash = robot_hash(known)
    if isinstance(made_with, dict) and made_with.get("robot", own_hash) != own_hash:
        raise PolicyFileError(
            f"robot {str(options.robot)!r} has other parameters than that of the policy's training: "
            "give the file of that one with --robot, or train again"
        )
    return options, known
