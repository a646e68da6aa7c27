"""Tables of benchmarks: figures stand with their intervals, and names on the left."""

from benchmarks.tables import rate, span, table


def test_figures_have_their_intervals() -> None:
    assert span(0.5, (0.25, 1.0), ".0%") == "50% (25% to 100%)"
    assert span(-1.25, [-2.0, 0.0], "+.3g") == "-1.25 (-2 to +0)"
    assert rate(9, 10, ".1%") == "90.0% (59.6% to 98.2%)"  # Newcombe 1998's formula by hand


def test_names_are_aligned_left() -> None:
    made = table("drives", ("robot",), ("score", "stranded"))
    assert [(one.header, one.justify) for one in made.columns] == [
        ("robot", "left"), ("score", "right"), ("stranded", "right"),
    ]  # fmt: skip
