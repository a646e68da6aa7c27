"""The effects of the catalogue with realistic functional forms, other than the catalogue's textbook
terms.

Each function draws the parameters of one mechanism for a vehicle. Powers are relative to the
vehicle's typical power, because a mechanism too small to be observed would test nothing. `runs` is
the number of drives of the case: a permanent change happens in one of them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.concealed.plants.chain import Mechanism, Work
from benchmarks.concealed.plants.motion import Array, Motion
from benchmarks.concealed.plants.vehicles import (
    GRAVITY_MPS2,
    KELVIN,
    Plant,
    peak_power_w,
    rolling_power_w,
    typical_power_w,
)

Draw = Callable[[Plant, Generator, int], Mechanism]
GAS_CONSTANT_J_PER_MOL_K = 8.314462618  # CODATA 2018
ROOM_K = 298.15  # 25 C, where cells are rated
COPPER_PER_K = 0.00393  # temperature coefficient of copper at 20 C (IEC 60028)


def first_order(signal: Array, dt_s: float, time_constant_s: float, initial: float = 0.0) -> Array:
    """Response of a first-order lag of gain 1, exact for a held signal, shape (n,)."""
    keep = float(np.exp(-dt_s / time_constant_s))
    return np.asarray(
        lfilter([1.0 - keep], [1.0, -keep], signal, zi=[keep * initial])[0], dtype=np.float64
    )


def ornstein_uhlenbeck(
    rng: Generator, n: int, dt_s: float, deviation: float, time_constant_s: float
) -> Array:
    """Autocorrelated noise: mean 0, the given standard deviation and correlation time, shape
    (n,)."""
    keep = float(np.exp(-dt_s / time_constant_s))
    kicks = rng.normal(size=n) * deviation * np.sqrt(1.0 - keep**2)
    kicks[0] = rng.normal() * deviation
    noise: Array = lfilter([1.0], [1.0, -keep], kicks)
    return noise


def since(run: Motion, drive: int, share: float) -> NDArray[np.bool_]:
    """Whether a permanent change, which happens in one drive after this share of it, has happened,
    shape (n,)."""
    return np.where(run.index == drive, run.time_s >= share * run.time_s[-1], run.index > drive)


def since_start_m(run: Motion) -> Array:
    """Distance since the vehicle last stood, m."""
    standing = np.where(run.speed_mps > 0.0, 0.0, run.distance_m)
    return run.distance_m - np.maximum.accumulate(standing)


def turning(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Scrub of skid-steered wheels about their instantaneous centres of rotation, Coulomb with a
    viscous share.

    Martinez et al. 2005 (Int. J. Robotics Research 24(10)) for the kinematics, Pentzer, Brennan and
    Reichard 2014 (J. Field Robotics 31(3)) for the power. Steered wheels: the drag of their slip
    angle, F_y^2 / C_alpha (Gillespie, Fundamentals of Vehicle Dynamics, ch. 6).
    """
    robot = vehicle.robot
    weight_n = robot.mass_kg * GRAVITY_MPS2
    friction = rng.uniform(0.35, 0.7) if vehicle.steering == "skid" else rng.uniform(0.25, 0.4)
    # farther out than the tread: wheels also slip longitudinally
    icr_m = robot.track_m / 2.0 * rng.uniform(1.3, 1.9)
    viscous_s_per_m = rng.uniform(0.3, 1.0)
    # of tyres on loose ground; hard ground has about 9 per rad
    stiffness_n_per_rad = weight_n * rng.uniform(3.0, 6.0)

    def change(work: Work, _: Generator) -> None:
        yaw = np.abs(work.run.yaw_rate_radps)
        speed = work.run.speed_mps
        if vehicle.steering == "ackermann":
            work.turning_w += (work.mass_kg * speed * yaw) ** 2 / stiffness_n_per_rad * speed
        else:
            slide_mps = yaw * np.hypot(vehicle.wheelbase_m / 2.0, icr_m - robot.track_m / 2.0)
            work.turning_w += (
                friction
                * work.mass_kg
                * GRAVITY_MPS2
                * slide_mps
                * (1.0 + viscous_s_per_m * slide_mps)
            )

    return Mechanism("turning", "ground", change)


def inertia(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Work of acceleration, with rotating parts as extra mass; friction brakes recover nothing
    (Gillespie, ch. 2)."""
    # 1 + 0.04 + 0.0025 N^2, N the gear ratio: road cars in high to low gear
    factor = rng.uniform(1.04, 1.6)

    def change(work: Work, _: Generator) -> None:
        work.extra_n += factor * work.mass_kg * work.run.accel_mps2

    return Mechanism("inertia", "ground", change)


def breakaway(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Stiction of wheels that have sunk in while standing: it falls with speed (Stribeck) and along
    the first metres.

    Armstrong-Helouvry, Dupont and Canudas de Wit 1994 (Automatica 30(7)); sinkage: Wong, Theory of
    Ground Vehicles.
    """
    excess = rng.uniform(1.5, 4.0)
    stribeck_mps = vehicle.robot.max_speed_mps * rng.uniform(0.05, 0.12)
    settled_m = vehicle.robot.max_speed_mps * rng.uniform(0.5, 1.5)

    def change(work: Work, _: Generator) -> None:
        speed = work.run.speed_mps
        fresh = np.exp(-since_start_m(work.run) / settled_m)
        work.rolling *= 1.0 + excess * (0.7 * fresh + 0.3 * np.exp(-((speed / stribeck_mps) ** 2)))

    return Mechanism("breakaway", "ground", change)


def viscous(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Churning of grease that thins as it warms with the distance driven (Harris, Rolling Bearing
    Analysis, ch. 10)."""
    robot = vehicle.robot
    at_top_n = robot.rolling_resistance * robot.mass_kg * GRAVITY_MPS2 * rng.uniform(0.6, 1.2)
    exponent = rng.uniform(0.8, 1.1)
    warm_m = vehicle.leg_m * rng.uniform(1.0, 4.0)
    thinning = rng.uniform(0.1, 0.35)

    def change(work: Work, _: Generator) -> None:
        thin = 1.0 - thinning * (1.0 - np.exp(-work.run.distance_m / warm_m))
        work.extra_n += at_top_n * (work.run.speed_mps / robot.max_speed_mps) ** exponent * thin

    return Mechanism("viscous", "ground", change)


def wind(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Steady wind with gusts as an Ornstein-Uhlenbeck process, intensity 15 to 25 % (Davenport
    1961; Eurocode 1-4)."""
    mean_mps = rng.uniform(5.0, 11.0)
    from_rad = rng.uniform(0.0, 2.0 * np.pi)
    intensity = rng.uniform(0.15, 0.25)
    gust_s = rng.uniform(5.0, 20.0)

    def change(work: Work, gusts: Generator) -> None:
        gust = ornstein_uhlenbeck(
            gusts, work.run.time_s.size, work.run.dt_s, intensity * mean_mps, gust_s
        )
        work.air_mps = work.run.speed_mps + (mean_mps + gust) * np.cos(
            work.run.heading_rad - from_rad
        )

    return Mechanism("wind", "ground", change)


def surface(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """A softer stretch of the way with ragged edges; sinkage eases a little with speed (Wong, ch.
    2)."""
    gain = rng.uniform(0.5, 1.4)
    start = rng.uniform(0.15, 0.35)
    end = rng.uniform(0.5, 0.8)
    wave = rng.integers(8, 20)
    phase = rng.uniform(0.0, 2.0 * np.pi)

    def change(work: Work, _: Generator) -> None:
        share = np.mod(work.run.place_m, vehicle.leg_m) / vehicle.leg_m
        edge = (
            1.0 / (1.0 + np.exp(-(share - start) / 0.015)) / (1.0 + np.exp((share - end) / 0.015))
        )
        ragged = 1.0 + 0.2 * np.sin(wave * 2.0 * np.pi * share + phase)
        speed = work.run.speed_mps / vehicle.robot.max_speed_mps
        work.rolling *= 1.0 + gain * edge * ragged * (1.1 - 0.2 * speed)

    return Mechanism("surface", "ground", change)


def payload(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """A load picked up on the way, under which C_rr rises a little, as load^0.1 (form of SAE
    J2452)."""
    share = rng.uniform(0.2, 0.5)
    drive = int(rng.integers(0, runs))
    share_driven = rng.uniform(0.3, 0.6)

    def change(work: Work, _: Generator) -> None:
        loaded = np.where(since(work.run, drive, share_driven), 1.0 + share, 1.0)
        work.mass_kg *= loaded
        work.rolling *= loaded**0.1

    return Mechanism("payload", "ground", change)


def hidden_grade(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """A slope that the map lacks, uneven along the way: surveys miss long, gentle slopes."""
    slope = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.5) * vehicle.robot.rolling_resistance
    wave = rng.uniform(1.0, 3.0)
    phase = rng.uniform(0.0, 2.0 * np.pi)

    def change(work: Work, _: Generator) -> None:
        share = work.run.place_m / vehicle.leg_m
        tilt = slope * (1.0 + 0.3 * np.sin(2.0 * np.pi * wave * share + phase))
        work.grade_rad = work.grade_rad + tilt * work.run.direction

    return Mechanism("hidden_grade", "ground", change)


def slip(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Longitudinal slip from Burckhardt's curve on slick, loose ground, mu = c1 (1 - exp(-c2 s)) -
    c3 s, inverted.

    Burckhardt 1993, Fahrwerktechnik: Radschlupfregelsysteme; between wet gravel and snow, c1 0.2 to
    0.4 (Kiencke and Nielsen, Automotive Control Systems, ch. 8).
    """
    c1 = rng.uniform(0.25, 0.35)
    c2 = rng.uniform(4.0, 8.0)
    c3 = rng.uniform(0.02, 0.06)
    slips = np.linspace(0.0, 0.4, 400)
    grip = np.maximum.accumulate(c1 * (1.0 - np.exp(-c2 * slips)) - c3 * slips)

    def change(work: Work, _: Generator) -> None:
        used = np.maximum(work.force_n, 0.0) / (
            work.mass_kg * GRAVITY_MPS2 * np.cos(work.grade_rad)
        )
        work.tread_mps = work.tread_mps / (1.0 - np.interp(used, grip, slips))

    return Mechanism("slip", "wheel", change)


def regeneration(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Recuperation that fades out at low speed and is limited by the battery's charging power.

    Ehsani, Gao and Emadi, Modern Electric, Hybrid Electric and Fuel Cell Vehicles, ch. 13.
    """
    robot = vehicle.robot
    share = rng.uniform(0.5, 0.85)
    cut_off_mps = robot.max_speed_mps * rng.uniform(0.1, 0.25)
    most_w = rolling_power_w(vehicle) * rng.uniform(0.5, 1.2)

    def change(work: Work, _: Generator) -> None:
        braking_w = np.maximum(-work.force_n, 0.0) * work.run.speed_mps
        fade = np.clip(work.run.speed_mps / cut_off_mps - 0.5, 0.0, 1.0)
        work.returned_w += np.minimum(share * fade * braking_w * robot.traction_efficiency, most_w)

    return Mechanism("regeneration", "wheel", change)


def copper_loss(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """I^2 R of a motor whose iron saturates, so that current rises faster than thrust (Hughes,
    Electric Motors)."""
    rolling_n = vehicle.robot.rolling_resistance * vehicle.robot.mass_kg * GRAVITY_MPS2
    at_rolling_w = rolling_power_w(vehicle) * rng.uniform(0.1, 0.25)
    saturation = rng.uniform(4.0, 8.0)

    def change(work: Work, _: Generator) -> None:
        thrust = np.abs(work.force_n) / rolling_n
        work.drive_w += at_rolling_w * (thrust * (1.0 + thrust / saturation)) ** 2

    return Mechanism("copper_loss", "motor", change)


def no_load(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Iron and switching losses while the motors turn: a constant, hysteresis ~ speed, eddy
    currents ~ speed^2.

    Steinmetz/Bertotti loss separation (Krishnan, Permanent Magnet Synchronous and Brushless DC
    Motor Drives, ch. 2).
    """
    size_w = rolling_power_w(vehicle) * rng.uniform(0.3, 0.6)

    def change(work: Work, _: Generator) -> None:
        turns = work.run.speed_mps / vehicle.robot.max_speed_mps
        work.drive_w += np.where(turns > 0.0, size_w * (0.6 + 0.3 * turns + 0.1 * turns**2), 0.0)

    return Mechanism("no_load", "motor", change)


def motor_heating(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Windings and case as two thermal masses; resistance rises and magnets weaken, 0.1 %/K for
    NdFeB.

    Hughes, Electric Motors and Drives, ch. 2; copper by IEC 60028.
    """
    copper_share = rng.uniform(0.35, 0.55)  # of the motors' power: small ones, near their limit
    winding_k = rng.uniform(40.0, 60.0)
    case_k = rng.uniform(25.0, 45.0)  # rise at typical power
    winding_s = rng.uniform(40.0, 90.0)
    case_s = rng.uniform(400.0, 900.0)

    def change(work: Work, _: Generator) -> None:
        load = work.drive_w / rolling_power_w(vehicle)
        dt_s = work.run.dt_s
        rise_k = winding_k * first_order(load, dt_s, winding_s) + case_k * first_order(
            load, dt_s, case_s
        )
        rise_k = np.minimum(rise_k, 130.0)  # class F insulation, 155 C (IEC 60085)
        hotter = (1.0 + COPPER_PER_K * rise_k) / (1.0 - 0.001 * rise_k) ** 2 - 1.0
        work.drive_w *= 1.0 + copper_share * hotter

    return Mechanism("motor_heating", "motor", change)


def _discharge(work: Work, series_ohm: Array, slow_ohm: float, slow_s: float) -> None:
    """Solve the Thevenin circuit with one RC pair for the current that delivers the required power
    (Plett, vol. 1)."""
    open_v = work.voltage_v
    slow_v = np.zeros_like(open_v)
    current_a = np.zeros_like(open_v)
    for _ in range(4):
        behind_v = open_v - slow_v
        root = np.maximum(behind_v**2 - 4.0 * series_ohm * work.power_w, (0.2 * behind_v) ** 2)
        current_a = (behind_v - np.sqrt(root)) / (2.0 * series_ohm)
        slow_v = slow_ohm * first_order(current_a, work.run.dt_s, slow_s)
    work.chemical_w = open_v * current_a
    work.voltage_v = work.power_w / np.where(np.abs(current_a) > 1e-9, current_a, np.inf)
    work.voltage_v = np.where(np.abs(current_a) > 1e-9, work.voltage_v, open_v - slow_v)


def internal_resistance(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Thevenin battery: a series resistance and a slow polarisation (Plett, Battery Management
    Systems, vol. 1)."""
    ohm = rng.uniform(0.12, 0.2) * vehicle.robot.nominal_voltage_v**2 / peak_power_w(vehicle)
    slow_s = rng.uniform(20.0, 60.0)

    def change(work: Work, _: Generator) -> None:
        _discharge(work, np.full(work.power_w.size, 0.75 * ohm), 0.25 * ohm, slow_s)

    return Mechanism("internal_resistance", "battery", change)


def rate_capacity(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Peukert's law above the rated current only (Doerffel and Sharkh 2006, J. Power Sources
    155)."""
    exponent = rng.uniform(0.1, 0.25)
    rated_w = typical_power_w(vehicle) * rng.uniform(0.4, 0.8)

    def change(work: Work, _: Generator) -> None:
        work.chemical_w = work.power_w * np.maximum(work.power_w / rated_w, 1.0) ** exponent

    return Mechanism("rate_capacity", "battery", change)


def ageing(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Capacity lost, 15 to 35 %: the state of charge, a share of the capacity, falls faster (Plett,
    vol. 2)."""
    capacity_left = 1.0 - rng.uniform(0.15, 0.35)

    def change(work: Work, _: Generator) -> None:
        work.capacity_share = capacity_left

    return Mechanism("ageing", "battery", change)


def cold_battery(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Resistance by Arrhenius' law, of cells that warm themselves a little; activation 30 to 45
    kJ/mol.

    Waag, Kaebitz and Sauer 2013 (Applied Energy 102).
    """
    ohm = rng.uniform(0.03, 0.05) * vehicle.robot.nominal_voltage_v**2 / peak_power_w(vehicle)
    activation_j_per_mol = rng.uniform(30e3, 45e3)
    warming_k = rng.uniform(2.0, 6.0)

    def change(work: Work, _: Generator) -> None:
        load = work.power_w / typical_power_w(vehicle)
        cell_k = (
            KELVIN + work.run.temperature_c + warming_k * first_order(load, work.run.dt_s, 1200.0)
        )
        cold = np.exp(
            activation_j_per_mol / GAS_CONSTANT_J_PER_MOL_K * (1.0 / cell_k - 1.0 / ROOM_K)
        )
        _discharge(work, ohm * cold, 0.2 * ohm * float(cold.mean()), 30.0)

    return Mechanism("cold_battery", "battery", change)


def standby(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """A load that stays on after some time: a lamp or amplifier that draws a third more while
    cold."""
    size_w = typical_power_w(vehicle) * rng.uniform(0.12, 0.3)
    drive = int(rng.integers(0, runs))
    share_driven = rng.uniform(0.3, 0.6)

    def change(work: Work, _: Generator) -> None:
        on = since(work.run, drive, share_driven)
        on_s = np.cumsum(on) * work.run.dt_s
        work.ancillary_w += np.where(on, size_w * (1.0 + 0.3 * np.exp(-on_s / 20.0)), 0.0)

    return Mechanism("standby", "load", change)


def compute(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """A processor whose clock and voltage follow the sensing rate: P ~ f V^2, with leakage once it
    is awake.

    Rabaey, Chandrakasan and Nikolic, Digital Integrated Circuits, ch. 5; governors answer in a
    second or two.
    """
    size_w = typical_power_w(vehicle) * rng.uniform(0.25, 0.5)
    exponent = rng.uniform(1.8, 2.8)
    awake = rng.uniform(0.2, 0.5)
    governor_s = rng.uniform(0.5, 2.0)

    def change(work: Work, _: Generator) -> None:
        use = work.run.sensing_hz / vehicle.robot.max_sensing_hz
        wanted_w = np.where(use > 0.0, size_w * (awake + (1.0 - awake) * use**exponent), 0.0)
        work.ancillary_w += first_order(wanted_w, work.run.dt_s, governor_s, float(wanted_w[0]))

    return Mechanism("compute", "load", change)


def radio(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Airtime of a fixed data stream: log-distance path loss sets the rate, in steps, and so the
    time on the air.

    Rappaport, Wireless Communications, ch. 4; rates and sensitivities of IEEE 802.11a/g, 54 down to
    6 Mbit/s.
    """
    size_w = typical_power_w(vehicle) * rng.uniform(0.2, 0.4)
    rates_mbps = np.array([54.0, 48.0, 36.0, 24.0, 18.0, 12.0, 9.0, 6.0])
    needs_dbm = np.array([-65.0, -66.0, -70.0, -74.0, -77.0, -79.0, -81.0, -82.0])
    exponent = rng.uniform(2.4, 3.5)
    edge_m = vehicle.leg_m * rng.uniform(0.6, 1.0)  # range of the slowest rate

    def change(work: Work, fading: Generator) -> None:
        distance_m = np.maximum(work.run.base_distance_m, 0.01 * vehicle.leg_m)
        shadow_db = ornstein_uhlenbeck(fading, work.run.time_s.size, work.run.dt_s, 1.5, 10.0)
        signal_dbm = needs_dbm[-1] - 10.0 * exponent * np.log10(distance_m / edge_m) + shadow_db
        rung = np.minimum(np.searchsorted(-needs_dbm, -signal_dbm), rates_mbps.size - 1)
        work.ancillary_w += size_w * rates_mbps[-1] / rates_mbps[rung]

    return Mechanism("radio", "load", change)


def heater(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """A thermostat with hysteresis that heats a box with thermal mass."""
    return Mechanism("heater", "load", _thermostat(vehicle, rng, (5.0, 12.0), 1.0))


def cooler(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """The same that cools it: a compressor, on and off."""
    return Mechanism("cooler", "load", _thermostat(vehicle, rng, (18.0, 25.0), -1.0))


def _thermostat(
    vehicle: Plant, rng: Generator, set_points_c: tuple[float, float], sign: float
) -> Callable[[Work, Generator], None]:
    """Power of a thermostat on a box with thermal mass (Incropera, Fundamentals of Heat Transfer,
    ch. 5).

    It heats the box (sign 1) or cools it (-1).
    """
    size_w = typical_power_w(vehicle) * rng.uniform(0.25, 0.5)
    set_c = rng.uniform(*set_points_c)
    band_k = rng.uniform(1.0, 2.0)
    box_s = rng.uniform(200.0, 500.0)
    full_rise_k = rng.uniform(20.0, 35.0)  # of the box with the heater always on

    def change(work: Work, _: Generator) -> None:
        on = False
        box_c = float(work.run.temperature_c[0]) + 2.0
        keep = float(np.exp(-work.run.dt_s / box_s))
        for i, air_c in enumerate(work.run.temperature_c):
            hysteresis_k = band_k if on else -band_k
            on = sign * box_c < sign * set_c + hysteresis_k
            target_c = air_c
            if on:
                target_c += sign * full_rise_k
                work.ancillary_w[i] += size_w
            box_c = target_c + (box_c - target_c) * keep

    return change


def intermittent_load(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """A compressor that switches periodically with jitter, with an inrush at each start."""
    size_w = typical_power_w(vehicle) * rng.uniform(0.25, 0.5)
    period_s = rng.uniform(30.0, 80.0)
    duty = rng.uniform(0.25, 0.5)

    def change(work: Work, jitter: Generator) -> None:
        time_s = work.run.time_s
        start_s = -period_s * jitter.random()
        while start_s < time_s[-1]:
            length_s = period_s * duty * jitter.uniform(0.95, 1.05)
            on_s = np.maximum(time_s - start_s, 0.0)
            on = (time_s >= start_s) & (on_s < length_s)
            work.ancillary_w += np.where(on, size_w * (1.0 + 0.5 * np.exp(-on_s / 0.8)), 0.0)
            start_s += period_s * jitter.uniform(0.97, 1.03)

    return Mechanism("intermittent_load", "load", change)


def sensor_offset(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Remanence of a Hall current sensor: an offset after an overload (LEM application note)."""
    size_w = rng.choice([-1.0, 1.0]) * typical_power_w(vehicle) * rng.uniform(0.1, 0.25)
    drive = int(rng.integers(0, runs))
    share_driven = rng.uniform(0.3, 0.6)

    def change(work: Work, _: Generator) -> None:
        work.read_offset_w += np.where(since(work.run, drive, share_driven), size_w, 0.0)

    return Mechanism("sensor_offset", "instrument", change)


def sensor_gain(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """A shunt whose contact loosens: from some time on a gain error that grows gradually."""
    share = rng.uniform(0.12, 0.3)
    drive = int(rng.integers(0, runs))
    share_driven = rng.uniform(0.2, 0.5)

    def change(work: Work, _: Generator) -> None:
        loose = since(work.run, drive, share_driven).astype(np.float64)
        work.read_gain *= 1.0 + share * first_order(loose, work.run.dt_s, 5.0, float(loose[0]))

    return Mechanism("sensor_gain", "instrument", change)


def clock_lag(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Power stamped late by its own computer and smoothed by the meter's filter."""
    lag_s = rng.uniform(0.8, 3.0)
    smooth_s = rng.uniform(0.05, 0.3)

    def change(work: Work, _: Generator) -> None:
        work.read_lag_s = lag_s
        work.read_smooth_s = smooth_s

    return Mechanism("clock_lag", "instrument", change)


def odometry_scale(vehicle: Plant, rng: Generator, runs: int) -> Mechanism:
    """Wheel odometry with the wrong tyre radius after a change of tyres; distance is by satellite
    (Borenstein 1996)."""
    share = rng.choice([-1.0, 1.0]) * rng.uniform(0.08, 0.2)
    drive = int(rng.integers(0, runs)) if rng.random() < 0.5 else 0

    def change(work: Work, _: Generator) -> None:
        work.odometer_gain *= np.where(since(work.run, drive, 0.0), 1.0 + share, 1.0)

    return Mechanism("odometry_scale", "instrument", change)


EFFECTS: dict[str, Draw] = {
    draw.__name__: draw
    for draw in (
        turning, inertia, breakaway, viscous, wind, surface, payload, hidden_grade, slip, regeneration, copper_loss,
        no_load, motor_heating, internal_resistance, rate_capacity, ageing, cold_battery, standby, compute, radio,
        heater, intermittent_load, sensor_offset, sensor_gain, clock_lag, odometry_scale, cooler,
    )
}  # fmt: skip
"""Every effect id, with the function that draws its mechanism."""

INSTRUMENTS = ("sensor_offset", "sensor_gain", "clock_lag", "odometry_scale")
