"""What the diagnosis compares with is counted from its code."""

from benchmarks.thresholds import NO_LIMITS, named, written
from homeward.diagnosis import thresholds


def test_every_threshold_is_counted_with_its_readers() -> None:
    readers = named()
    all_names = {name for name in vars(thresholds) if name.isupper()}
    assert set(readers) <= all_names and "NO_WORSE" in all_names - set(readers), (
        "it follows from another"
    )
    assert "explain/conditions.py" in readers["SMALLEST_GAIN_TO_NAME"]
    assert set(readers) > NO_LIMITS


def test_numbers_that_stand_in_a_comparison_are_found_and_counts_of_things_are_not() -> None:
    texts = [text for _, text in written()]
    assert any("_MOST_LOADS" in text for text in texts)
    assert any("3.6" in text for text in texts)
    assert "len(ancillary) == 2" not in texts
