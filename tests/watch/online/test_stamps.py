"""Time by stamps goes on, whatever the clock of the messages does."""

import pytest

from homeward.watch.online.stamps import Stamps


def fed(pairs: list[tuple[float | None, float]]) -> tuple[Stamps, list[float | None]]:
    stamps = Stamps()
    return stamps, [stamps.see(stamp_s, now_s) for stamp_s, now_s in pairs]


def test_it_is_that_of_the_stamps() -> None:
    _, times = fed(
        [(100.0, 7.0), (100.1, 7.3), (100.2, 7.31), (100.2, 7.4), (100.15, 7.45), (100.4, 7.5)]
    )
    assert times == pytest.approx([0.0, 0.1, 0.2, None, None, 0.4])


@pytest.mark.parametrize(
    ("stamp_s", "said"), [(3701.0, "set forward by 1 h 00 min"), (1.0, "set back by 100 s")]
)
def test_a_jump_is_said_and_time_goes_on_as_before(stamp_s: float, said: str) -> None:
    stamps, times = fed([(100.0, 0.0), (stamp_s, 1.0)])
    assert times == [0.0, 1.0] and stamps.said is not None and said in stamps.said
    assert stamps.see(stamp_s + 0.5, 1.6) == pytest.approx(1.5)
    assert stamps.said is None


def test_a_clock_that_stands_still_is_said() -> None:
    stamps, times = fed([(100.0, 0.0), *((100.0, 0.5 * k) for k in range(1, 6))])
    assert times == [0.0, None, None, None, None, 2.5] and "stood still by 2 s" in (
        stamps.said or ""
    )


def test_without_stamps_it_is_the_time_of_receipt() -> None:
    assert fed([(None, 5.0), (None, 5.5), (None, 6.0)])[1] == [0.0, 0.5, 1.0]


def test_a_simulation_may_run_faster_or_slower() -> None:
    assert fed([(8.0 * t, t) for t in (0.0, 0.1, 0.2, 0.3)])[1] == pytest.approx(
        [0.0, 0.8, 1.6, 2.4]
    )


def test_a_gap_is_as_long_as_it_was() -> None:
    stamps, times = fed([(100.0, 0.0), (100.1, 0.1), (130.1, 30.2)])
    assert times[-1] == pytest.approx(30.1) and stamps.said is None


def test_without_messages_it_goes_on_a_second_behind() -> None:
    stamps, _ = fed([(100.0, 0.0), (101.0, 1.0)])
    assert stamps.without(5.0) == pytest.approx(4.0) and stamps.without(1.5) == pytest.approx(1.0)
    assert stamps.see(105.05, 5.1) == pytest.approx(5.05)
