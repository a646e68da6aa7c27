"""Provenance of a policy beside its settings, and differences between an environment and that of
its training."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import homeward
from homeward.envs.conditions.difficulty import DIFFICULTY
from homeward.envs.conditions.gauges import COUNTER
from homeward.envs.docks import DockError, text_of
from homeward.envs.options import Known, Options, constants_of

_LEARNER = (
    "trained/inputs.py",
    "belief.py",
    "rules/dmax_mapped.py",
    "rules/pace.py",
    "rules/turn_back.py",
    "rules/reserves.py",
    "thresholds.py",
)
_COMPARED = (
    "env",
    "robot",
    "route",
    "difficulty",
    "instruments",
    "weather",
    "randomise",
    "docks",
    "time_limit_s",
)


def made_with(options: Options) -> dict[str, str]:
    """Version and hashes of everything that determines the result of training, beside its settings.

    Args:
        options: Options of the environment; contents of robot, instruments and route are hashed,
            not names or paths.
    """
    known, hidden = constants_of(options)
    # Field by field: between them a record may hold anything.
    route = [
        hidden.record[name].tobytes()
        for name in ("fixed", "temperature_c", "wind_mps", "wind_from_rad")
    ]
    return {
        "homeward": homeward.__version__,
        **_code(),
        "robot": robot_hash(known),
        "instruments": _instruments_hash(known),
        "route": _digest(*route),
    }


def robot_hash(known: Known) -> str:
    """Hash of a robot's parameters and effects, without its name and uncertainty.

    A battery of constant voltage is left out: robots had no other when the first policies were
    trained. So are a cut-off that the model does not use, and the motors' current at rest, which no
    environment uses.
    """
    left_out = ["name", "description", "uncertainty", "rest_current_a"]
    if known.robot.curve.mean_v == 0.0:
        left_out += ["chemistry", "cells_in_series", "open_circuit_v"]
    if not known.robot.has_cutoff:
        left_out.append("cutoff_v")
    values = {
        field.name: getattr(known.robot, field.name)
        for field in dataclasses.fields(known.robot)
        if field.name not in left_out
    }
    return _digest(json.dumps(values, sort_keys=True, default=dict).encode())


def _instruments_hash(known: Known) -> str:
    sizes = dataclasses.asdict(known.instruments)
    if sizes["gauges"] == (COUNTER,):
        del sizes["gauges"]  # there was no other when the first policies were trained
    return _digest(json.dumps(sizes, sort_keys=True).encode())


def differences(
    description: Mapping[str, Any], env: str, options: Options, known: Known
) -> list[str]:
    """Differences between an environment and that of a policy's training.

    Shaping and discount affect only the reward, not observation or score, and may differ.

    Args:
        description: Content of `policy.json`; missing entries are ignored.
        env: Id of the environment.
        options: Options of the environment.
        known: Its constants.
    """
    training = dict(_mapping(description.get("training")))
    if "docks" in training:
        training["docks"] = _docks(training["docks"])
    present: dict[str, Any] = {"env": env, **vars(options), "docks": text_of(options.docks)}
    hashes = _mapping(description.get("made_with"))
    different = _different(training, present, hashes, known)
    sentences = [
        f"{name} {_said(present[name])} (trained with {_trained_with(training, name, present)})"
        for name in different
    ]
    decision_s = float(known.shared["decision_s"][0])
    trained_s = description.get("decision_s", 0.0)
    # Where both are left to the default, it follows from the robot.
    by_default = training.get("decision_s") is None and options.decision_s is None
    follows = by_default and "robot" in different
    if trained_s and not follows and trained_s != decision_s:
        sentences.append(f"decision_s {decision_s:g} (trained with {trained_s:g})")
    return sentences


def _different(
    training: Mapping[str, Any], present: Mapping[str, Any], hashes: Mapping[str, Any], known: Known
) -> list[str]:
    """Names of the options in which an environment differs from that of the training.

    Args:
        training: Options of the training; missing ones are ignored.
        present: Those of the environment.
        hashes: Hashes of the training's files.
        known: Constants of the environment.
    """
    # Robot and instruments by their contents, where those are known: a file may have changed, or
    # moved.
    present_hashes = {"robot": robot_hash(known), "instruments": _instruments_hash(known)}
    by_content = [name for name in present_hashes if name in hashes]
    by_text = [name for name in _COMPARED if name in training and name not in by_content]
    different = [name for name in by_text if str(training[name]) != str(present[name])]
    different += [name for name in by_content if hashes[name] != present_hashes[name]]
    if _weather_changes(training) == _weather_changes(present):
        different = [name for name in different if name != "weather"]
    if "difficulty" in different:  # which the others follow from where they are left to the default
        by_default = {
            name
            for name in ("instruments", "weather")
            if training.get(name) is None and present[name] is None
        }
        different = [name for name in different if name not in by_default]
    return different


def _docks(value: Any) -> str:
    """The text of docks, as they stand in a policy's file."""
    try:
        return text_of(value)
    except DockError:
        return str(value)


def _trained_with(training: Mapping[str, Any], name: str, present: Mapping[str, Any]) -> str:
    trained = training.get(name)
    if str(trained) == str(present[name]):
        return "other numbers"
    return _said(trained)


def _said(value: Any) -> str:
    if value is None:
        return "the difficulty's"
    return str(value)


def _weather_changes(options: Mapping[str, Any]) -> bool:
    """Whether the weather changes in an environment of these options."""
    preset = DIFFICULTY.get(str(options.get("difficulty")))
    return options.get("weather") != "still" and (preset is None or preset.weather_changes)


def _mapping(value: Any) -> Mapping[str, Any]:
    if isinstance(value, Mapping):
        return value
    return {}


@functools.cache
def _code() -> dict[str, str]:
    """Hashes of the source files as first read, because a process keeps what it has loaded."""
    package = Path(homeward.__file__).parent
    agents = package / "agents"
    training = (agents / "learning").glob("*.py")
    parts = {
        "physics": (package / "physics").rglob("*.py"),
        "envs": (package / "envs").glob("*.py"),  # the viewer does not change a policy
        "learner": [
            *(agents / name for name in _LEARNER),
            *(package / "estimation").glob("*.py"),
            *training,
        ],
    }
    return {
        part: _digest(
            *(
                file.relative_to(package).as_posix().encode() + file.read_bytes()
                for file in sorted(sources)
            )
        )
        for part, sources in parts.items()
    }


def _digest(*contents: bytes) -> str:
    return hashlib.sha256(b"\0".join(contents)).hexdigest()[:16]
