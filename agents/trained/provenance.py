"""Provenance of a policy beside its settings, and differences between an environment and that of its training."""

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
_COMPARED = ("env", "robot", "route", "difficulty", "instruments", "weather", "randomise", "docks", "time_limit_s")


def made_with(options: Options) -> dict[str, str]:
    """Version and hashes of everything that determines the result of training, beside its settings.

    Args:
        options: Options of the environment; contents of robot, instruments and route are hashed, not names or paths.
    """
    known, hidden = constants_of(options)
    # Field by field: between them a record may hold anything.
    route = [hidden.record[name].tobytes() for name in ("fixed", "temperature_c", "wind_mps", "wind_from_rad")]
    return {
        "homeward": homeward.__version__,
        **_code(),
        "robot": robot_hash(known),
        "instruments": _instruments_hash(known),
        "route": _digest(*route),
    }


def robot_hash(known: Known) -> str:
    """Hash of a robot's parameters and effects, without its name and uncertainty.

    A battery of constant voltage is left out: robots had no other when the first policies were trained. So is the
    motors' current at rest, which no environment uses.
    """
    battery = ("chemistry", "cells_in_series", "open_circuit_v") if known.robot.curve.mean_v == 0.0 else ()
    left_out = ("name", "description", "uncertainty", "rest_current_a", *battery)
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


def differences(description: Mapping[str, Any], env: str, options: Options, known: Known) -> list[str]:
    """Differences between an environment and that of a policy's training.

    Shaping and discount affect only the reward, not observation or score, and may differ.

    Args:
        description: Content of `policy.json`; missing entries are ignored.
        env: Id of the environment.
        options: Options of the environment.
        known: Its constants.
    """
    training, code = _mapping(description.get("training")), _mapping(description.get("made_with"))
    here: dict[str, Any] = {"env": env, **vars(options), "docks": text_of(options.docks)}
    if "docks" in training:
        training = {**training, "docks": _docks(training["docks"])}
    different = [name for name in _COMPARED if name in training and str(training[name]) != str(here[name])]
    # By their contents: a file may have changed, or moved.
    for name, numbers in (("robot", robot_hash(known)), ("instruments", _instruments_hash(known))):
        if name in code:
            different = [option for option in different if option != name]
            different += [name] if code[name] != numbers else []
    if _weather(training.get("weather"), training.get("difficulty")) == _weather(options.weather, options.difficulty):
        different = [name for name in different if name != "weather"]
    if "difficulty" in different:  # which the others follow from where they are left to the default
        left = {name for name in ("instruments", "weather") if training.get(name) is None and here[name] is None}
        different = [name for name in different if name not in left]
    sentences = [
        f"{name} {_said(here[name])} (trained with {_trained_with(training, name, here)})" for name in different
    ]
    decision_s, trained_s = float(known.shared["decision_s"][0]), description.get("decision_s", 0.0)
    # Where both are left to the default, it follows from the robot.
    chosen = training.get("decision_s") is not None or options.decision_s is not None or "robot" not in different
    if trained_s and chosen and trained_s != decision_s:
        sentences.append(f"decision_s {decision_s:g} (trained with {trained_s:g})")
    return sentences


def _docks(value: Any) -> str:
    """The text of docks, as they stand in a policy's file."""
    try:
        return text_of(value)
    except DockError:
        return str(value)


def _trained_with(training: Mapping[str, Any], name: str, here: Mapping[str, Any]) -> str:
    trained = training.get(name)
    return "other numbers" if str(trained) == str(here[name]) else _said(trained)


def _said(value: Any) -> str:
    return "the difficulty's" if value is None else str(value)


def _weather(weather: Any, difficulty: Any) -> bool:
    """Whether the weather changes."""
    preset = DIFFICULTY.get(str(difficulty))
    return weather != "still" and (preset is None or preset.weather_changes)


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


@functools.cache
def _code() -> dict[str, str]:
    """Hashes of the source files as first read, because a process keeps what it has loaded."""
    package = Path(homeward.__file__).parent
    agents = package / "agents"
    training = (agents / "learning").glob("*.py")
    parts = {
        "physics": (package / "physics").rglob("*.py"),
        "envs": (package / "envs").glob("*.py"),  # the viewer does not change a policy
        "learner": [*(agents / name for name in _LEARNER), *(package / "estimation").glob("*.py"), *training],
    }
    return {
        part: _digest(*(file.relative_to(package).as_posix().encode() + file.read_bytes() for file in sorted(sources)))
        for part, sources in parts.items()
    }


def _digest(*contents: bytes) -> str:
    return hashlib.sha256(b"\0".join(contents)).hexdigest()[:16]
