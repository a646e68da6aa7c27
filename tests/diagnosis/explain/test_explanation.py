"""What is named gives way to a channel that explains more, and to none that only stands for time."""

from types import SimpleNamespace
from typing import Any

import pytest

from homeward.diagnosis.explain.explanation import _of_another_channel


@pytest.mark.parametrize(
    ("channel", "share", "gives_way"),
    [("temperature_c", 0.7, True), ("temperature_c", 0.4, False), ("speed_mps", 0.7, False), ("soc", 0.7, False)],
)
def test_an_effect_gives_way_to_a_channel_that_explains_more(channel: str, share: float, gives_way: bool) -> None:
    """Viscous friction explains half; what is left depends on a channel that explains a share."""
    term: Any = SimpleNamespace(hypothesis=SimpleNamespace(channels=("speed_mps",)))
    naming: Any = SimpleNamespace(named=(SimpleNamespace(term=term, rivals=(), held_out_gain=0.5),))
    most: Any = SimpleNamespace(channel=SimpleNamespace(name=channel), held_out_gain=share)
    remains: Any = SimpleNamespace(channel=channel)
    assert _of_another_channel(naming, remains, most) == gives_way
