"""The table of topics, types and quality of service."""

from homeward.watch.ros2.interface import OWN, PUBLICATIONS, PUBLISHED, SUBSCRIPTIONS, name_in


def test_subscriptions_match_every_publisher_and_publications_every_subscriber() -> None:
    """But those that request transient local: old advice is worse than none."""
    assert (SUBSCRIPTIONS.reliability, PUBLICATIONS.reliability) == ("best_effort", "reliable")
    assert SUBSCRIPTIONS.durability == PUBLICATIONS.durability == "volatile"
    assert SUBSCRIPTIONS.depth > PUBLICATIONS.depth == 1


def test_advice_is_published_below_the_namespace() -> None:
    own = [topic for topic in PUBLISHED if topic.startswith(f"/{OWN}/")]
    assert set(PUBLISHED) - set(own) == {"/diagnostics"}
    assert all(name_in("/r1", topic) == f"/r1{topic}" for topic in own)
