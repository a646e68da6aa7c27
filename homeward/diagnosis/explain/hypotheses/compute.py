"""Computing while sensing: the same at any sensing rate, with the rate, or rising with it in any way."""

from collections.abc import Iterator

from homeward.diagnosis.explain.hypothesis import Hypothesis, Setting
from homeward.physics.effects.compute import EFFECT


def _at_any_rate(setting: Setting) -> Iterator[dict[str, float]]:
    yield {"base_share": 1.0}


HYPOTHESIS = Hypothesis(
    EFFECT, shapes=_at_any_rate, rises_with="sensing_hz", check="put a clamp meter on the lead of the computer"
)
