"""Ground robots that must get home on one battery charge: model, environments, agents and diagnosis."""

from homeward import installed as _installed  # noqa: F401 - first: it says in a line what is missing

# isort: split
from homeward import physics
from homeward.envs import register as _register
from homeward.physics import Robot, RobotError, load_robot

__version__ = "0.1.0"

__all__ = ["Robot", "RobotError", "__version__", "load_robot", "physics"]

_register()
