"""In what an environment differs from that of a training, by what it is and not by what it is
called."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from homeward.agents.trained.provenance import differences, made_with
from homeward.envs.options import Options, known_of

ENV = "homeward/Survey-v0"


def description(**chosen: Any) -> dict[str, Any]:
    """What a policy's file says of a training with such options."""
    options = Options("Survey", **chosen)
    named = {
        name: str(value) if isinstance(value, Path) else value
        for name, value in vars(options).items()
    }
    return {"training": {"env": ENV, **named}, "made_with": made_with(options)}


def met(trained: dict[str, Any], **here: Any) -> list[str]:
    options = Options("Survey", **here)
    return differences(trained, ENV, options, known_of(options))


def test_what_is_left_to_the_default_is_no_difference() -> None:
    for difficulty in ("known", "uncertain", "harsh"):
        assert met(description(difficulty=difficulty), difficulty=difficulty) == []


@pytest.mark.parametrize(
    ("trained", "here", "expected"),
    [
        ({}, {"instruments": "meter", "weather": "changing"}, []),
        ({"instruments": "meter", "weather": "changing"}, {}, []),
        # nothing changes there
        ({"difficulty": "known"}, {"difficulty": "known", "weather": "changing"}, []),
        ({}, {"instruments": "gauge"}, ["instruments gauge (trained with the difficulty's)"]),
        ({"instruments": "exact"}, {}, ["instruments the difficulty's (trained with exact)"]),
        ({}, {"weather": "still"}, ["weather still (trained with the difficulty's)"]),
        ({}, {"difficulty": "harsh"}, ["difficulty harsh (trained with uncertain)"]),
        (
            {},
            {"difficulty": "harsh", "instruments": "exact"},
            [
                "difficulty harsh (trained with uncertain)",
                "instruments exact (trained with the difficulty's)",
            ],
        ),
    ],
)
def test_instruments_and_weather_are_compared_by_what_they_are(
    trained: dict[str, Any], here: dict[str, Any], expected: list[str]
) -> None:
    assert met(description(**trained), **here) == expected


def test_a_file_of_instruments_that_changed_is_noticed(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("soc_step = 0.01\n")
    trained = description(instruments=str(file))
    assert met(trained, instruments=str(file)) == []
    (tmp_path / "copy.toml").write_text("soc_step = 0.01  # the same\n")
    assert met(trained, instruments=str(tmp_path / "copy.toml")) == []
    file.write_text("soc_step = 0.02\n")
    assert met(trained, instruments=str(file)) == [
        f"instruments {file} (trained with other numbers)"
    ]


@pytest.mark.parametrize(
    "options", [Options("Survey"), Options("Survey", route="box"), Options("Patrol")]
)
def test_the_same_has_the_same_hashes(options: Options) -> None:
    hashes = [made_with(options)]
    for value in (1, 255):
        # What lies in memory that is handed out again must not matter.
        scraps = [
            np.full(size, value, np.uint8) for size in (500, 6_000, 50_000) for _ in range(20)
        ]
        del scraps
        hashes.append(made_with(options))
    assert hashes[0] == hashes[1] == hashes[2]


def test_other_routes_have_other_hashes() -> None:
    hashes = {
        made_with(Options("Survey", route=route))["route"]
        for route in ("generated", "box", "hidden_wind")
    }
    assert len(hashes) == 2  # two are drawn mission by mission, and told apart by name


def test_a_description_of_nothing_is_passed_over() -> None:
    assert met({}) == met({"training": 3, "made_with": None}) == []
