"""The benchmark of conditions: shares are of the same episodes, and rules are compared at equal
stranding."""

import numpy as np
import pytest

from benchmarks.agents import conditions
from benchmarks.agents.conditions import Args, gain_on, main, share_of
from homeward.agents.evaluation import Episodes
from homeward.envs.options import OptionError


def episodes(score: list[float]) -> Episodes:
    scores = np.array(score)
    stranded, nothing = scores == 0.0, np.zeros(len(score))
    return Episodes(
        scores, ~stranded, stranded, stranded, nothing, nothing, nothing, nothing.astype(np.int64)
    )


def test_shares_are_of_the_same_episodes() -> None:
    shown = share_of(np.array([10.0, 20.0, 10.0, 20.0]), np.array([10.0, 30.0, 0.0, 40.0]), 0)
    assert shown.startswith("75.0% (")
    assert share_of(np.ones(2), np.zeros(2), 0) == ""


def test_a_rule_is_read_off_its_line_at_equal_stranding() -> None:
    rule = {0.0: episodes([20.0, 20.0, 0.0, 0.0]), 1.0: episodes([8.0, 8.0, 8.0, 8.0])}
    score, gain = gain_on(rule, episodes([12.0, 12.0, 12.0, 0.0]), np.full(4, 0.25))
    assert score == pytest.approx(9.0) and gain == pytest.approx(0.0)
    # more strand
    assert gain_on({0.0: rule[0.0]}, episodes([1.0] * 4), np.full(4, 0.25)) == (None, None)


def test_tables_are_printed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conditions, "RULES", ["dmax"])
    main(Args(("OutAndBack",), episodes=8))
    printed = capsys.readouterr().out
    for expected in (
        "8 episodes, episode_seeds(0, 8)",
        "of exact (95 %)",
        "dmax",
        "planner above it",
    ):
        assert expected in printed


def test_what_cannot_be_run_is_refused() -> None:
    with pytest.raises(OptionError, match="at least 2 --episodes"):
        main(Args(episodes=1))
