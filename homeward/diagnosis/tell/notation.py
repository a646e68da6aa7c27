"""How the report and the terminal write numbers, formulas and names."""

from collections.abc import Mapping, Sequence
from pathlib import PurePath

import numpy as np
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from homeward import cli
from homeward.diagnosis import rules

PAPER_ACCURACY = "66 to 91 %"
"""Accuracy that the paper claims for the range estimated by its model."""

ARMS: Mapping[str, str] = {
    "nominal": "the robot file as it is",
    "refit": "its parameters fitted",
    "corrected": "fitted together with what was found missing",
    "file": "corrected.toml, replayed as written",
    "black_box": "boosted trees on the same channels: an upper bound of the gain",
    "placebo": "what was found missing, shifted in time: the gain by chance",
}
"""The arms of the comparison in the order in which they are shown, in words."""

_SIGNS = {"Gamma": "Γ", "theta": "θ", "eta3": "η₃", "^2": "²", "^3": "³", "degC": "°C", " - ": " − "}

PLAIN = {
    "template": "plotly_white",
    "paper_bgcolor": "rgba(0, 0, 0, 0)",
    "plot_bgcolor": "rgba(0, 0, 0, 0)",
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#1f2933"},
}
"""Layout of a figure in the font of its page, with a transparent background: pages are light or dark."""
_LINE = "rgba(31, 41, 51, 0.2)"
GRID = {"gridcolor": _LINE, "zerolinecolor": _LINE}
"""Of each axis. Chosen: a contrast of 1.5 to 1 on light pages, of 1.7 on dark ones, where figures are inverted."""


def templates(autoescape: bool = True, package: str = "homeward.diagnosis.tell") -> Environment:
    """The templates beside this file, with filters for numbers and names; pages escape names given by others.

    Those of another `package` are found first, and may extend `page.html`.
    """
    loader = ChoiceLoader([PackageLoader(one) for one in dict.fromkeys((package, "homeward.diagnosis.tell"))])
    environment = Environment(
        loader=loader, autoescape=autoescape, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "number": number, "interval": interval, "decimal": decimal, "typeset": typeset, "as": format,
        "file_name": lambda path: PurePath(path).name, "percent": lambda share: f"{decimal(100.0 * share, 0)} %",
    }  # fmt: skip
    environment.globals |= {"rules": rules, "arms": ARMS, "paper_accuracy": PAPER_ACCURACY}
    return environment


def page(environment: Environment, template: str, **values: object) -> str:
    """A page as text that can be written: names may hold control characters, and bytes that are no text."""
    shown = environment.overlay(finalize=_printable).get_template(template).render(**values)
    return shown.encode("utf-8", "replace").decode("utf-8")


def _printable(value: object) -> object:
    """What is filled in, with a question mark for each control character but ends of lines; markup as it is."""
    if not isinstance(value, str) or isinstance(value, Markup):
        return value
    return "\n".join(map(cli.printable, value.split("\n")))


def number(value: float | None, digits: int = 3) -> str:
    """A number to some significant digits, a dash for none.

    >>> number(1234.5), number(-0.0001234), number(None), number(1.5), number(0.0)
    ('1234', '−0.000123', '–', '1.50', '0')
    """
    if value is None or not np.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    if abs(value) >= 10 ** (digits - 1):
        return decimal(value, 0)
    return f"{'−' if value < 0 else ''}{abs(value):#.{digits}g}"


def interval(ci95: tuple[float, float] | None, digits: int = 3) -> str:
    """The ends of an interval, a dash for none.

    >>> interval((1.0, 2.5)), interval(None)
    ('1.00 to 2.50', '–')
    """
    return "–" if ci95 is None else f"{number(ci95[0], digits)} to {number(ci95[1], digits)}"


def decimal(value: float, places: int) -> str:
    """A number with fixed decimal places and a proper minus, none before zero.

    >>> decimal(-2.701, 2), decimal(-0.02, 1)
    ('−2.70', '0.0')
    """
    return f"{round(value, places) + 0.0:.{places}f}".replace("-", "−")


def typeset(text: str) -> str:
    """Formulas and units with their typographic signs.

    >>> typeset("c / Gamma, N s^2/m^2")
    'c / Γ, N s²/m²'
    """
    for plain, sign in _SIGNS.items():
        text = text.replace(plain, sign)
    return text


def labels(paths: Sequence[str]) -> dict[str, str]:
    """Each recording's file name, with as many of its folders as distinguish it from the others.

    >>> labels(["data/ice/1.csv", "data/snow/1.csv", "data/snow/2.csv"])
    {'data/ice/1.csv': 'ice/1.csv', 'data/snow/1.csv': 'snow/1.csv', 'data/snow/2.csv': '2.csv'}
    """
    short = {}
    for path in dict.fromkeys(paths):
        parts = PurePath(path).parts or (path,)
        others = [PurePath(other).parts for other in set(paths) - {path}]
        keep = next((k for k in range(1, len(parts)) if all(parts[-k:] != other[-k:] for other in others)), len(parts))
        short[path] = "/".join(parts[-keep:])
    return short
