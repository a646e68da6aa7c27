"""Live readings that no motion explains are left out by the bounds of files, and what stays is
believed."""

from homeward.watch.online.spikes import Spikes
from tests.watch.online.test_listener import Bench, odometry


def test_a_spike_is_left_out_and_what_stays_is_believed() -> None:
    spikes = Spikes(max_speed_mps=1.0)
    speeds = [0.5] * 5 + [9.0] + [0.5] * 5 + [1.6] + [0.5] * 5
    assert [spikes.see("speed_mps", speed, 0.1 * tick) for tick, speed in enumerate(speeds)].count(
        True
    ) == 2
    assert spikes.counts == {"speed_mps": 2}
    heights = [100.0] * 5 + [200.0] * 5  # another datum
    seen = [spikes.see("elevation_m", height, 0.1 * tick) for tick, height in enumerate(heights)]
    assert seen == [False] * 5 + [True] * 3 + [False] * 2
    # After a minute without readings a robot may be elsewhere.
    assert not spikes.see("elevation_m", 300.0, 60.0) and not spikes.see("power_w", 1e6, 0.0)


def test_a_robot_that_is_always_fast_is_left_to_the_companion() -> None:
    spikes = Spikes(max_speed_mps=1.0)
    assert not any(spikes.see("speed_mps", 3.6, 0.1 * tick) for tick in range(9))


def test_a_spike_does_not_enter_the_mean_of_a_moment() -> None:
    bench = Bench()
    bench.feed(29, odom=lambda t: odometry(t, t))
    for part in range(3):  # three messages in a moment, the second of them wrong
        bench.listener.hear(
            "/odom", odometry(2.9, 2.9, speed=60.0 if part == 1 else 1.0), 1, 2.9 + 0.01 * part
        )
    heard = bench.listener.take(2.93)
    assert heard is not None and heard.reading["speed_mps"] == 1.0
    said = "readings of speed_mps that no motion explains are left out: 1 (the last 60)"
    assert said in bench.listener.warnings(3.0)
