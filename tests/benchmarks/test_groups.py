"""Large differences of groups are counted apart from the test that names them."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.groups import Args, alarms_of, main, pairs_of
from homeward.groups.comparison import Quantity, compare, comparison_of
from homeward.logs.recordings import Recording

LABELS = ["low"] * 3 + ["high"] * 3 + ["alone"]
POWER_W = [5.0, 5.1, 4.9, 6.0, 6.1, 5.9, 9.0]


@pytest.fixture
def written() -> str:
    values = {Quantity("P_anc", "W"): np.array(POWER_W)}
    levels, differences = compare(LABELS, values)
    recordings = [Recording(f"{number}.csv", "", {}) for number in range(len(LABELS))]
    return comparison_of("standing", recordings, LABELS, values, levels, differences, []).to_json()


def test_a_difference_is_counted_in_spreads_of_runs(written: str) -> None:
    (pair,) = pairs_of(json.loads(written))
    assert pair.groups == "high - low" and pair.named
    assert pair.difference == pytest.approx(1.0)
    assert pair.spreads == pytest.approx(10.0)  # of a standard deviation of 0.1


def test_what_is_large_and_not_named_is_printed(
    written: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    comparison = json.loads(written)
    comparison["differences"] = []
    (tmp_path / "groups.json").write_text(json.dumps(comparison))
    main(Args((tmp_path / "groups.json",)))
    said = capsys.readouterr().out
    assert "named: 0 of 1 above 3 spreads" in said and "not compared" in said


def test_runs_dealt_at_random_differ_as_often_as_the_groups_are_dealt_again(written: str) -> None:
    """Of 20 ways to deal six runs to two groups, two are the groups themselves."""
    comparison = json.loads(written)
    comparison["runs"] = comparison["runs"][:6]
    assert 3 <= alarms_of(comparison, 100) <= 20


def test_groups_without_any_spread_differ_infinitely_or_not_at_all(written: str) -> None:
    comparison = json.loads(written)
    for low_w, high_w, spreads in ((5.0, 5.0, 0.0), (5.0, 6.0, np.inf)):
        for run in comparison["runs"]:
            run["values"]["P_anc"] = high_w if run["group"] == "high" else low_w
        (pair,) = pairs_of(comparison)
        assert pair.spreads == spreads


def test_a_comparison_of_another_format_is_refused_in_a_line(written: str, tmp_path: Path) -> None:
    older = json.loads(written) | {"schema": 1}
    (tmp_path / "groups.json").write_text(json.dumps(older))
    with pytest.raises(SystemExit, match="has format 1, and 2 is read: compare the groups again"):
        main(Args((tmp_path / "groups.json",)))
