"""Every mission's evaluation can be drawn."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from homeward.agents.evaluation import episode_plots, episode_seeds, run_episodes
from homeward.agents.evaluation.episode_plots import episode_png, route_png
from homeward.agents.evaluation.plots import png, profiles_png, scores_png
from homeward.agents.evaluation.summary import Evaluation
from homeward.envs.options import Options
from tests.agents.evaluation.runs import policy


@pytest.mark.parametrize("mission", ["OutAndBack", "Survey", "Patrol"])
def test_pictures_are_drawn(mission: str, monkeypatch: pytest.MonkeyPatch) -> None:
    titles: list[str] = []

    def titled(figure: Figure) -> bytes:
        titles.append(figure.get_suptitle())
        return png(figure)

    monkeypatch.setattr(episode_plots, "png", titled)
    options = Options(mission, difficulty="harsh")
    runs = {
        name: run_episodes(policy(name, options), options, episode_seeds(0, 8))
        for name in ("random", "dmax")
    }
    result = Evaluation(
        f"homeward/{mission}-v0",
        options,
        0,
        episode_seeds(0, 8),
        {name: [run] for name, run in runs.items()},
    )
    rng = np.random.default_rng(0)
    summary = result.summary(rng)
    for picture in (
        scores_png(result, summary), profiles_png(result, summary, rng), episode_png(result), route_png(result)
    ):  # fmt: skip
        assert picture.startswith(b"\x89PNG")
    assert ("shaded by interest" in titles[-1]) == (mission == "Survey")
