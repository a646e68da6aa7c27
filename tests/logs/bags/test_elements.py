"""A list of batteries in one message is several batteries, by their names or their places."""

from types import SimpleNamespace

import pytest

from homeward.logs.bags.elements import elements_reader
from homeward.logs.bags.messages import WrongField


def pack(current: float, location: str = "") -> SimpleNamespace:
    return SimpleNamespace(current=current, location=location)


def test_each_element_is_a_battery() -> None:
    read = elements_reader(["total", "packs[*].current"])
    named = read(SimpleNamespace(total=3.0, packs=[pack(1.0, "left"), pack(2.0, "right")]), "")
    assert [element.part for element in named] == ["left", "right"]
    assert named[1].values == {"total": 3.0, "packs[*].current": 2.0}
    nameless = read(SimpleNamespace(total=3.0, packs=[pack(1.0), pack(2.0), pack(3.0)]), "")
    assert [element.part for element in nameless] == ["0", "1", "2"]
    assert read(SimpleNamespace(total=3.0, packs=[]), "") == []
    (whole,) = elements_reader(["total"])(SimpleNamespace(total=3.0), "")
    assert whole == ("", {"total": 3.0})


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (SimpleNamespace(packs=[pack(1.0)] * 17), "has 17 elements, more than the 16 batteries"),
        (SimpleNamespace(packs=1.0), "is not of a list but of float"),
        (SimpleNamespace(cells=[]), "no field 'packs'"),
    ],
)
def test_what_is_no_list_of_batteries_is_said(message: SimpleNamespace, why: str) -> None:
    with pytest.raises(WrongField, match=why):
        elements_reader(["packs[*].current"])(message, "")
