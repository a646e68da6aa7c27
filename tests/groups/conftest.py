"""Recordings to spoil and a robot, as the tests of the diagnosis have them."""

from tests.diagnosis.conftest import csv, husky, table

__all__ = ["csv", "husky", "table"]
