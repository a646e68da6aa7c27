"""A plant written apart from the effect catalogue, with other functional forms: its cases, and a table of them.

`python benchmarks/plants/plant.py` prints the table.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[2]))  # as a script, it does not see the folder above its own

from benchmarks.plants.case import Case, Noise, anonymous
from benchmarks.plants.loads import OUTSIDE
from benchmarks.plants.observe import NOISE, observe
from benchmarks.plants.rollout import Rollout, Scenario, simulate

VISIBLE_BELOW = 0.9
"""A refit that absorbs this share of an effect hides it."""

LEAST_SHARE = 0.04
"""Of the energy, that an effect to be found should have."""

SINGLES: dict[str, tuple[tuple[str, str], ...]] = {
    "standby": (("porter", "indoor"), ("husky", "patrol")),
    "compute": (("rusti_computer", "survey"), ("jackal", "survey")),
    "radio": (("jackal", "expedition"), ("courier", "patrol")),
    "heater": (("van", "frost"), ("husky", "winter")),
    "intermittent_load": (("porter", "indoor"), ("jackal", "patrol")),
    "wind": (("rusti_computer", "expedition"), ("van", "urban")),
    "hidden_grade": (("courier", "patrol"), ("husky", "patrol")),
    "regeneration": (("van", "upland"), ("courier", "hills")),
    "copper_loss": (("courier", "hills"), ("jackal", "hills")),
    "no_load": (("courier", "creep"), ("porter", "creep")),
    "viscous": (("courier", "patrol"), ("jackal", "patrol")),
    "breakaway": (("husky", "shuttle"), ("porter", "shuttle")),
    "motor_heating": (("courier", "hills"), ("van", "upland")),
    "payload": (("courier", "patrol"), ("van", "urban")),
    "surface": (("husky", "patrol"), ("jackal", "survey")),
    "turning": (("husky", "corners"), ("rusti_computer", "corners")),
    "inertia": (("van", "avenue"), ("courier", "shuttle")),
    "sensor_offset": (("husky", "patrol"), ("porter", "indoor")),
    "sensor_gain": (("jackal", "patrol"), ("van", "urban")),
    "clock_lag": (("courier", "shuttle"), ("husky", "shuttle")),
    "odometry_scale": (("jackal", "patrol"), ("courier", "patrol")),
}
"""Of each effect, the robots and journeys in which it is hidden."""

IN_TORQUE = (("payload", "patrol"), ("surface", "patrol"), ("hidden_grade", "patrol"))
"""Hidden in recordings of a Husky's motor currents."""

PAIRS = (
    (("payload", "standby"), "courier", "patrol"),
    (("inertia", "wind"), "van", "avenue"),
    (("turning", "surface"), "husky", "corners"),
    (("heater", "copper_loss"), "jackal", "hills"),
    (("inertia", "regeneration"), "courier", "shuttle"),
    (("intermittent_load", "hidden_grade"), "husky", "patrol"),
    (("turning", "sensor_offset"), "rusti_computer", "corners"),
    (("compute", "payload"), "jackal", "survey"),
)

CONSTANT = (
    ("payload", "husky", "patrol"), ("standby", "porter", "indoor"), ("surface", "jackal", "patrol"),
    ("hidden_grade", "courier", "patrol"), ("sensor_gain", "van", "urban"), ("viscous", "courier", "patrol"),
    ("sensor_offset", "rusti_computer", "survey"),
)  # fmt: skip
"""Effects that never change, so that a refit absorbs them."""

CONTROL_JOURNEYS = (
    ("rusti_computer", "survey"), ("husky", "patrol"), ("jackal", "corners"), ("van", "urban"), ("courier", "hills"),
    ("porter", "indoor"), ("husky", "hills"), ("jackal", "winter"), ("van", "upland"), ("courier", "shuttle"),
)  # fmt: skip
CONTROLS_OF_A_KIND = 42

OUTSIDE_JOURNEYS = (("courier", "patrol"), ("husky", "hills"), ("jackal", "patrol"))
"""One for each effect that no catalogue names."""

EVERY: tuple[Noise, ...] = ("low", "middle", "high")

FLAT = ("indoor",)
"""Journeys without a channel of the slope."""


Listed = tuple[Scenario, tuple[Noise, ...]]


def scenarios(seed: int = 0) -> Iterator[Listed]:
    """All scenarios and the noise levels at which each is recorded; the same on every call with the same seed."""
    shares = np.random.default_rng([seed, 7])
    for number, (scenario, levels) in enumerate([*_singles(), *_mixtures(), *_controls()]):
        yield replace(scenario, seed=1000 * seed + number, share=float(shares.uniform(0.05, 0.22))), levels


def _singles() -> Iterator[Listed]:
    for effect, places in SINGLES.items():
        for robot, profile in places:
            flat = effect == "hidden_grade" or profile in FLAT
            yield Scenario("single", (effect,), robot, profile, 0, flat=flat), EVERY
    for effect, profile in IN_TORQUE:
        yield Scenario("single", (effect,), "husky", profile, 0, flat=effect == "hidden_grade", torque=True), EVERY
    for effect, robot, profile in CONSTANT:
        flat = effect == "hidden_grade" or profile in FLAT
        yield Scenario("invisible", (effect,), robot, profile, 0, flat=flat, constant=True), ("low", "high")


def _mixtures() -> Iterator[Listed]:
    for truth, robot, profile in PAIRS:
        flat = "hidden_grade" in truth or profile in FLAT
        yield Scenario("pair", truth, robot, profile, 0, flat=flat), EVERY
    for in_words, (robot, profile) in zip(OUTSIDE, OUTSIDE_JOURNEYS, strict=True):
        yield Scenario("outside", (in_words,), robot, profile, 0), EVERY


def _controls() -> Iterator[Listed]:
    for number in range(CONTROLS_OF_A_KIND):
        robot, profile = CONTROL_JOURNEYS[number % len(CONTROL_JOURNEYS)]
        flat = profile in FLAT or number % 7 == 0
        yield Scenario("exact", (), robot, profile, 0, flat=flat), (EVERY[number % 3],)
        yield Scenario("misset", (), robot, profile, 0, flat=flat), (EVERY[number % 3],)


def visible(scenario: Scenario) -> Rollout:
    """Rollout of a scenario, drawn anew where the effect is faint or a refit would absorb it; of six draws the last."""
    for attempt in range(6):
        rollout = simulate(replace(scenario, seed=scenario.seed + 10**7 * attempt))
        if scenario.constant or (
            all(absorbed < VISIBLE_BELOW for absorbed in rollout.absorbed)
            and all(share >= LEAST_SHARE for share in rollout.energy_share)
        ):
            break
    return rollout


def record(scenario: Scenario, rollout: Rollout, noise: Noise, number: int) -> Case:
    """One case of a rollout; effects of which a refit would absorb one are labelled invisible."""
    hidden = any(share >= VISIBLE_BELOW for share in rollout.absorbed)
    seed = 10 * scenario.seed + list(NOISE).index(noise)
    runs, noise_rms = observe(rollout, noise, seed, scenario.kind == "exact", scenario.robot != "porter")
    return Case(
        anonymous("plant", number), "plant", "invisible" if hidden else scenario.kind, scenario.truth, noise, seed,
        rollout.nominal, runs, noise_rms,
    )  # fmt: skip


def rollouts(seed: int = 0) -> Iterator[tuple[Rollout, Case]]:
    """Every case with the rollout behind it, one at a time: all of them together fill a gigabyte."""
    number = 0
    for scenario, levels in scenarios(seed):
        rollout = visible(scenario)
        for noise in levels:
            yield rollout, record(scenario, rollout, noise, 1000 * seed + number)
            number += 1


def cases(seed: int = 0) -> Iterator[Case]:
    """Every case of the plant, one at a time."""
    return (case for _, case in rollouts(seed))


def summary(title: str, rows: Iterator[tuple[Rollout, Case]]) -> None:
    """Print what is hidden in each case, how much of the energy it is and how much of it a refit would absorb."""
    table = Table(title=title)
    for heading in ("case", "source", "kind", "truth", "robot", "noise", "noise RMS", "share of energy", "absorbed"):
        table.add_column(heading, overflow="fold")
    for rollout, case in rows:
        shares = " ".join(f"{share:.1%}" for share in rollout.energy_share)
        absorbed = " ".join(f"{share:.2f}" for share in rollout.absorbed)
        table.add_row(case.name, case.source, case.kind, " + ".join(case.truth), case.robot.name, case.noise,
                      f"{case.noise_rms:.3g}", shares, absorbed)  # fmt: skip
    Console(width=170).print(table)


if __name__ == "__main__":
    summary("Plant with forms of its own", rollouts())
