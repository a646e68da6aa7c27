"""Recordings to spoil and a robot, as the tests of the diagnosis have them."""

from tests.diagnosis.conftest import husky
from tests.logs.conftest import csv, table

__all__ = ["csv", "husky", "table"]
