"""Texts on what has changed, and the order to turn that is said again."""

from dataclasses import replace

from homeward.companion import Companion
from homeward.watch.online.link import News
from homeward.watch.online.texts import Severity, Texts


def test_a_text_is_sent_when_it_is_new_and_an_order_again() -> None:
    companion = Companion("husky")
    companion.update(0.0, position=100.0)
    advice = companion.update(1.0, position=100.0)
    texts, calm = Texts(), News(advice, 1.7e6, "husky", [], False)
    turn = calm._replace(advice=replace(advice, turn_now=True))
    dark = calm._replace(warnings=["nothing on ATTITUDE for 3 s"])
    later = calm._replace(warnings=["nothing on ATTITUDE for 4 s"])
    assert list(texts.due(calm, 0.0)) == []
    assert list(texts.due(dark, 1.0)) == [
        (Severity.WARNING, "homeward: nothing on ATTITUDE for 3 s")
    ]
    assert list(texts.due(later, 2.0)) == []
    order = (Severity.CRITICAL, "homeward: TURN NOW, way home 100 m")
    assert list(texts.due(turn, 3.0)) == [order]
    assert [list(texts.due(turn, at_s)) for at_s in (4.0, 33.0)] == [[], [order]]
    assert list(texts.due(calm, 34.0)) == [(Severity.NOTICE, "homeward: need not turn any more")]
