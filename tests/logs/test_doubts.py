"""Units that pass every limit are doubted where other channels, or the values themselves, speak
against them."""

from collections.abc import Callable

import numpy as np
import pytest

from homeward.logs.channels import Array
from homeward.logs.doubts import doubts, turned_slopes


def drive() -> dict[str, Array]:
    """A drive of 100 s with stops, as it should be recorded."""
    t = np.arange(0.0, 100.0, 0.5)
    power_w = 50.0 + 20.0 * np.sin(t)
    return {
        "time_s": t, "speed_mps": np.clip(np.sin(0.1 * t), 0.0, None), "power_w": power_w, "current_a": power_w / 24.0,
        "soc": 0.9 - 0.002 * t, "heading_rad": 0.01 * t - 3.0, "temperature_c": np.full(len(t), 31.0),
    }  # fmt: skip


SPOILED: dict[str, tuple[str, Callable[[Array], Array], str]] = {
    "degrees": ("heading_rad", lambda values: np.degrees(values) + 270.0, "in degrees?"),
    "Fahrenheit": ("temperature_c", lambda values: 1.8 * values + 32.0, "in Fahrenheit"),
    "charge used": (
        "soc",
        lambda values: 1.0 - values,
        "rises from 0.1 to 0.299 while 4.98 kJ are drawn",
    ),
    "Ah for A": (
        "current_a",
        lambda values: np.cumsum(values) / 7200.0,
        "a counter of charge (Ah)?",
    ),
    "Wh left": (
        "power_w",
        lambda values: 500.0 - np.cumsum(values) / 7200.0,
        "falls 199 times and never rises",
    ),
}


@pytest.mark.parametrize("kind", SPOILED)
def test_a_unit_that_passes_is_doubted_by_what_the_data_show(kind: str) -> None:
    name, spoil, words = SPOILED[kind]
    said = doubts({**drive(), name: spoil(drive()[name])})
    assert list(said) == [name] and words in said[name] and "\n" not in said[name]


@pytest.mark.parametrize("jitter_mps", [0.0, 2e-13, 0.1])
def test_slopes_of_a_drive_at_one_speed_are_judged_by_its_climbs(jitter_mps: float) -> None:
    rng = np.random.default_rng(0)
    speed_mps = 1.2 + jitter_mps * rng.normal(size=300)
    climb_mps = 0.1 * np.sin(np.arange(300) / 20.0)
    run = np.zeros(300, np.intp)
    for sign, is_doubted in ((1.0, False), (-1.0, True)):
        power_w = 60.0 + sign * 490.0 * climb_mps + rng.normal(size=300)
        said = turned_slopes(climb_mps, speed_mps, power_w, run, 490.0, "rover")
        assert (said is not None) == is_doubted


def test_a_drive_as_it_should_be_has_no_doubts() -> None:
    assert doubts(drive()) == {}
    charged = drive()["soc"].copy()
    charged[100:] += 0.5  # a battery that was swapped
    assert doubts({**drive(), "soc": charged}) == {}
    # nothing shows that it is drawn
    assert doubts({"time_s": drive()["time_s"], "soc": 1.0 - drive()["soc"]}) == {}
