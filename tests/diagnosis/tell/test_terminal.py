"""The terminal shows the same verdict, within its width, and nothing that a file's name could do to
it."""

import io
from collections.abc import Callable
from dataclasses import replace

import pytest
from rich.console import Console

from homeward import Robot
from homeward.diagnosis import Analysis, Recording, analyse
from homeward.diagnosis.tell.next_drive import GUIDE
from homeward.diagnosis.tell.report import report_html
from homeward.diagnosis.tell.terminal import show
from tests.diagnosis.made_up import ends

Drive = Callable[..., list[Recording]]


def shown(analysis: Analysis, width: int = 80, encoding: str = "utf-8") -> str:
    file = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    show(analysis, Console(file=file, width=width))
    file.seek(0)
    return file.read()


@pytest.mark.parametrize("width", [50, 80, 200])
def test_lines_keep_within_the_terminal(scrubbing: Analysis, width: int) -> None:
    text = shown(scrubbing, width)
    assert max(map(len, text.splitlines())) <= width
    words = " ".join(text.split())
    (effect,) = scrubbing.diagnosis.missing_physics
    assert words.startswith(f"missing_physics {scrubbing.diagnosis.summary}")
    low, high = ends(effect.parameters["scrub"])
    assert (
        f"scrub = {effect.parameters['scrub'].value:.3f} (95 %: {low:.3f} to {high:.3f})" in words
    )
    assert scrubbing.diagnosis.fit is not None
    for name, arm in scrubbing.diagnosis.fit.arms.items():
        (row,) = [
            line.split()
            for line in text.splitlines()
            if line.strip().startswith(name.replace("_", " ") + " ")
        ]
        assert f"{arm.rmse:#.3g}" in row and f"{arm.r2:.3f}" in row


def test_the_next_experiment_names_the_page_that_says_how(scrubbing: Analysis) -> None:
    open_question = replace(
        scrubbing, diagnosis=replace(scrubbing.diagnosis, next_experiment="To see, drive.")
    )
    words = " ".join(shown(open_question).split())
    assert words.endswith(f"Next experiment: To see, drive. How to drive and record it: {GUIDE}.")
    assert f"How to drive and record it: {GUIDE}" in report_html(open_question)


def test_names_are_no_markup_and_no_control_sequences(short_drive: Drive, husky: Robot) -> None:
    (run,) = short_drive(husky, runs=1)
    silent = {**run.channels, "power_w": 0.0 * run.channels["power_w"]}
    name = "[red]run \x1b[2J\udcff漢.csv"
    analysis = analyse([replace(run, name=name, channels=silent)], husky)
    text = shown(analysis)
    assert "[red]run ?[2J?漢.csv" in text and "\x1b" not in text
    assert "??.csv the recorded power" in " ".join(
        shown(analysis, encoding="ascii").split()
    ).replace("?.csv", "??.csv", 0)
