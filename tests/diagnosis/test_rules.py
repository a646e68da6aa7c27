"""Thresholds: each says where it comes from, is used, and is what its origin derives."""

import ast
import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from scipy.stats import norm

from homeward.diagnosis import rules


@pytest.fixture(scope="module")
def thresholds(root: Path) -> dict[str, str]:
    """Names of rules.py, those of one line together, and what follows them."""
    body = ast.parse((root / "homeward" / "diagnosis" / "rules.py").read_text("utf-8")).body
    return {
        ast.unparse(node.targets[0]).strip("()"): ast.unparse(after)
        for node, after in zip(body, [*body[1:], ast.Pass()], strict=True)
        if isinstance(node, ast.Assign)
    }


def test_every_threshold_has_an_origin(thresholds: dict[str, str]) -> None:
    assert len(thresholds) > 50
    assert [name for name, text in thresholds.items() if len(text.split()) < 8 or text[0] not in "\"'"] == []


def test_every_threshold_is_used(root: Path, thresholds: dict[str, str]) -> None:
    def named(folder: Path) -> Iterator[str]:
        for file in folder.rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text("utf-8"))):
                if isinstance(node, ast.Attribute):
                    yield node.attr
                elif isinstance(node, ast.ImportFrom) and node.module == "homeward.diagnosis.rules":
                    yield from (one.name for one in node.names)

    names = {name for line in thresholds for name in line.split(", ")}
    used = {*named(root / "homeward" / "diagnosis"), *named(root / "homeward" / "groups")}
    templates = " ".join(
        file.read_text("utf-8") for file in (root / "homeward" / "diagnosis" / "tell" / "templates").iterdir()
    )
    assert [name for name in sorted(names - used) if f"rules.{name}" not in templates] == []


def test_numbers_that_are_derived_are_what_is_derived() -> None:
    assert pytest.approx(rules.SIGNIFICANT) == 1.0 / (rules.PLACEBOS + 1)
    assert pytest.approx(norm.ppf(0.975), abs=0.005) == rules.NORMAL_95
    assert round(rules.NORMAL_95) == rules.CLEAR
    assert pytest.approx(math.log(2.0)) == rules.SEPARATING_GAIN
    assert 2.0 < 1.0 / math.sqrt(1.0 - rules.CONFOUNDED**2) < 2.5  # more than twice the standard error
    assert math.sqrt(rules.SHORTEST_LEVEL) == 2.0  # the mean of a level is known to half of the noise
    assert 1.0 - math.sqrt(1.0 - rules.SMALLEST_GAIN) < 0.03  # of the held-out RMSE
    assert 1.0 / math.sqrt(rules.LONGEST_LAG) == pytest.approx(rules.UNCORRELATED)
    times = (1.0 + rules.MOST_CORRELATED) / (1.0 - rules.MOST_CORRELATED)
    assert times == pytest.approx(19.0)
    assert 2.0 ** -(rules.ODOMETER_PARTS - 1) < rules.FALSE_ALARM_RATE
    assert 2.0 ** -(rules.FEWEST_BLOCKS - 1) < rules.FALSE_ALARM_RATE / 100.0  # patterns of signs, for many channels
    assert 2.0 * norm.sf(rules.CLEARLY_APART / 2.0) == pytest.approx(0.046, abs=0.001)
    assert math.sqrt(rules.COLLINEAR) == pytest.approx(0.01)  # a standard error a hundred times as large


def test_limits_of_one_thing_are_in_order() -> None:
    assert rules.SMALLEST_GAIN < rules.SMALLEST_GAIN_TO_NAME < rules.SMALLEST_GAIN_OF_A_FAULT
    assert rules.AS_FAST_IN_KMH < rules.TOO_FAST < 3.6
    assert rules.INFORMATION_GAIN < rules.SEPARATING_GAIN
    assert rules.CONFUSABLE_SHARE < rules.RIVAL_SHARE < 1.0
    assert math.tan(math.radians(30.0)) < rules.STEEPEST
    assert 1000.0 / rules.UNIT_RATIO > rules.RIGHT_ROBOT  # a wrong robot is no wrong unit
    assert rules.SPIKE_BEYOND > 1.0 < rules.BEYOND_NOISE
