"""The picture of learning curves shows their numbers, and the other agents' as levels."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from homeward.agents.evaluation import learning_plot
from homeward.agents.evaluation.learning_curve import EvaluatedCurve, Point
from homeward.agents.evaluation.learning_plot import learning_png
from tests.agents.evaluation.runs import compared, made_up

CURVES = {
    "ppo": [
        EvaluatedCurve(
            [Point(0, 0.0, 1.0, 0.5, 0.0), Point(2_000_000, 9.0, 2.5, 0.75, 0.0)],
            [Point(0, 0.0, 1.0, 0.5, 0.0), Point(2_000_000, 9.0, 3.0, 0.25, 0.0)],
        ),
        EvaluatedCurve(
            [Point(0, 0.0, 1.5, 0.75, 0.0), Point(2_000_000, 9.0, 2.0, 0.0, 0.0)],
            [Point(0, 0.0, 1.5, 0.75, 0.0), Point(2_000_000, 9.0, 2.0, 0.0, 0.0)],
        ),
    ]
}


def test_it_is_a_picture() -> None:
    evaluation = compared(ppo=made_up([3.0, 2.0]), dmax=made_up([2.0, 4.0]))
    assert learning_png(
        evaluation, evaluation.summary(np.random.default_rng(0)), CURVES
    ).startswith(b"\x89PNG")


@pytest.fixture
def axes(monkeypatch: pytest.MonkeyPatch) -> list[Axes]:
    """Of scores and of strandings."""
    drawn: list[Figure] = []

    def keep(figure: Figure) -> bytes:
        drawn.append(figure)
        return b""

    monkeypatch.setattr(learning_plot, "png", keep)
    evaluation = compared(
        ppo=made_up([0.0, 2.0, 3.0, 9.0]),
        dmax=made_up([0.0, 4.0, 4.0, 4.0], [True, False, False, False]),
    )
    learning_png(evaluation, evaluation.summary(np.random.default_rng(0)), CURVES)
    return drawn[0].axes


def curves(axes: Axes) -> list[tuple[list[float], list[float]]]:
    """Abscissas and ordinates of the lines that are no levels."""
    lines = [line for line in axes.lines if line.get_linestyle() == "-"]
    return [
        (np.asarray(line.get_xdata()).tolist(), np.asarray(line.get_ydata()).tolist())
        for line in lines
    ]


def levels(axes: Axes) -> list[float]:
    return [
        float(np.asarray(line.get_ydata())[0])
        for line in axes.lines
        if line.get_linestyle() == "--"
    ]


def test_scores_and_strandings_stand_over_millions_of_decisions(axes: list[Axes]) -> None:
    above, below = axes
    assert curves(above) == [([0.0, 2.0], [1.0, 3.0]), ([0.0, 2.0], [1.5, 2.0])]
    assert curves(below) == [([0.0, 2.0], [50.0, 25.0]), ([0.0, 2.0], [75.0, 0.0])]


def test_every_agent_has_its_level(axes: list[Axes]) -> None:
    above, below = axes
    assert levels(above) == [3.5, 3.0]
    assert levels(below) == [0.0, 25.0]


def test_the_legend_names_an_agent_once_and_says_which_policy_was_kept(axes: list[Axes]) -> None:
    legend = axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "ppo, kept",
        "ppo, at that time",
        "ppo",
        "dmax",
    ]
