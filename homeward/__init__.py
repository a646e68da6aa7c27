"""Ground robots that must get home on one battery charge: model, environments, agents and
diagnosis."""

import importlib as _importlib
from types import ModuleType as _ModuleType

from homeward import loading as _loading  # noqa: F401 - first: Ctrl-C ends a command that loads with a line

# isort: split
from homeward import installed as _installed  # noqa: F401 - second: it says in a line what is missing
from homeward import own_effects as _own_effects  # noqa: F401 - before the physics, whose kernels are made of all effects

# isort: split
from homeward import physics
from homeward.envs import register as _register
from homeward.physics import Robot, RobotError, load_robot

__version__ = "0.1.0"

__all__ = [
    "Robot", "RobotError", "__version__", "agents", "companion", "datasets", "diagnosis", "envs", "estimation",
    "load_robot", "logs", "parallel", "physics",
]  # fmt: skip

_LATER = ("agents", "companion", "datasets", "diagnosis", "estimation", "logs", "parallel")
"""Parts that are imported at their first use, so that `import homeward` stays light."""

_register()


def __getattr__(name: str) -> _ModuleType:
    if name in _LATER:
        return _importlib.import_module(f"homeward.{name}")
    raise AttributeError(f"module 'homeward' has no attribute {name!r}")
