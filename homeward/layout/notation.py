"""How pages and the terminal write numbers, formulas and names, and the templates that pages are
made from."""

from collections.abc import Sequence
from pathlib import PurePath

import numpy as np
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from homeward import cli

_SIGNS = {
    "Gamma": "Γ",
    "theta": "θ",
    "eta3": "η₃",
    "^2": "²",
    "^3": "³",
    "degC": "°C",
    " - ": " − ",
}


def templates(package: str, autoescape: bool = True) -> Environment:
    """The templates of a package, with filters for numbers and names; pages escape names given by
    others.

    They may extend `page.html`, which lies beside this file.
    """
    loader = ChoiceLoader([PackageLoader(package), PackageLoader("homeward.layout")])
    environment = Environment(
        loader=loader,
        autoescape=autoescape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "interval": interval,
        "decimal": decimal,
        "percent": _percent,
        "typeset": typeset,
        "as": format,
        "file_name": lambda path: PurePath(path).name,
    }
    environment.tests["none"] = _is_none
    return environment


def _is_none(value: object) -> bool:
    """Whether a value is None; Jinja's own test takes an undefined name, such as a misspelt one,
    for a value.

    Raises:
        UndefinedError: The name is undefined.
    """
    if isinstance(value, StrictUndefined):
        str(value)  # raises
    return value is None


def _percent(share: float) -> str:
    return f"{decimal(100.0 * share, 0)} %"


def page(environment: Environment, template: str, **values: object) -> str:
    """A page as text that can be written: names may hold control characters, and bytes that are no
    text."""
    text = environment.overlay(finalize=_printable).get_template(template).render(**values)
    return text.encode("utf-8", "replace").decode("utf-8")


def _printable(value: object) -> object:
    """What is filled in, with a question mark for each control character but ends of lines; markup
    as it is."""
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
    # The flag # keeps zeros at the end: they are significant digits.
    sign = "−" if value < 0 else ""
    return f"{sign}{abs(value):#.{digits}g}"


def interval(ci95: tuple[float, float] | None, digits: int = 3) -> str:
    """The ends of an interval, a dash for none.

    >>> interval((1.0, 2.5)), interval(None)
    ('1.00 to 2.50', '–')
    """
    if ci95 is None:
        return "–"
    low, high = ci95
    return f"{number(low, digits)} to {number(high, digits)}"


def decimal(value: float, places: int) -> str:
    """A number with fixed decimal places and a proper minus, none before zero.

    >>> decimal(-2.701, 2), decimal(-0.02, 1)
    ('−2.70', '0.0')
    """
    rounded = round(value, places) + 0.0  # no minus before zero
    return f"{rounded:.{places}f}".replace("-", "−")


def unit_after(unit: str) -> str:
    """A unit behind its number; ratios have none.

    >>> unit_after("W"), unit_after("1")
    (' W', '')
    """
    return "" if unit == "1" else f" {unit}"


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
    label_of = {}
    for path in dict.fromkeys(paths):
        parts = PurePath(path).parts or (path,)
        parts_of_others = [PurePath(other_path).parts for other_path in set(paths) - {path}]
        label_of[path] = "/".join(_distinct_end(parts, parts_of_others))
    return label_of


def _distinct_end(
    parts: tuple[str, ...], parts_of_others: Sequence[tuple[str, ...]]
) -> tuple[str, ...]:
    """The shortest end of a path that no other path ends with; all of it where there is none."""
    for length in range(1, len(parts)):
        end = parts[-length:]
        if all(other_parts[-length:] != end for other_parts in parts_of_others):
            return end
    return parts
