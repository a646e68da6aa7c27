"""A companion that goes on from a saved state is as one that was never stopped; damage is refused
in one line."""

import base64
import copy
import dataclasses
import json
import math
import pickle
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from homeward.companion import Action, Advice, Companion, CompanionError
from homeward.companion.saved import sealed
from homeward.envs.routes import Route
from homeward.estimation import Prior
from homeward.physics import load_robot
from tests.companion.test_wild import check

SECONDS = 700
AFTER = 25
"""Updates after a restart that are compared; after them all that the companion holds is."""


def hill() -> Route:
    nothing = np.zeros(60)
    return Route(50.0, 0.05 * np.sin(np.arange(60.0)), nothing, nothing, nothing)


KINDS: dict[str, dict[str, Any]] = {
    "positions": {"home": (0.0, 0.0)},
    "first place": {"home": "here", "soc": 0.9, "docks": {"bay": (300.0, 50.0)}},
    "metres": {"home": None},
    "dead reckoning": {"home": (0.0, 0.0)},
    "route": {"route": hill()},
    "cut-off": {"home": (0.0, 0.0), "cutoff_v": 21.0, "window_s": 10.0},
    "moved home": {"home": (0.0, 0.0)},
}


def step(companion: Companion, kind: str, second: int) -> Advice:
    """A second of a drive out and back, with readings that are noisy, lost, repeated and late."""
    rng = np.random.default_rng(second)
    if kind == "moved home" and second == 300:
        companion.move_home((150.0, 40.0))
    if second == 450 and kind == "first place":
        companion.charged(0.8)
    elif second == 450:
        companion.swap_battery(0.8)
    # A gap, and a clock that is set back.
    time_s = second + (120.0 if second > 200 else 0.0) - (500.0 if second > 550 else 0.0)
    if second % 37 == 0:
        time_s -= 5.0
    outwards = second < 400
    way_m = float(second if outwards else 800 - second)
    reading: dict[str, Any] = {
        "speed_mps": 1.0 + 0.05 * rng.normal(), "soc": round(1.0 - second * 150.0 / 1.73e6, 3),
        "grade_rad": 0.02 * math.sin(0.01 * way_m),
        "heading_rad": 0.3 * math.sin(0.02 * second) + (0.0 if outwards else math.pi),
    }  # fmt: skip
    power_w = 150.0 + 20.0 * rng.normal()
    reading |= (
        {"voltage_v": 24.0, "current_a": power_w / 24.0}
        if kind == "cut-off"
        else {"power_w": power_w}
    )
    if kind == "metres":
        reading["position"] = way_m
    elif kind not in ("route", "dead reckoning") and second % 90 < 80:
        reading["position"] = (way_m + rng.normal(), rng.normal())
    lost = rng.choice(["power_w", "soc", "grade_rad", "heading_rad", "none"])
    reading.pop(str(lost), None)
    if second % 101 == 50:
        reading["speed_mps"] = 99.0
    return companion.update(time_s, **reading)


@pytest.mark.parametrize("kind", KINDS)
def test_a_restart_at_any_moment_changes_nothing(kind: str, tmp_path: Path) -> None:
    """Before the first reading, in the middle of a window, in a gap, after home moved, after a
    swap.

    One kind is restarted at all of these moments, and the others each at every second one, in turn.
    """
    moments: tuple[int, ...] = (0, 1, 7, 61, 199, 201, 202, 299, 301, 449, 451, 552, 555, 640)
    if kind != "positions":
        moments = moments[list(KINDS).index(kind) % 2 :: 2]
    companion = Companion("husky", **KINDS[kind])
    advised, states = [], {}
    for second in range(SECONDS):
        if second in moments:
            companion.save(tmp_path / f"{second}.json")
        if second - AFTER in moments:
            states[second] = json.dumps(companion.state())
        advised.append(step(companion, kind, second))
    assert len({advice.energy_home_j.mean for advice in advised}) > 0.9 * SECONDS
    for moment in moments:
        other = Companion("husky", **KINDS[kind])
        other.load(tmp_path / f"{moment}.json")
        for second in range(moment, moment + AFTER):
            assert step(other, kind, second) == advised[second], (moment, second)
        # NaN is not equal to itself, its text is
        assert json.dumps(other.state()) == states[moment + AFTER], moment


ARGUMENTS: dict[str, Any] = {
    "home": (1.0, 2.0), "risk": 0.25, "soc": 1.0, "forecast_mps": (1.0, 2.0), "cutoff_v": 21.0,
    "capacity_j": 1_500_000.0, "cruise_mps": 1.0, "window_s": 8.0, "place_m": 64.0, "reaction_s": 4.0, "arrived_m": 8.0,
    "docks": {"bay": (9.0, 8.0)}, "prior": Prior(capacity=0.75),
}  # fmt: skip
READINGS: dict[str, Any] = {
    "speed_mps": 1.0, "power_w": 150.0, "voltage_v": 26.0, "current_a": 6.0, "soc": 1.0, "grade_rad": 0.0,
    "heading_rad": 0.5, "position": (5.0, 2.0), "sensing_hz": 1.0, "temperature_c": 20.0, "interest": 1.0,
}  # fmt: skip
CALLS: tuple[tuple[str, Any], ...] = (
    ("update", 12.0), ("charged", 1.0), ("swap_battery", 1.0), ("move_home", (3.0, 4.0)), ("move_home", 2.0),
)  # fmt: skip


def of_type(number: Any, value: Any) -> Any:
    """A value with its numbers of a type, where that has them exactly."""
    if isinstance(value, dict):
        return {name: of_type(number, inner) for name, inner in value.items()}
    if isinstance(value, Prior):
        return Prior(*(of_type(number, inner) for inner in value))
    if isinstance(value, tuple):
        return np.array([of_type(number, inner) for inner in value])
    if math.isfinite(value) and float(number(value)) == value:
        return number(value)
    return value


def driven_with(number: Any) -> Companion:
    """A companion whose numbers are all of a type."""
    companion = Companion("husky", **of_type(number, ARGUMENTS))
    for second in range(12):
        companion.update(of_type(number, float(second)), **of_type(number, READINGS))
    return companion


@pytest.mark.parametrize("number", [int, np.int64, np.float32, np.float64])
def test_a_state_is_for_json_and_the_same_of_numbers_of_any_type(
    number: Any, tmp_path: Path
) -> None:
    plain = driven_with(float)
    companion = driven_with(number)
    other = Companion("husky", **of_type(number, ARGUMENTS))
    for call, argument in CALLS:
        getattr(plain, call)(argument)
        getattr(companion, call)(of_type(number, argument))
        state = json.dumps(companion.state())
        assert state == json.dumps(plain.state()), (call, argument)
        companion.save(tmp_path / "state.json")
        other.load(tmp_path / "state.json")
        assert state == json.dumps(other.state()), (call, argument)
    advice = companion.update(of_type(number, 13.0), **of_type(number, READINGS))
    assert json.dumps(advice.to_json()) == json.dumps(plain.update(13.0, **READINGS).to_json())


def test_no_bool_of_numpy_is_taken_for_a_number() -> None:
    companion = Companion("husky", home=(0.0, 0.0))
    no_number: Any = np.True_
    for name in ("risk", "soc", "cutoff_v", "capacity_j", "cruise_mps", "window_s", "place_m"):
        arguments: dict[str, Any] = {name: no_number}
        with pytest.raises(CompanionError, match=f"{name} = np.True_ is not allowed; give"):
            Companion("husky", **arguments)
    with pytest.raises(CompanionError, match=r"soc = np.True_ is not allowed; give"):
        companion.charged(no_number)
    with pytest.raises(CompanionError, match=r"soc = np.True_ is not a number; give"):
        companion.update(0.0, soc=no_number)


class SinglePrecision:
    """A policy that computes in 32 bits."""

    robot = load_robot("husky")

    def begin(self) -> None:
        pass

    def update(self, *_: float, **__: float) -> tuple[float, float, str]:
        speed_mps: Any = np.float32(0.75)
        return speed_mps, speed_mps, "go"

    def state(self) -> dict[str, Any]:
        return {}

    def restore(self, state: dict[str, Any]) -> None:
        pass


def test_the_command_of_a_policy_is_for_json_in_numbers_of_any_type() -> None:
    companion = Companion("husky", home=(0.0, 0.0), policy=SinglePrecision())
    advice = companion.update(0.0, speed_mps=1.0, position=(0.0, 0.0))
    state = json.loads(json.dumps(companion.state()))
    assert state["companion"]["_action"] == [0.75, 0.75, "go"]
    assert advice.action == Action(0.75, 0.75, "go")


def test_a_state_does_not_change_with_its_companion() -> None:
    companion = Companion("husky", home=(0.0, 0.0))
    advised = []
    for second in range(150):
        if second == 50:
            state = companion.state()
        advised.append(step(companion, "positions", second))
    companion.restore(state)  # back in time, in the same companion
    assert [step(companion, "positions", second) for second in range(50, 150)] == advised[50:]


def test_another_way_home_goes_on_too() -> None:
    first, second, way = (
        Companion("husky", home=(0.0, 0.0)),
        Companion("husky", home=(0.0, 0.0)),
        hill(),
    )
    for moment in range(100):
        step(first, "positions", moment)
        if moment == 50:
            first.take_home(way)
    second.restore(json.loads(json.dumps(first.state())), way)
    for moment in range(100, 150):
        assert step(first, "positions", moment) == step(second, "positions", moment)


def paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths to the values of a state."""
    if isinstance(value, dict):
        return [deeper for name, inner in value.items() for deeper in paths(inner, (*path, name))]
    if isinstance(value, list):
        return [
            deeper for index, inner in enumerate(value) for deeper in paths(inner, (*path, index))
        ]
    return [path]


def test_a_state_on_another_route_is_refused() -> None:
    way = hill()
    steeper = dataclasses.replace(way, grade_rad=1.1 * way.grade_rad)
    with pytest.raises(CompanionError, match="of another robot file, version or route"):
        Companion("husky", route=steeper).restore(Companion("husky", route=way).state())


@pytest.fixture(scope="module")
def driven() -> Companion:
    companion = Companion("husky", home=(0.0, 0.0), cutoff_v=21.0)
    for second in range(150):
        step(companion, "cut-off", second)
    return companion


def test_no_damage_is_taken_for_a_state(driven: Companion) -> None:
    good = json.loads(json.dumps(driven.state()))
    other = Companion("husky", home=(0.0, 0.0), cutoff_v=21.0)
    for second in range(20):
        step(other, "cut-off", second)
    before = other.state()
    wrong = st.one_of(
        st.none(),
        st.booleans(),
        st.floats(),
        st.integers(),
        st.text(max_size=5),
        st.just([]),
        st.just({}),
    )

    @settings(max_examples=100, deadline=None)
    @given(st.sampled_from(paths(good)), wrong, st.booleans())
    def refused(path: tuple[Any, ...], value: Any, left_out: bool) -> None:
        state = copy.deepcopy(good)
        place = state
        for name in path[:-1]:
            place = place[name]
        if left_out:
            del place[path[-1]]
        elif json.dumps(place[path[-1]]) == json.dumps(value):
            return
        else:
            place[path[-1]] = value
        with pytest.raises(CompanionError, match=r"^the state ") as caught:
            other.restore(state)
        assert "\n" not in str(caught.value)
        assert other.state() == before

    refused()


FLOATS = st.one_of(
    st.floats(), st.floats(-10.0, 10.0), st.sampled_from([1e300, -1e300, 1e20, 1e12, -1e6, 0.0])
)


def resealed(state: dict[str, Any]) -> dict[str, Any]:
    """The state with the seal of what it has become."""
    content = {name: value for name, value in state.items() if name not in ("schema", "seal")}
    return sealed(content)


def damaged(text: str, at: int, value: float) -> str:
    """An array of a state with another number at a place."""
    numbers = np.frombuffer(zlib.decompress(base64.b85decode(text)), np.float64).copy()
    numbers[at % len(numbers)] = value
    return base64.b85encode(zlib.compress(numbers.tobytes())).decode()


@pytest.mark.parametrize("kind", ["positions", "route", "cut-off"])
def test_of_damage_with_a_right_seal_nothing_follows_but_sound_advice(kind: str) -> None:
    """It is refused in one line, and the companion is as before; or it does no harm."""
    companion = Companion("husky", **KINDS[kind])
    for second in range(150):
        step(companion, kind, second)
    good = json.loads(json.dumps(companion.state()))
    other = Companion("husky", **KINDS[kind])
    inner = [path for path in paths(good) if path[0] == "companion"]
    wrong = st.one_of(
        st.none(),
        st.booleans(),
        FLOATS,
        st.sampled_from([-5, 10**6, 10**30]),
        st.text(max_size=5),
        st.just([]),
        st.just({}),
    )

    @settings(max_examples=30, deadline=None)
    @given(st.sampled_from(inner), wrong, st.booleans(), st.integers(0, 10**6), FLOATS)
    def harmless(path: tuple[Any, ...], value: Any, in_array: bool, at: int, number: float) -> None:
        state = copy.deepcopy(good)
        place = state
        for name in path[:-1]:
            place = place[name]
        # Texts with spaces are warnings.
        is_array = isinstance(place[path[-1]], str) and " " not in place[path[-1]]
        place[path[-1]] = damaged(place[path[-1]], at, number) if is_array and in_array else value
        before = other.state()
        try:
            other.restore(resealed(state))
        except CompanionError as error:
            assert "\n" not in str(error)
            assert json.dumps(other.state()) == json.dumps(before)
            return
        for second in range(150, 160):
            check(step(other, kind, second), other.vehicle.full_j)

    harmless()


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("_left_j",), "x"),
        (("_way", "_count"), -5),
        (("_way", "_count"), 10**6),
        (("_estimator", "home_mps"), 5e-324),
        (("_estimator", "windows"), 1.5),
        (("_readings", "_place"), [-1e300, 0.0]),
        (("_readings", "_said"), [[1.0, 2.0]]),
        (("_has",), {"power": True}),
        (("_has",), 5.0),
        (("_way", "moved_home"), "abc"),
        (("_way", "_crumbs"), math.nan),
        (("_estimator", "pace_mps"), math.nan),
        (("_readings", "clock_s"), math.nan),
        (("_turned",), 1.0),
        (("_action",), [1.0, 2.0]),
    ],
)
def test_a_value_that_no_companion_writes_is_refused(
    driven: Companion, path: tuple[str, ...], value: Any
) -> None:
    state = json.loads(json.dumps(driven.state()))
    place = state["companion"]
    for name in path[:-1]:
        place = place[name]
    if path[-1] == "_crumbs":
        value = damaged(place["_crumbs"], 0, value)
    place[path[-1]] = value
    other = Companion("husky", home=(0.0, 0.0), cutoff_v=21.0)
    with pytest.raises(CompanionError, match=r"^the state cannot be used: "):
        other.restore(resealed(state))


@pytest.mark.parametrize("value", [math.nan, 1e300])
def test_no_number_of_the_estimator_spoils_the_advice(driven: Companion, value: float) -> None:
    good = json.loads(json.dumps(driven.state()))
    estimates = good["companion"]["_estimator"]["estimates"]
    other = Companion("husky", home=(0.0, 0.0), cutoff_v=21.0)
    refused = 0
    for at in (0, 1, 2, 3, 5, 8, 20, 40):
        state = copy.deepcopy(good)
        state["companion"]["_estimator"]["estimates"] = damaged(estimates, at, value)
        try:
            other.restore(resealed(state))
        except CompanionError as error:
            assert "\n" not in str(error)
            refused += 1
        else:
            check(step(other, "cut-off", 150), other.vehicle.full_j)
    assert refused >= 7  # only what a robot may not have read yet may be no number


def with_whole_numbers(value: Any) -> Any:
    """A value as JSON writers have it that write 1.0 as 1."""
    if isinstance(value, dict):
        return {name: with_whole_numbers(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [with_whole_numbers(inner) for inner in value]
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def test_a_state_of_whole_numbers_is_taken() -> None:
    keywords: dict[str, Any] = {"home": (0, 0), "soc": 1, "cutoff_v": 21, "cruise_mps": 1}
    companion = Companion("husky", **keywords, window_s=10)
    for second in range(60):
        if second == 30:
            companion.swap_battery(1)
        companion.update(second, speed_mps=1, power_w=100, soc=1, position=(second, 0))
        if second % 7 == 0:
            state = with_whole_numbers(json.loads(json.dumps(companion.state())))
            other = Companion("husky", **keywords, window_s=10)
            other.restore(resealed(state))
            again = with_whole_numbers(json.loads(json.dumps(other.state())))
            assert json.dumps(again["companion"]) == json.dumps(state["companion"])
            assert isinstance(other._readings.clock_s, float)


@pytest.mark.parametrize("at", range(0, 4000, 97))
def test_a_file_that_was_cut_or_flipped_is_refused(
    driven: Companion, at: int, tmp_path: Path
) -> None:
    driven.save(tmp_path / "state.json")
    content = bytearray((tmp_path / "state.json").read_bytes())
    flipped = content.copy()
    flipped[at % len(content)] ^= 1
    for damaged in (bytes(content[:at]), bytes(flipped)):
        (tmp_path / "state.json").write_bytes(damaged)
        other = Companion("husky", home=(0.0, 0.0), cutoff_v=21.0)
        with pytest.raises(CompanionError):
            other.load(tmp_path / "state.json")


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"robot": "jackal", "home": (0.0, 0.0)}, "of robot 'husky', not of 'jackal'"),
        ({"robot": "husky", "home": (5.0, 0.0)}, "of another robot file, version or route"),
        (
            {"robot": "husky", "home": (0.0, 0.0), "docks": {"bay": (9.0, 0.0)}},
            "of another robot file, version or route",
        ),
        (
            {"robot": "husky", "home": (0.0, 0.0), "place_m": 99.0},
            "of another robot file, version or route",
        ),
        ({"robot": "husky", "home": (0.0, 0.0)}, "of another robot file, version or route"),
    ],
)
def test_a_state_of_other_arguments_is_refused(
    driven: Companion, keywords: dict[str, Any], said: str
) -> None:
    with pytest.raises(CompanionError, match=said):
        Companion(**keywords).restore(driven.state())


def test_an_older_state_is_refused_in_one_line() -> None:
    with pytest.raises(
        CompanionError, match=r"^the state is of another version than 5, or is none$"
    ):
        Companion("husky").restore({"schema": 1, "robot": "husky"})


def test_memory_stays_as_it_is() -> None:
    """Of all that the companion holds, after a trail is at its longest."""
    companion = Companion("husky", home="here")
    sizes = []
    for update in range(3000):
        wild = 1e300 if update % 7 == 0 else 150.0
        companion.update(
            20.0 * update, speed_mps=0.9, heading_rad=0.01 * update % 6.0, power_w=wild, soc=0.5,
            position=(1e300, 0.0) if update % 11 == 0 else None,
        )  # fmt: skip
        if update % 1000 == 999:
            sizes.append(len(pickle.dumps(companion)))
    assert max(sizes[1:]) < 1.05 * sizes[1], sizes
