"""Thresholds stand in one file."""

import ast
from collections.abc import Iterator
from pathlib import Path

NUMERICS = {
    "explain/catalogue/battery.py": {"_SECONDS": "grid"},
    "explain/catalogue/drivetrain.py": {"_LIMITS": "grid", "_TRACKS_M": "grid", "HYPOTHESES": "bounds of parameters"},
    "explain/catalogue/instruments.py": {
        "_LAGS_S": "grid", "ODOMETRY_SCALE": "bounds of a parameter", "HYPOTHESES": "bounds of parameters",
    },
    "explain/change_points.py": {"SHARES": "grid of penalties"},
    "explain/formula.py": {"_RIDGE": "rounding", "_PLAIN, _SQUARED, _ROOT_TOO": "grid of powers"},
    "explain/hypothesis.py": {"TINY": "step", "SMALL_STEP": "step"},
    "explain/joint_fit.py": {"_HALVED": "shares of a step"},
    "explain/menu.py": {"KNOWN_MASS": "test drive", "_STOP_AND_GO": "test drive", "MENU": "test drives"},
    "explain/proof.py": {"_WORTH_A_LOOK": "bounds the time: far below what may be named"},
    "fit/fitted.py": {"RIDGE": "rounding"},
    "fit/held_out.py": {"_TREES, _RATE": "of the boosted trees"},
    "fit/lags.py": {"_COARSE_S, _FINE_S": "grid", "_SHARED_S": "grid", "_COARSE_DRIFT_S": "grid"},
    "fit/refit.py": {"_WEAK_PRIOR": "rounding"},
    "read/noise.py": {"_PRECISE": "tolerance of an optimum"},
    "read/signals.py": {"WINDOW_S": "length of the averaging windows"},
    "read/slope.py": {"_MIDDLE": "weight in a mean"},
    "tell/corrected.py": {"_ENDS": "quantiles that a file states"},
    "tell/robot_uncertainty.py": {"_COVERED": "quantile of the interval that is reported"},
}  # fmt: skip
"""Constants of a module with a number between 0 and 1 that decide nothing, and what they are."""


def constants(source: str) -> Iterator[str]:
    """Names of a module's constants that hold a number between 0 and 1."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            numbers = (one.value for one in ast.walk(node.value) if isinstance(one, ast.Constant))
            if any(isinstance(one, float) and 0.0 < one < 1.0 for one in numbers):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                yield ast.unparse(targets[0]).strip("()")


def test_thresholds_stand_in_rules(root: Path) -> None:
    """A share, a correlation or a level of significance elsewhere is a threshold without an origin, unless listed."""
    folder = root / "homeward" / "diagnosis"
    found = {
        file.relative_to(folder).as_posix(): set(constants(file.read_text("utf-8")))
        for file in folder.rglob("*.py")
        if file.name != "rules.py"
    }
    assert {file: names for file, names in found.items() if names} == {file: {*of} for file, of in NUMERICS.items()}


def test_constants_in_tuples_calls_and_with_a_type_are_found() -> None:
    source = "A = 0.5\nB, C = 1.0, 0.1\nD: float = 0.2\nE = f(0.3)\nF = 1\nG = 'x 0.5'\ndef f():\n    h = 0.5\n"
    assert list(constants(source)) == ["A", "B, C", "D", "E"]
