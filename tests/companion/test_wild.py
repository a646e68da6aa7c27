"""Whatever instruments say, the advice stays finite, in order and within what a battery can
hold."""

import dataclasses
import json
import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from homeward.companion import Advice, Companion, CompanionError, UncertainValue
from homeward.companion.limits import limits_of
from homeward.estimation.filter import place_of
from homeward.physics import d_max, load_robot
from tests.companion.robots import Driven

HUSKY = load_robot("husky")
FAR_M = limits_of(HUSKY, float(d_max(HUSKY))).way_m
TINY = 5e-324
NUMBERS = st.one_of(
    st.none(),
    st.floats(),
    st.floats(-10.0, 10.0),
    st.sampled_from(
        [TINY, -TINY, 1e-300, 3.4e38, 1e300, -1e300, 1e308, 10**400, -(10**400), FAR_M, 0.7 * FAR_M]
    ),
)
SIZES = st.one_of(
    st.floats(), st.floats(-100.0, 100.0), st.sampled_from([1e308, -1e300, 10**400, 0.7 * FAR_M])
)
COORDINATES = st.one_of(st.none(), st.tuples(SIZES, SIZES))
STEPS_S = st.one_of(
    st.sampled_from(
        [0.0, -1.0, TINY, 1e-6, 0.1, 1.0, 60.0, 1e4, 1e6, 1e9, 1e300, -1e300, math.inf, math.nan]
    ),
    st.floats(),
)
INSTRUMENTS = (
    "speed_mps", "power_w", "voltage_v", "current_a", "soc", "grade_rad", "heading_rad", "sensing_hz", "temperature_c",
    "interest",
)  # fmt: skip
READINGS = st.fixed_dictionaries({}, optional=dict.fromkeys(INSTRUMENTS, NUMBERS))


def check(advice: Advice, full_j: float) -> None:
    """The properties of every advice."""
    numbers = [
        value
        for field in dataclasses.fields(advice)
        for value in numbers_of(getattr(advice, field.name))
    ]
    assert all(map(math.isfinite, numbers)), advice
    for value in (advice.energy_left_j, advice.energy_home_j, advice.margin_j):
        assert value.low <= value.mean <= value.high, advice
    assert advice.energy_left_j.low >= 0.0 and advice.energy_left_j.high <= full_j, advice
    assert 0.0 <= advice.chance_home <= 1.0 and advice.energy_home_j.low >= 0.0, advice
    assert all("\n" not in text and len(text) < 200 for text in advice.warnings), advice.warnings
    assert advice.is_sound, advice
    json.dumps(advice.to_json(), allow_nan=False)
    assert "left; the way home" in str(advice)


def numbers_of(value: Any) -> list[float]:
    """Numbers of a field of an advice."""
    if isinstance(value, UncertainValue):
        return [value.mean, value.sd, value.low, value.high]
    return [value] if isinstance(value, float) else []


def test_no_reading_of_any_size_corrupts_the_advice_or_ends_it() -> None:
    @settings(max_examples=100, deadline=None)
    @given(
        st.sampled_from(["here", (0.0, 0.0), None]),
        st.sampled_from([None, 21.0]),
        st.lists(
            st.tuples(STEPS_S, READINGS, COORDINATES, NUMBERS, st.integers(0, 9)), max_size=25
        ),
    )
    def holds(home: Any, cutoff_v: float | None, drive: list[Any]) -> None:
        companion = Companion(HUSKY, home=home, cutoff_v=cutoff_v)
        at_home: Any = 0.0 if home is None else (0.0, 0.0)
        check(companion.update(0.0, speed_mps=0.0, position=at_home), HUSKY.usable_energy_j)
        time_s = 0.0
        for step_s, readings, coordinates, metres, event in drive:
            position = metres if home is None else coordinates
            if event == 0:
                told(companion.move_home, position)
            elif event == 1:
                told(companion.swap_battery, metres)
            elif event == 2:
                told(companion.charged, metres)
            after_s = time_s + step_s
            advice = companion.update(after_s, position=position, **readings)
            time_s = after_s if math.isfinite(after_s) else 0.0
            check(advice, HUSKY.usable_energy_j)

    holds()


def told(event: Any, value: Any) -> None:
    """Tell the companion of an event; a value that cannot be is refused in one line."""
    try:
        event(value)
    except CompanionError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("robot", ["husky", "turtlebot3_burger", "f1tenth", "rusti"])
@pytest.mark.parametrize("seed", range(2))
def test_long_regimes_at_the_limits_do_not_corrupt_it_either(robot: str, seed: int) -> None:
    """Each reading stays at what is just possible for a while: full power back into the battery,
    the longest gaps."""
    rng = np.random.default_rng(seed)
    companion = Companion(robot, home=(0.0, 0.0))
    limits = limits_of(companion.robot, float(d_max(companion.robot)))
    time_s = 0.0
    for _ in range(30):
        step_s = rng.choice([1e-6, 0.1, 1.0, 60.0, 3600.0, 0.99 * limits.gap_s])
        reading = {
            "speed_mps": rng.choice([0.0, limits.speed_mps, -limits.speed_mps, TINY]),
            "power_w": rng.choice([0.0, limits.power_w, -limits.power_w]),
            "soc": rng.choice([0.0, 1.0, rng.uniform()]),
            "grade_rad": rng.choice([0.0, 0.8, -0.8]),
        }
        position = tuple(rng.uniform(-0.7, 0.7, 2) * limits.way_m)
        for _ in range(15):
            time_s += step_s
            advice = companion.update(time_s, position=position, **reading)
            check(advice, companion.robot.usable_energy_j)


def test_positions_that_ended_the_process_are_left_out() -> None:
    """In a process of its own: it was ended by a signal."""
    code = (
        "from homeward.companion import Companion\n"
        "companion = Companion('husky', home='here')\n"
        "for second, east in enumerate([0.0, 1.0, 3.4e38, -1e300, 1e300, -1e308, 1e30, 1e19, 1e12, 2.0]):\n"
        "    advice = companion.update(6.3 + 0.1 * second, position=(east, 5.0))\n"
        "print(advice.way_home_m, advice.warnings)"
    )
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith(
        "2.0 ('impossible position left out: 7 (the last (1e+12, 5) m: farther than"
    )


def test_a_jump_that_no_robot_can_make_is_never_accepted() -> None:
    companion, robot = Companion("husky", home=(0.0, 0.0)), Driven()
    robot.drive(companion, 0.0, 60.0)
    for east_m in (1e300, 1.1 * FAR_M):
        advice = robot.drive(companion, 0.0, 20.0, position=(east_m, 0.0))
        assert any(text.startswith("impossible position left out") for text in advice.warnings)
        check(advice, HUSKY.usable_energy_j)
    assert advice.way_home_m == pytest.approx(100.0, abs=2.0)  # by dead reckoning
    far = robot.drive(companion, 0.0, 20.0, position=(0.5 * FAR_M, 0.0))
    assert far.turn_now and any("accepted as a jump" in text for text in far.warnings)


@pytest.mark.parametrize("home", [-1e308, 1e300, (1e300, 0.0), (0.0, 2.0 * FAR_M), 10**400])
def test_a_home_where_no_robot_can_come_is_refused(home: Any) -> None:
    companion, robot = Companion("husky", home=(0.0, 0.0)), Driven()
    before = robot.drive(companion, 0.0, 60.0)
    with pytest.raises(
        CompanionError, match=r"home = .* is not allowed; .* within 1.087e\+05 m of where it was"
    ):
        companion.move_home(home)
    assert companion.update(60.0) == dataclasses.replace(
        before, warnings=("repeated readings left out: 1",)
    )


@dataclasses.dataclass(frozen=True)
class Places:
    """A route of somebody else's, whose numbers nobody has checked."""

    place_m: float
    grade_rad: np.ndarray[Any, np.dtype[np.float64]]
    heading_rad: np.ndarray[Any, np.dtype[np.float64]]


def flat(places: int, place_m: float) -> Places:
    return Places(place_m, np.zeros(places), np.zeros(places))


@pytest.mark.parametrize(
    ("route", "said"),
    [
        (flat(10, 1e300), "the route is 1e\\+301 m long"), (flat(10, math.nan), "the route is nan m long"),
        (flat(1000, 200.0), "the route is 2e\\+05 m long"),
        (dataclasses.replace(flat(3, 50.0), grade_rad=np.array([0.0, math.nan, 0.0])), "slopes up to nan rad"),
        (dataclasses.replace(flat(3, 50.0), grade_rad=np.array([0.0, 5.0, 0.0])), "slopes up to 5 rad"),
        (dataclasses.replace(flat(3, 50.0), heading_rad=np.array([0.0, 1e300, 0.0])), "headings up to 1e\\+300"),
        (dataclasses.replace(flat(3, 50.0), heading_rad=np.array([0.0, 0.0])), "3 slopes and 2 headings"),
    ],
)  # fmt: skip
def test_a_route_that_no_robot_can_drive_is_refused(route: Places, said: str) -> None:
    with pytest.raises(CompanionError, match=said):
        Companion("husky", route=route)
    with pytest.raises(CompanionError, match=said):
        Companion("husky", home="here").take_home(route)


def test_home_beyond_the_earth_is_refused() -> None:
    with pytest.raises(CompanionError, match=r"home = .* is not allowed"):
        Companion("husky", home=(1e300, 0.0))


def test_a_clock_that_is_set_forward_goes_on() -> None:
    """As of a computer without a battery for its clock: it begins in 1970, until it hears the
    time."""
    companion, robot = Companion("husky", home=(0.0, 0.0)), Driven()
    before = robot.drive(companion, 0.0, 600.0)
    robot.time_s += 1.7e9
    after = robot.drive(companion, 0.0, 1.0)
    assert after.time_s == pytest.approx(before.time_s + 1.0)
    assert after.energy_left_j.mean == pytest.approx(before.energy_left_j.mean, rel=1e-3)
    assert any(text.startswith("the clock was set forward by") for text in after.warnings)


@given(st.floats(), st.floats(1e-3, 1e6), st.integers(1, 200))
def test_every_position_has_a_place(position_m: float, place_m: float, count: int) -> None:
    number = place_of(flat(1, place_m), position_m, range(count))
    assert 0 <= number < count
    if 0.0 <= position_m < place_m * count:
        assert number == min(int(position_m / place_m), count - 1)
    elif position_m >= place_m * count:
        assert number == count - 1
