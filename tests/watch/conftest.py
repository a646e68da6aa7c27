"""The network of the tests."""

import pytest


@pytest.fixture
def loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing leaves this computer: neither from here nor from the processes that are started."""
    from homeward.watch.online import listener, session  # only now: they need the extra ros2
    from homeward.watch.ros2 import LOOPBACK

    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setattr(listener, "_SETTLES_S", 0.5)
    monkeypatch.setattr(session, "_WAITS_S", 1.0)
