"""Scores and refusals outlive the names, where another explanation takes their place."""

from homeward.diagnosis.explain.named import Naming, Ranked, Refused
from homeward.diagnosis.result import Checked


def test_without_names_the_scores_and_refusals_stay() -> None:
    ranking = (Ranked("turning", "steady", 12.0, 0.4),)
    refused = (Refused("wind", (Checked("gain", 0.02, "at least", 0.1, holds=False),)),)
    naming = Naming(ranking=ranking, absorbed={"wind": 0.3}, unrecorded=True, refused=refused)
    assert naming.nothing_named() == Naming(
        ranking=ranking, absorbed={"wind": 0.3}, refused=refused
    )
