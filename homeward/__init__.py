"""Ground robots that must get home on one battery charge: model, environments, agents and diagnosis."""

__version__ = "0.1.0"
