"""Each effect alone: off at zero, its equation when on, one formula for Python, NumPy and compiled
kernels."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from homeward import Robot
from homeward.physics import CAUSES, EFFECTS
from homeward.physics.battery import energy_share, open_circuit_v
from homeward.physics.effects import PARAMETER_FIELDS, Effect, air_temperature, turning
from homeward.physics.kernel import Conditions, full_charge
from homeward.physics.model import GRAVITY_MPS2
from tests.physics.drives import FALLING, PLAIN, Array, conditions, drive, robots, with_effect
from tests.physics.drives import STEADY as LEVEL

BY_ID = {effect.id: effect for effect in EFFECTS}
COS = math.sqrt(0.99)
X = LEVEL._replace(
    accel_mps2=0.5,
    sin_grade=0.1,
    cos_grade=COS,
    yaw_rate_radps=0.4,
    roughness=0.5,
    headwind_mps=1.0,
    temperature_c=-5.0,
    base_distance_m=2000.0,
)
STEP_S = 10.0
STATE = {"time_s": 5.0, "winding_k": 30.0}

WEIGHT_N = 10.0 * GRAVITY_MPS2
PER_N = 2.0 / 0.5  # W of the battery per newton at the wheels
FORCE_N = 0.1 * WEIGHT_N * COS + 0.5 * 2.0**2 + 0.1 * WEIGHT_N
LOAD_W = (0.5 + 0.01 * 50.0 + 0.25 + 0.75 + 2.0 + 0.02 * 50.0) + FORCE_N * PER_N
STEADY_K = 0.2 * FORCE_N * PER_N
MEAN_K = STEADY_K + (30.0 - STEADY_K) * (1.0 - math.exp(-0.1)) / 0.1
CURRENT_A = (10.0 - math.sqrt(10.0**2 - 4.0 * 0.1 * LOAD_W)) / (2.0 * 0.1)

BY_HAND: dict[str, tuple[dict[str, float], float]] = {
    "inertia": ({"mass_factor": 1.5}, 1.5 * 10.0 * 0.5 * PER_N),
    "viscous": ({"drag_ns_per_m": 3.0}, 3.0 * 2.0 * PER_N),
    "wind": ({"exposure": 0.5}, 0.5 * (2.5**2 - 2.0**2) * PER_N),
    "surface": ({"gain": 2.0}, 2.0 * 0.5 * 0.1 * WEIGHT_N * COS * PER_N),
    "air_temperature": (
        {"rolling_per_k": 0.01},
        (0.25 * 0.1 * WEIGHT_N * COS + (25.0 / 268.15) * 0.5 * 2.0**2) * PER_N,
    ),
    "payload": ({"mass_kg": 3.0}, 3.0 * GRAVITY_MPS2 * (0.1 * COS + 0.1) * PER_N),
    "hidden_grade": ({"slope": 0.05}, WEIGHT_N * 0.05 * COS * PER_N),
    "slip": ({"per_load": 0.5}, FORCE_N * 0.5 * FORCE_N / WEIGHT_N * PER_N),
    "turning": ({"scrub": 0.3}, 0.3 * WEIGHT_N * math.sqrt(0.2 / (0.2 + 4.0)) * PER_N),
    "copper_loss": ({"w_per_n2": 0.01}, 0.01 * FORCE_N**2),
    "no_load": ({"power_w": 4.0}, 4.0),
    "motor_heating": (
        {"per_k": 0.004, "rise_k_per_w": 0.2, "time_constant_s": 100.0},
        0.004 * MEAN_K * FORCE_N * PER_N,
    ),
    "standby": ({"power_w": 3.0}, 3.0),
    "compute": ({"power_w": 6.0, "base_share": 0.25}, 6.0 * (0.25 + 0.75 * 0.5)),
    "radio": ({"w_per_km2": 0.25}, 0.25 * 2.0**2),
    "heater": ({"w_per_k": 0.4, "on_below_c": 10.0}, 0.4 * 15.0),
    "cooler": ({"w_per_k": 0.4, "on_above_c": -15.0}, 0.4 * 10.0),
    "intermittent_load": ({"power_w": 8.0, "period_s": 60.0, "duty": 0.2}, 8.0 * 7.0 / STEP_S),
    "internal_resistance": ({"ohm": 0.1}, 0.1 * CURRENT_A**2),
    "rate_capacity": (
        {"excess": 0.1, "reference_w": 20.0},
        LOAD_W * ((LOAD_W / 20.0) ** 0.1 - 1.0),
    ),
    "breakaway": ({"start_j": 70.0}, 70.0 / STEP_S),
    "ageing": ({"lost_share": 0.2}, LOAD_W * 0.25),
    "cold_battery": ({"per_k": 0.01, "warm_c": 20.0}, LOAD_W / 3.0),
}


@pytest.mark.parametrize("effect_id", BY_HAND)
def test_power_by_hand(effect_id: str) -> None:
    parameters, expected_w = BY_HAND[effect_id]
    off = drive(PLAIN, [X], STEP_S, np.inf, **STATE)
    on = drive(with_effect(PLAIN, effect_id, **parameters), [X], STEP_S, np.inf, **STATE)
    assert expected_w > 0.01
    assert float(off["power_w"]) == pytest.approx(LOAD_W, rel=1e-12)
    assert float(on["power_w"] - off["power_w"]) == pytest.approx(expected_w, rel=1e-9)
    assert float(on["ledger_j"][CAUSES.index(effect_id)]) == pytest.approx(
        expected_w * STEP_S, rel=1e-9
    )


def test_a_resistance_of_the_cold_loses_by_the_square_of_the_load() -> None:
    off = drive(PLAIN, [X], STEP_S, np.inf, **STATE)
    robot = with_effect(PLAIN, "cold_battery", per_k=0.01, warm_c=20.0, reference_w=2.0 * LOAD_W)
    lost = 0.25 / 2.0
    on = drive(robot, [X], STEP_S, np.inf, **STATE)
    assert float(on["power_w"] - off["power_w"]) == pytest.approx(
        LOAD_W * lost / (1.0 - lost), rel=1e-9
    )


def test_regeneration_by_hand() -> None:
    downhill = LEVEL._replace(sin_grade=-0.6, cos_grade=0.8)
    force_n = 0.1 * WEIGHT_N * 0.8 + 2.0 - 0.6 * WEIGHT_N
    off = drive(PLAIN, [downhill], STEP_S, np.inf)
    on = drive(with_effect(PLAIN, "regeneration", share=0.4), [downhill], STEP_S, np.inf)
    assert float(on["power_w"] - off["power_w"]) == pytest.approx(0.4 * force_n * 2.0, rel=1e-12)


def test_friction_brakes_take_what_exceeds_the_power_of_regeneration() -> None:
    downhill = LEVEL._replace(sin_grade=-0.6, cos_grade=0.8)
    braking_w = (0.6 * WEIGHT_N - 0.1 * WEIGHT_N * 0.8 - 2.0) * 2.0
    off = drive(PLAIN, [downhill], STEP_S, np.inf)
    for up_to_w, taken_w in ((0.3 * braking_w, 0.3 * braking_w), (1.1 * braking_w, braking_w)):
        on = drive(
            with_effect(PLAIN, "regeneration", share=0.4, up_to_w=up_to_w),
            [downhill],
            STEP_S,
            np.inf,
        )
        assert float(off["power_w"] - on["power_w"]) == pytest.approx(0.4 * taken_w, rel=1e-12)


def test_the_energy_of_a_start_is_spent_over_the_first_metres() -> None:
    """Of 5 m at 2 m/s a step of one second spends two fifths, the third the rest; the next start
    begins anew."""
    robot, still = (
        with_effect(PLAIN, "breakaway", start_j=70.0, over_m=5.0),
        LEVEL._replace(speed_mps=0.0),
    )
    moves = [still, LEVEL, LEVEL, LEVEL, LEVEL, still, LEVEL]
    starts_w = []
    for count in range(1, len(moves) + 1):
        with_it, without = (
            float(drive(one, moves[:count], 1.0, np.inf)["power_w"]) for one in (robot, PLAIN)
        )
        starts_w.append(with_it - without)
    np.testing.assert_allclose(starts_w, [0.0, 28.0, 28.0, 14.0, 0.0, 0.0, 28.0], atol=1e-9)


@given(dt_s=st.floats(0.01, 20.0), over_m=st.floats(1e-6, 50.0))
def test_a_start_takes_the_same_energy_in_steps_of_any_length(dt_s: float, over_m: float) -> None:
    robot = with_effect(PLAIN, "breakaway", start_j=70.0, over_m=over_m)
    steps = [LEVEL] * (2 + math.ceil(over_m / (LEVEL.speed_mps * dt_s)))
    if len(steps) < 1000:
        ledger_j = drive(robot, steps, dt_s, np.inf)["ledger_j"]
        assert float(ledger_j[CAUSES.index("breakaway")]) == pytest.approx(70.0, rel=1e-9)


def test_regeneration_takes_what_slowing_down_leaves_over() -> None:
    slowing = LEVEL._replace(accel_mps2=-3.0)
    force_n = 0.1 * WEIGHT_N + 2.0 - 3.0 * 10.0
    inertia, regeneration = {"inertia": {"mass_factor": 1.0}}, {"regeneration": {"share": 0.4}}
    off = drive(dataclasses.replace(PLAIN, effects=inertia), [slowing], STEP_S, np.inf)
    on = drive(
        dataclasses.replace(PLAIN, effects=inertia | regeneration), [slowing], STEP_S, np.inf
    )
    assert force_n < 0.0
    assert float(on["power_w"] - off["power_w"]) == pytest.approx(0.4 * force_n * 2.0, rel=1e-12)


@pytest.mark.parametrize("effect_id", ["inertia", "turning", "slip", "hidden_grade"])
@pytest.mark.parametrize("x", [X, X._replace(sin_grade=-0.05)])
def test_what_is_carried_is_moved_as_the_robots_own_mass(effect_id: str, x: Conditions) -> None:
    """A robot with a payload draws what a robot of the sum of both masses draws, and still tells
    the payload's part."""
    effect = {effect_id: BY_HAND[effect_id][0]}
    loaded = drive(
        dataclasses.replace(PLAIN, effects=effect | {"payload": {"mass_kg": 3.0}}),
        [x],
        STEP_S,
        np.inf,
        **STATE,
    )
    heavier = drive(
        dataclasses.replace(PLAIN, mass_kg=13.0, effects=effect), [x], STEP_S, np.inf, **STATE
    )
    empty = drive(dataclasses.replace(PLAIN, effects=effect), [x], STEP_S, np.inf, **STATE)
    assert float(loaded["power_w"]) == pytest.approx(float(heavier["power_w"]), rel=1e-12)
    column = CAUSES.index(effect_id)
    assert abs(float(loaded["parts_w"][column])) > 1.01 * abs(float(empty["parts_w"][column]))
    by_hand_w = 3.0 * GRAVITY_MPS2 * (0.1 * x.cos_grade + x.sin_grade) * PER_N
    assert float(loaded["parts_w"][CAUSES.index("payload")]) == pytest.approx(
        by_hand_w, rel=1e-12, abs=1e-12
    )


def test_turning_on_the_spot_is_a_force_at_wheels_that_turn() -> None:
    robot = with_effect(PLAIN, "turning", scrub=0.3)
    spot = X._replace(speed_mps=0.0)
    assert turning.wheel_force(record(robot), spot) == pytest.approx(0.3 * WEIGHT_N)
    end = drive(robot, [spot], STEP_S, np.inf)
    assert float(end["drive_w"]) == pytest.approx(0.3 * WEIGHT_N * 0.5 * 0.4 * 0.5 / 0.5)


def test_every_effect_is_worked_out_by_hand() -> None:
    assert {*BY_HAND, "regeneration"} == set(BY_ID)


def test_the_catalogue_is_the_vocabulary() -> None:
    vocabulary = """
        turning inertia breakaway viscous wind surface air_temperature payload hidden_grade slip regeneration
        copper_loss no_load motor_heating internal_resistance rate_capacity ageing cold_battery standby compute radio
        heater cooler intermittent_load
    """
    assert sorted(effect.id for effect in EFFECTS) == sorted(vocabulary.split())


def test_every_effect_has_a_bit_of_the_mask() -> None:
    assert len(EFFECTS) <= 64


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.id)
def test_catalogue_entry_is_complete(effect: Effect) -> None:
    channels = """
        time_s speed_mps wheel_left_mps wheel_right_mps yaw_rate_radps grade_rad elevation_m distance_m heading_rad
        power_w voltage_v current_a motor_left_a motor_right_a sensing_hz soc temperature_c payload_kg base_distance_m
    """
    assert effect.needs and set(effect.needs) <= set(channels.split())
    assert set(effect.confused_with) <= set(BY_ID) - {effect.id}
    assert effect.sentence.endswith(".") and effect.equation and effect.source
    assert effect.switch.default == 0.0 and effect.switch.low <= 0.0 < effect.switch.high
    for parameter in effect.parameters:
        assert parameter.low <= parameter.default <= parameter.high
        assert parameter.meaning and parameter.unit
        assert effect.field(parameter) in PARAMETER_FIELDS


@given(data=st.data(), robot=robots(with_effects=False))
def test_zero_is_off_to_the_last_bit(data: st.DataObject, robot: Robot) -> None:
    steps = data.draw(st.lists(conditions(robot), min_size=1, max_size=5))
    zeros = {
        effect.id: {one.name: data.draw(st.floats(one.low, one.high)) for one in effect.parameters}
        | {effect.switch.name: data.draw(st.sampled_from([0.0, -0.0]))}
        for effect in EFFECTS
    }
    off = dataclasses.replace(robot, effects=zeros)
    assert off.active_effects == () and off.record()["effects"][0] == 0
    assert drive(off, steps, 60.0).tobytes() == drive(robot, steps, 60.0).tobytes()


@given(data=st.data(), robot=robots(with_effects=False))
def test_a_vanishing_magnitude_has_a_vanishing_effect(data: st.DataObject, robot: Robot) -> None:
    x = data.draw(conditions(robot))
    effect = data.draw(st.sampled_from(EFFECTS))
    parameters = {one.name: data.draw(st.floats(one.low, one.high)) for one in effect.parameters}
    parameters[effect.switch.name] = 1e-12
    if effect is air_temperature.EFFECT:
        # The density of cold air has no magnitude of its own: it is a part of the effect.
        x = x._replace(temperature_c=air_temperature.REFERENCE_C)
    power_w = float(drive(robot, [x], 10.0, np.inf)["power_w"])
    tiny = drive(with_effect(robot, effect.id, **parameters), [x], 10.0, np.inf)
    scale_w = power_w + abs(float(tiny["traction_n"])) * (1.0 + abs(float(tiny["traction_n"])))
    assert float(tiny["power_w"]) == pytest.approx(power_w, rel=1e-4, abs=1e-4 * scale_w)


@given(
    data=st.data(),
    robot=robots(with_effects=False),
    dt_s=st.floats(0.01, 100.0),
    winding_k=st.floats(0.0, 100.0),
)
def test_compiled_and_plain_formula_agree(
    data: st.DataObject, robot: Robot, dt_s: float, winding_k: float
) -> None:
    x = data.draw(conditions(robot))
    effect = data.draw(
        st.sampled_from([effect for effect in EFFECTS if effect.id != "intermittent_load"])
    )
    parameters = {one.name: data.draw(st.floats(one.low, one.high)) for one in effect.parameters}
    robot = with_effect(robot, effect.id, **parameters)
    end = drive(robot, [x], dt_s, np.inf, winding_k=winding_k)
    paper = drive(dataclasses.replace(robot, effects={}), [x], dt_s, np.inf)
    load = float(paper["power_w" if effect.kind in ("ancillary", "battery") else "traction_n"])
    expected = float(effect.function(record(robot), state(dt_s, winding_k), x, load))
    unit = x.speed_mps / robot.traction_efficiency if effect.kind == "force" else 1.0
    assert float(end["parts_w"][CAUSES.index(effect.id)]) == pytest.approx(
        expected * unit, rel=1e-9, abs=1e-12
    )


@given(
    time_s=st.floats(0.0, 1e5),
    power_w=st.floats(0.0, 100.0),
    period_s=st.floats(1.0, 1000.0),
    duty=st.floats(0.0, 1.0),
)
def test_intermittent_load_is_on_in_the_first_share_of_every_period(
    time_s: float, power_w: float, period_s: float, duty: float
) -> None:
    robot = with_effect(PLAIN, "intermittent_load", power_w=power_w, period_s=period_s, duty=duty)
    now = state(1.0, 0.0)
    now["time_s"] = time_s
    expected = power_w if time_s % period_s < duty * period_s else 0.0
    phase = time_s / period_s % 1.0
    if abs(phase - duty) > 1e-9 and 1e-9 < phase < 1.0 - 1e-9:
        assert BY_ID["intermittent_load"].function(record(robot), now, LEVEL, 0.0) == expected


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.id)
def test_formulas_broadcast(effect: Effect) -> None:
    parameters = BY_HAND[effect.id][0] if effect.id in BY_HAND else {"share": 0.4}
    p, s = record(with_effect(PLAIN, effect.id, **parameters)), state(STEP_S, 30.0)
    speed = np.array([0.0, 0.5, 2.0])
    load = np.array([[-40.0], [0.0], [25.0], [600.0]])
    conditions_ = {**X._asdict(), "speed_mps": speed}
    table: Array = np.broadcast_to(
        effect.function(p, s, SimpleNamespace(**conditions_), load), (4, 3)
    )
    assert np.isfinite(table).all()
    for i, j in np.ndindex(4, 3):
        one: Any = X._replace(speed_mps=float(speed[j]))
        assert table[i, j] == pytest.approx(
            float(effect.function(p, s, one, float(load[i, 0]))), rel=1e-12, abs=1e-15
        )


@given(load=st.floats(-1e4, 1e4), ohm=st.floats(1e-6, 100.0))
def test_internal_resistance_is_the_current_that_delivers_the_load(load: float, ohm: float) -> None:
    loss_w = float(BY_ID["internal_resistance"].function(record(with_effect(PLAIN, "internal_resistance", ohm=ohm)),
                                                         None, LEVEL, load))  # fmt: skip
    if load <= 10.0**2 / (4.0 * ohm):
        current_a = (load + loss_w) / 10.0
        assert ohm * current_a**2 == pytest.approx(loss_w, rel=1e-6, abs=1e-9 * abs(load))
    else:
        assert loss_w == load


@given(charge=st.floats(0.01, 1.0), load=st.floats(-200.0, 200.0))
def test_internal_resistance_takes_its_current_from_the_voltage_at_the_present_charge(
    charge: float, load: float
) -> None:
    robot = dataclasses.replace(
        with_effect(PLAIN, "internal_resistance", ohm=0.05), open_circuit_v=FALLING
    )
    now = full_charge(robot, robot.usable_energy_j * float(energy_share(robot.curve, charge)))
    now["capacity_j"] = robot.usable_energy_j
    loss_w = float(
        BY_ID["internal_resistance"].function(record(robot), now.view(np.recarray)[0], LEVEL, load)
    )
    rest_v = float(open_circuit_v(robot.curve, charge))
    lost_w = 0.05 * ((rest_v - math.sqrt(rest_v**2 - 4.0 * 0.05 * load)) / (2.0 * 0.05)) ** 2
    # The curve is interpolated: at a tenth of the charge and 73 W, the loss is off by 2.5004 %.
    assert loss_w == pytest.approx(lost_w, rel=0.03, abs=1e-9)


def test_slip_only_costs() -> None:
    downhill = LEVEL._replace(sin_grade=-0.6, cos_grade=0.8)
    for per_load in (0.5, 5.0):
        robot = dataclasses.replace(
            PLAIN, effects={"regeneration": {"share": 0.9}, "slip": {"per_load": per_load}}
        )
        grip = drive(with_effect(PLAIN, "regeneration", share=0.9), [downhill], 1.0, np.inf)
        slips = drive(robot, [downhill], 1.0, np.inf)
        assert grip["traction_n"] < slips["traction_n"] <= 0.0
        assert grip["power_w"] < slips["power_w"]


def test_ice_takes_away_no_more_than_the_rolling_resistance() -> None:
    ice = LEVEL._replace(roughness=3.0)
    end = drive(with_effect(PLAIN, "surface", gain=-0.9), [ice], 1.0, np.inf)
    assert float(end["traction_n"]) == pytest.approx(0.5 * 2.0**2)


def test_a_tailwind_pushes_no_harder_than_the_air_that_is_met() -> None:
    calm = LEVEL._replace(headwind_mps=-1.0)
    end = drive(with_effect(PLAIN, "wind", exposure=2.0), [calm], 1.0, np.inf)
    assert float(end["traction_n"]) == pytest.approx(0.1 * WEIGHT_N)


def test_motors_warm_up_to_the_steady_temperature_and_cool_again() -> None:
    robot = with_effect(
        PLAIN, "motor_heating", per_k=0.004, rise_k_per_w=0.2, time_constant_s=100.0
    )
    work_w = (0.1 * WEIGHT_N + 2.0) * PER_N
    warm = drive(robot, [LEVEL] * 50, 100.0, np.inf)
    assert float(warm["winding_k"]) == pytest.approx(0.2 * work_w, rel=1e-9)
    cool = drive(robot, [LEVEL._replace(speed_mps=0.0)], 100.0, np.inf, winding_k=50.0)
    assert float(cool["winding_k"]) == pytest.approx(50.0 / math.e, rel=1e-12)


def test_every_start_costs_once() -> None:
    robot = with_effect(PLAIN, "breakaway", start_j=70.0)
    stop = LEVEL._replace(speed_mps=0.0)
    end = drive(robot, [LEVEL, LEVEL, stop, stop, LEVEL, LEVEL], 3.0, np.inf)
    assert float(end["ledger_j"][CAUSES.index("breakaway")]) == pytest.approx(140.0)


@pytest.mark.parametrize("effect_id", [effect.id for effect in EFFECTS if effect.kind == "force"])
def test_forces_do_nothing_at_standstill(effect_id: str) -> None:
    parameters, _ = BY_HAND[effect_id]
    parked = X._replace(speed_mps=0.0)
    end = drive(with_effect(PLAIN, effect_id, **parameters), [parked], STEP_S, np.inf)
    assert end["traction_n"] == end["drive_w"] == 0.0


def record(robot: Robot) -> Any:
    return robot.record().view(np.recarray)[0]


def state(step_s: float, winding_k: float) -> Any:
    states = full_charge(PLAIN)
    states["step_s"], states["winding_k"] = step_s, winding_k
    return states.view(np.recarray)[0]
