"""An effect of one's own, from a Python file beside the project (`homeward.own_effects`)."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

from homeward import loading
from homeward.own_effects import own_file
from homeward.physics.effects.base import Effect, Parameter

_NEXT = {
    "force": "slip",
    "drive": "copper_loss",
    "ancillary": "intermittent_load",
    "battery": "breakaway",
}
"""Effect before which one of one's own acts, by its kind."""
_KINDS = tuple(_NEXT)


class OwnEffectError(ImportError):
    """A file with an effect of one's own that cannot be used."""


def with_own(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """All effects, with that of one's own before others of its kind that change what came before
    them.

    Loads add up in order: slip and losses of a start follow what they act on. Without a file they
    are as they are.

    Raises:
        OwnEffectError: The file cannot be used. A command of this project ends with a line instead.
    """
    path = own_file()
    if path is None:
        return effects
    try:
        own_effect = _loaded(path, {effect.id for effect in effects})
    except OwnEffectError as error:
        program = loading.program()
        if program is None:
            raise
        print(f"{program}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    next_id = _NEXT[own_effect.kind]
    place = [effect.id for effect in effects].index(next_id)
    return (*effects[:place], own_effect, *effects[place:])


def _loaded(path: Path, taken_ids: set[str]) -> Effect:
    """The effect of a file, which is run."""
    # Below this package, so that other processes import this package, and with it the file, before
    # what is in it.
    name = f"{__package__}.own_{_as_name(path.stem)}"
    spec = None
    if path.suffix == ".py" and path.is_file():
        spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise OwnEffectError(
            f"effects of {path}: no such Python file; give a file.py with an EFFECT"
        )
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever the file does wrong
        why = " ".join(str(error).split())
        raise OwnEffectError(
            f"effects of {path}: cannot be run: {type(error).__name__}: {why}"
        ) from None
    effect = getattr(module, "EFFECT", None)
    if not isinstance(effect, Effect):
        raise OwnEffectError(
            f"effects of {path}: has no EFFECT = Effect(...) of homeward.physics.effects.base"
        )
    fault = _fault(effect, taken_ids)
    if fault is not None:
        raise OwnEffectError(f"effects of {path}: {fault}")
    return effect


def _as_name(text: str) -> str:
    """A text as a part of a module's name."""
    return "".join(sign if sign.isalnum() else "_" for sign in text)


def _fault(effect: Effect, taken_ids: set[str]) -> str | None:
    """What is wrong with an effect, None if nothing is."""
    if not effect.id.isidentifier() or effect.id in taken_ids:
        return f"its id {effect.id!r} is taken or no name; give one of your own"
    if effect.kind not in _KINDS:
        return f"its kind {effect.kind!r} is none of {', '.join(_KINDS)}"
    parameters = effect.parameters
    if not parameters or not all(isinstance(parameter, Parameter) for parameter in parameters):
        return "it has no parameters; the first is its size, which is zero if it is off"
    switch = effect.switch
    if not switch.low <= 0.0 <= switch.high or switch.default != 0.0:
        return f"its first parameter {switch.name!r} must be zero by default, and may be: 0 switches the effect off"
    return None
