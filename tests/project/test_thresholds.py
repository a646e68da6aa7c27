"""Every threshold stands once, in a `rules.py` or an options class, with its origin."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from homeward.logs.bags import grade
from homeward.physics import model

RULES = (
    "agents/thresholds.py", "envs/routes/rules.py", "homeward/companion/rules.py", "homeward/diagnosis/rules.py",
    "homeward/estimation/rules.py", "homeward/groups/rules.py", "homeward/logs/rules.py", "homeward/physics/rules.py",
    "homeward/rules.py", "homeward/watch/rules.py",
)  # fmt: skip
"""Files of thresholds; `agents/rules` is a folder of rules for turning back."""
NUMERICS = {
    "agents/belief.py": {"_SQRT_3": "constant", "_ON_BORDER": "rounding", "_AHEAD": "rounding"},
    "agents/evaluation/plots.py": {"_GOLDEN": "constant"},
    "agents/evaluation/tradeoff.py": {"LEVELS": "grid"},
    "agents/learning/network.py": {"_VALUE_SCALE": "of the network", "_LOG_DEVIATIONS": "of the network"},
    "agents/learning/ppo.py": {"_LAST_LEARNING_RATE": "of training"},
    "agents/learning/settings.py": {"_BY_START": "options"},
    "agents/onboard.py": {"_SOON": "rounding"},
    "agents/oracle/bound.py": {"ROUNDING": "rounding"},
    "agents/oracle/kernel.py": {"_HAIR_M": "step"},
    "agents/planner/kernel.py": {"_LEAST_RATIO": "keeps a divisor above 0", "EAGERNESS": "grid", "STOPS": "grid"},
    "agents/registry.py": {"_SHARES, _DEVIATIONS": "grid", "SWEPT": "grid"},
    "agents/rules/dmax_adaptive.py": {"_PRIOR": "prior"},
    "agents/rules/reserves.py": {"PACES": "options", "RESERVES": "options"},
    "agents/trained/inputs.py": {"_ANY": "keeps a divisor above 0"},
    "envs/conditions/difficulty.py": {"DIFFICULTY": "options", "DIFFICULTY['harsh']": "options"},
    "envs/conditions/instruments.py": {"INSTRUMENTS": "options", "STEEPEST_READ": "range of an instrument"},
    "envs/conditions/weather.py": {"GUSTINESS": "of the simulated world"},
    "envs/features.py": {"_DRAWN": "weight in a mean"},
    "envs/kernel.py": {"_FORECAST_SINE": "of the simulated world", "_FORECAST_INTEREST": "of the simulated world"},
    "envs/observer.py": {"_STANDING_MPS": "keeps a divisor above 0", "_BORDER": "rounding"},
    "envs/options.py": {
        "OFF_COMMAND": "options", "RETURN_SHARE": "options", "_HALF_INFORMATION": "options", "_LINK": "options",
        "_MEMORY": "options", "_MOST_HALF": "options", "_RADIO": "options", "_REACH": "options", "_SQRT_3": "constant",
    },
    "envs/routes/route.py": {"NEW_PATCH": "of generated routes", "INTEREST_LENGTH": "of generated routes"},
    "envs/sensing.py": {"_ANY": "keeps a divisor above 0", "DRIVING_LINK": "of the simulated world"},
    "envs/threads.py": {
        "_CALIBRATION_S, _CALIBRATION_STEPS": "time", "_TRUST_S": "time", "_PATIENCE_S, _CREDIT_S": "time",
    },
    "envs/viewer/battery.py": {"_WORTH_SHOWING": "drawing", "_HATCHED_GREEN": "drawing"},
    "envs/viewer/profile.py": {"_LIGHT_VIOLET": "drawing", "_FLATTEST": "drawing", "_LOWLANDS": "drawing"},
    "homeward/commands/routes.py": {"_FINEST_M": "grid"},
    "homeward/companion/advice.py": {"_COVERED": "quantile of the interval that is reported"},
    "homeward/companion/cutoff.py": {"_FORGETS": "weight in a mean"},
    "homeward/companion/home_estimator.py": {"_PACE": "weight in a mean"},
    "homeward/companion/prior_knowledge.py": {"_GENERIC": "options"},
    "homeward/diagnosis/explain/catalogue/battery.py": {"_SECONDS": "grid"},
    "homeward/diagnosis/explain/catalogue/drivetrain.py": {
        "_LIMITS": "grid", "_TRACKS_M": "grid", "HYPOTHESES": "bounds of parameters",
    },
    "homeward/diagnosis/explain/catalogue/instruments.py": {
        "_LAGS_S": "grid", "ODOMETRY_SCALE": "bounds of a parameter", "HYPOTHESES": "bounds of parameters",
    },
    "homeward/diagnosis/explain/change_points.py": {"SHARES": "grid of penalties"},
    "homeward/diagnosis/explain/formula.py": {"_RIDGE": "rounding", "_PLAIN, _SQUARED, _ROOT_TOO": "grid of powers"},
    "homeward/diagnosis/explain/hypothesis.py": {"TINY": "step", "SMALL_STEP": "step"},
    "homeward/diagnosis/explain/joint_fit.py": {"_HALVED": "shares of a step"},
    "homeward/diagnosis/explain/menu.py": {
        "KNOWN_MASS": "test drive", "_STOP_AND_GO": "test drive", "MENU": "test drives",
    },
    "homeward/diagnosis/explain/proof.py": {"_WORTH_A_LOOK": "bounds the time: far below what may be named"},
    "homeward/diagnosis/fit/fitted.py": {"RIDGE": "rounding"},
    "homeward/diagnosis/fit/held_out.py": {"_TREES, _RATE": "of the boosted trees"},
    "homeward/diagnosis/fit/lags.py": {"_SHARED_S": "grid", "_COARSE_DRIFT_S": "grid"},
    "homeward/diagnosis/fit/refit.py": {"_WEAK_PRIOR": "rounding"},
    "homeward/diagnosis/read/noise.py": {"_PRECISE": "tolerance of an optimum"},
    "homeward/diagnosis/read/signals.py": {"WINDOW_S": "length of the averaging windows"},
    "homeward/diagnosis/read/slope.py": {"_MIDDLE": "weight in a mean"},
    "homeward/diagnosis/tell/corrected.py": {"_ENDS": "quantiles that a file states"},
    "homeward/diagnosis/tell/robot_uncertainty.py": {"_COVERED": "quantile of the interval that is reported"},
    "homeward/estimation/margin.py": {"_EXACTLY": "tolerance of a search"},
    "homeward/estimation/prior.py": {"_AROUND, _SHARE, _APART": "grid of hypotheses"},
    "homeward/logs/channels.py": {
        "CHANNELS": "schema with the limits of channels", "_SPEED": "units", "_DEGREES, _PER_CENT": "units",
        "_MM, _MA": "units", "_SMALLER_S": "units",
    },
    "homeward/logs/propose.py": {"_LENGTH": "units", "_SPEED": "units", "_CURRENT": "units", "_UNITS": "units"},
    "homeward/logs/times.py": {"_UNITS": "units"},
    "homeward/physics/kernel.py": {"_GUESSES, _HALVINGS, _ROUNDING": "iterations, rounding"},
    "homeward/synthetic.py": {"STEP_S": "step"},
    "homeward/watch/coverage.py": {"_BORDERS": "rows of a table"},
    "homeward/watch/ros2/node.py": {"PERIOD_S": "period"},
    "homeward/watch/route_forecast.py": {"_QUANTILES": "quantiles that are drawn"},
}  # fmt: skip
"""Constants of a module with a number between 0 and 1 that decide nothing, or that are options, and what they are. The
file of an effect has the constants of its equation and the bounds of its parameters."""
COMPARED = {
    "agents/evaluation/plots.py": {100.0: "per cent"},
    "agents/learning/settings.py": {100.0: "bound of an option"},
    "agents/shield/reckless.py": {0.1: "share of stops of a policy that tests the shield"},
    "envs/routes/tracks.py": {90.0: "degrees of latitude", 180.0: "degrees of longitude"},
    "envs/viewer/profile.py": {0.01: "drawing", 0.05: "drawing", 2000.0: "format"},
    "homeward/commands/evaluate.py": {100.0: "format"},
    "homeward/commands/routes.py": {0.005: "format"},
    "homeward/companion/companion.py": {0.5: "half a step of rounding"},
    "homeward/diagnosis/explain/formula.py": {0.5: "cosine of 45 degrees, squared"},
    "homeward/diagnosis/explain/places.py": {0.99: "quantile that AT_WORK is of"},
    "homeward/diagnosis/fit/usable.py": {3.6: "km/h"},
    "homeward/diagnosis/read/pitch.py": {0.5: "square root"},
    "homeward/diagnosis/tell/figures.py": {1.5: "drawing"},
    "homeward/logs/bags/assemble.py": {100.0: "per cent"},
    "homeward/physics/range.py": {0.001: "step"},
    "homeward/quantities.py": dict.fromkeys((10.0, 100.0, 1e3, 1e4, 120.0, 0.9995, 999.5), "format"),
    "homeward/synthetic.py": {0.02: "of the synthetic drive"},
}
"""Numbers with which something is compared in place, beside 0, 1, 2 and rounding (1e-6 and less)."""


@pytest.fixture(scope="module")
def modules(root: Path) -> dict[str, ast.Module]:
    """Modules of the package by their paths; the search does not enter linked folders."""
    files = (file for one in ("homeward", "envs", "agents") for file in sorted((root / one).rglob("*.py")))
    return {file.relative_to(root).as_posix(): ast.parse(file.read_text("utf-8")) for file in files}


def constants(module: ast.Module) -> Iterator[str]:
    """Names of a module's constants that hold a number between 0 and 1."""
    for node in module.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and any(0.0 < one < 1.0 for one in floats(node)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield ast.unparse(targets[0]).strip("()")


def compared(module: ast.Module) -> Iterator[float]:
    """Numbers in comparisons anywhere in a module, beside 0, 1, 2 and rounding."""
    for node in ast.walk(module):
        if isinstance(node, ast.Compare):
            yield from (one for one in floats(node) if one > 1e-6 and one not in (1.0, 2.0))


def floats(tree: ast.AST) -> Iterator[float]:
    return (one.value for one in ast.walk(tree) if isinstance(one, ast.Constant) and isinstance(one.value, float))


def thresholds(module: ast.Module) -> dict[str, str]:
    """Names of a file of thresholds, those of one line together, and what follows them."""
    found = {}
    for node, after in zip(module.body, [*module.body[1:], ast.Pass()], strict=True):
        if isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            found[ast.unparse(target).strip("()")] = ast.unparse(after)
    return found


def named(module: ast.Module) -> Iterator[str]:
    """Attributes that a module names, and what it imports from files of thresholds."""
    for node in ast.walk(module):
        if isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.ImportFrom) and (node.module or "").endswith(("rules", "thresholds")):
            yield from (alias.name for alias in node.names)


def test_thresholds_stand_in_rules(modules: dict[str, ast.Module]) -> None:
    """A share, a correlation or a level of significance elsewhere is a threshold without an origin, unless listed."""
    files = {file: one for file, one in modules.items() if file not in RULES and "/physics/effects/" not in file}
    found = {file: {*constants(module)} for file, module in files.items()}
    assert {file: names for file, names in found.items() if names} == {file: {*of} for file, of in NUMERICS.items()}


def test_nothing_is_compared_with_a_bare_number(modules: dict[str, ast.Module]) -> None:
    found = {file: {*compared(module)} for file, module in modules.items() if file not in RULES}
    assert {file: one for file, one in found.items() if one} == {file: {*of} for file, of in COMPARED.items()}


def test_constants_in_tuples_calls_and_with_a_type_are_found() -> None:
    source = "A = 0.5\nB, C = 1.0, 0.1\nD: float = 0.2\nE = f(0.3)\nF = 1\nG = 'x 0.5'\ndef f():\n    h = 0.5\n"
    assert list(constants(ast.parse(source))) == ["A", "B, C", "D", "E"]
    source = "def f(x):\n    return x > 0.3 if x else -0.4 * x < y and x >= 1.0 and x < 1e-9\nB = 0.5\n"
    assert list(compared(ast.parse(source))) == [0.3, 0.4]


def test_every_file_of_thresholds_is_listed(modules: dict[str, ast.Module]) -> None:
    assert {file for file in modules if file.endswith("/rules.py")} == {*RULES} - {"agents/thresholds.py"}


@pytest.mark.parametrize("file", RULES)
def test_every_threshold_has_an_origin(file: str, modules: dict[str, ast.Module]) -> None:
    found = thresholds(modules[file])
    assert len(found) >= 3
    assert [name for name, text in found.items() if len(text.split()) < 8 or text[0] not in "\"'"] == []


def test_every_threshold_is_used(modules: dict[str, ast.Module], root: Path) -> None:
    """In another file of the package, or in a template."""
    templates = " ".join(one.read_text("utf-8") for one in (root / "homeward").rglob("templates/*.*"))
    used = {file: {*named(module)} for file, module in modules.items()}
    for file in RULES:
        elsewhere = set().union(*(names for other, names in used.items() if other != file))
        names = {name for line in thresholds(modules[file]) for name in line.split(", ")}
        assert [name for name in sorted(names - elsewhere) if f"rules.{name}" not in templates] == [], file


def test_gravity_is_the_same_where_layers_keep_it_apart() -> None:
    """Recordings are read without the physics."""
    assert grade.GRAVITY_MPS2 == model.GRAVITY_MPS2
