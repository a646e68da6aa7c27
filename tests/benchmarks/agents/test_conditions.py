"""The benchmark of conditions: shares are of what they say, and rules are compared at equal stranding."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.agents import conditions
from benchmarks.agents.conditions import CONDITIONS, EXACT, Args, main, rows_of, score_at
from benchmarks.agents.tune import RULES
from homeward.agents import AgentError
from homeward.agents.evaluation import Episodes
from homeward.envs.options import OptionError, Options, constants_of


def episodes(score: list[float]) -> Episodes:
    scores = np.array(score)
    stranded, nothing = scores == 0.0, np.zeros(len(score))
    return Episodes(scores, ~stranded, stranded, stranded, nothing, nothing, nothing, nothing.astype(np.int64))


def test_exact_conditions_differ_in_the_instruments_alone() -> None:
    for condition, exact in EXACT.items():
        one, other = (constants_of(Options("OutAndBack", **CONDITIONS[name])) for name in (condition, exact))
        assert one[0].difficulty == other[0].difficulty
        np.testing.assert_array_equal(one[1].record, other[1].record)
        assert other[0].instruments == constants_of(Options("OutAndBack", difficulty="known"))[0].instruments
        assert one[0].instruments != other[0].instruments


def test_shares_are_of_the_same_episodes() -> None:
    found = {
        "uncertain, exact": {"planner": episodes([10.0, 30.0, 0.0, 40.0])},
        "uncertain": {"planner": episodes([10.0, 20.0, 10.0, 20.0])},
    }
    exact, metered = rows_of("OutAndBack", found, 0)
    assert exact["stranded_rate"] == 0.25 and "of_exact" not in exact
    assert metered["of_exact"] == pytest.approx(60.0 / 80.0)
    low, high = metered["of_exact_ci95"]
    assert low < metered["of_exact"] < high


@pytest.mark.parametrize(
    ("most", "expected"), [(0.0, 7.0), (0.1, 7.5), (0.2, 8.0), (0.3, 9.0), (0.4, 10.0), (0.5, 10.0), (0.9, 10.0)]
)
def test_a_rule_is_read_off_its_line_at_equal_stranding(most: float, expected: float) -> None:
    curve = ([4.0, 10.0, 8.0, 7.0], [0.6, 0.4, 0.2, 0.0])  # where still more strand, it scores less
    assert score_at(*curve, most) == pytest.approx(expected)


def test_there_is_no_score_where_more_strand_with_every_reserve() -> None:
    assert score_at([4.0, 3.0], [0.2, 0.1], 0.05) is None


def test_tables_are_printed_and_figures_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conditions, "RULES", {"dmax": (RULES["dmax"][0], (0.1, 0.3))})
    main(Args(("OutAndBack",), ("dmax_adaptive", "planner"), episodes=8, out=tmp_path))
    printed = capsys.readouterr().out
    content = json.loads((tmp_path / "conditions.json").read_text())
    assert len(content["rows"]) == 2 * len(CONDITIONS) and len(content["curves"]) == 2
    assert content["curves"][0]["reserves"] == pytest.approx([0.1, 0.3, 0.375, 0.45, 0.6])
    for told in ("8 episodes, episode_seeds(0, 8)", "of exact (95 %)", "dmax_adaptive", "planner above it"):
        assert told in printed


def test_what_cannot_be_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="at least 2 --episodes"):
        main(Args(episodes=1, out=tmp_path))
    with pytest.raises(AgentError, match="--agents of random"):
        main(Args(agents=("sleepy",), out=tmp_path))
