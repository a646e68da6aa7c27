"""Units that pass every limit are doubted live as in files, where the drive shows it, and said as a
warning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest

from homeward.companion import Companion
from homeward.logs.channels import Array
from homeward.physics import load_robot, model
from homeward.watch.online.doubted import Doubted
from homeward.watch.online.link import Link
from homeward.watch.online.listener import Heard
from homeward.watch.online.node import Node

HUSKY = load_robot("husky")
STEP_S = 0.5


def drive() -> dict[str, Array]:
    """Five minutes over hills with stops, as they should be received."""
    time_s = np.arange(0.0, 300.0, STEP_S)
    speed_mps = np.clip(0.2 + 0.6 * np.sin(0.1 * time_s), 0.0, None)
    grade_rad = 0.1 * np.sin(0.04 * time_s)
    force_n = np.maximum(model.traction_force(HUSKY, speed_mps, grade_rad), 0.0)
    power_w = 60.0 + model.drive_power(HUSKY, force_n, speed_mps) + np.sin(7.0 * time_s)
    return {
        "time_s": time_s, "speed_mps": speed_mps, "grade_rad": grade_rad, "power_w": power_w,
        "current_a": power_w / 24.0, "soc": 0.9 - 0.0005 * time_s, "heading_rad": 0.01 * time_s - 3.0,
        "temperature_c": np.full(len(time_s), 31.0),
    }  # fmt: skip


def heard(channels: dict[str, Array]) -> list[Heard]:
    """Readings one after the other, as the listener gives them."""
    read = "speed_mps", "grade_rad", "power_w", "soc"
    rows = []
    for row in zip(*channels.values(), strict=True):
        values = dict(zip(channels, map(float, row), strict=True))
        reading = {name: values[name] for name in read}
        rows.append(Heard(values.pop("time_s"), {**reading, "heading_rad": 0.3}, values=values))
    return rows


SPOILED: dict[str, tuple[str, Callable[[Array], Array], str]] = {
    "degrees": ("heading_rad", lambda values: np.degrees(values) + 270.0, "in degrees?"),
    "Fahrenheit": ("temperature_c", lambda values: 1.8 * values + 32.0, "in Fahrenheit"),
    "charge used": ("soc", lambda values: 1.0 - values, "is it the charge used?"),
    "Ah for A": (
        "current_a",
        lambda values: np.cumsum(values) * STEP_S / 3600.0,
        "a counter of charge (Ah)?",
    ),
    "downhill positive": ("grade_rad", lambda values: -values, "is uphill positive?"),
}


@pytest.mark.parametrize("kind", SPOILED)
def test_a_unit_that_passes_is_doubted_after_a_minute_of_driving(kind: str) -> None:
    name, spoil, words = SPOILED[kind]
    doubted = Doubted(HUSKY)
    rows = heard({**drive(), name: spoil(drive()[name])})
    for row in rows[:100]:
        doubted.see(row)
    assert doubted.lines == []
    for row in rows[100:]:
        doubted.see(row)
    (line,) = doubted.lines
    assert words in line and "\n" not in line


def test_a_drive_as_it_should_be_and_a_charge_on_the_way_have_no_doubts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("homeward.watch.online.doubted._MOST", 50)  # means are joined on the way
    channels = drive()
    standing = channels["speed_mps"] == 0.0
    assert standing.any()
    channels["soc"] += 0.3 * np.cumsum(standing) / standing.sum()  # at stands alone
    doubted = Doubted(HUSKY)
    for row in heard(channels):
        doubted.see(row)
        assert doubted.lines == []
    assert len(doubted._means) < 50


def test_a_doubt_is_among_the_warnings_of_a_node(monkeypatch: pytest.MonkeyPatch) -> None:
    node = Node(Companion(HUSKY, home="here"), cast(Link, _Silent()))
    rows = iter(heard({**drive(), "heading_rad": np.degrees(drive()["heading_rad"]) + 270.0}))
    monkeypatch.setattr(node.listener, "take", lambda now_s: next(rows))
    for _ in range(280):
        node.step()
    assert any(text.startswith("heading_rad begins at 98") for text in node.warnings), node.warnings


class _Silent:
    """A link without messages."""

    def found(self) -> dict[str, str]:
        return {}

    def take(self) -> list[Any]:
        return []

    def faults(self) -> list[str]:
        return []

    def tell(self, news: Any) -> None:
        pass
