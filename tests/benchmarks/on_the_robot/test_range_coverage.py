"""The benchmark of coverage: what is drawn, and a part run."""

from pathlib import Path

import pytest

from benchmarks.on_the_robot.range_coverage import Args, CoverageError, coverage, main


def test_what_is_not_independent_is_drawn_together() -> None:
    """Two robots of ten drives each: with one all in, with the other none, nothing is known of the
    share."""
    scores = [
        {"site": site, "run": str(run), "covered": float(site == "a")}
        for site in "ab"
        for run in range(10)
    ]
    assert coverage(scores, ("site",), "covered", 0) == (0.5, 0.0, 1.0)
    share, low, high = coverage(scores, ("site", "run"), "covered", 0)
    assert share == 0.5 and 0.25 < low < 0.4 and 0.6 < high < 0.75


def test_a_rover_is_diagnosed_and_watched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("scoringrules", reason="needs the extra scores")
    from benchmarks.concealed.plants import rover_scenarios

    monkeypatch.setattr(rover_scenarios, "RUN_S", 30.0)
    args = Args(("rover",), robots=2, seed=0, out=tmp_path)
    found = main(args)
    scores = [one for proof in found["rover"] for one in proof["scores"]]
    assert len(scores) == 8 and all(
        0.0 <= one["covered"] <= 1.0 and one["crps"] < one["nominal"] for one in scores
    )
    assert main(args) == found  # finished sites are kept


def test_arguments_that_cannot_be_used(tmp_path: Path) -> None:
    with pytest.raises(CoverageError, match="--parts"):
        main(Args(("moon",), out=tmp_path))
