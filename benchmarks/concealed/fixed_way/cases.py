"""The cases: some drives along one way, with something hidden in the ground, the motion or a load.

Every number of a case is chosen, so that each hidden part consumes 8 to 21 % of all energy. A
docstring says what is hidden, and what a diagnosis that confuses causes would name.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.random import Generator

from benchmarks.concealed.fixed_way.drive import (
    Drive,
    NewPace,
    PlaceFactor,
    Plan,
    Spell,
    Stop,
    drive,
    slower_uphill,
)
from benchmarks.concealed.fixed_way.mechanisms import (
    chatter_share,
    switched,
    taken_up,
    thermostat,
    warmth,
)
from benchmarks.concealed.fixed_way.noise import Array
from benchmarks.concealed.fixed_way.robot import (
    GRAVITY_MPS2,
    MASS_KG,
    ROLLING_RESISTANCE,
    Hidden,
    energy_j,
    record,
)
from benchmarks.concealed.fixed_way.way import Way, draw_way, within

MILD_C = (13.0, 23.0)  # chosen: neither heating nor cooling is needed
HOT_C = (28.5, 37.5)  # chosen: a cooler runs for part of the time
HOT_SPREAD_C = 0.4  # chosen
ALWAYS_TOLERATED = "internal_resistance"
"""The battery has one, 0.7 % of the power, which no file of the robot contains."""


@dataclass(frozen=True)
class Scene:
    """The drives of a case, in the order in which they were driven."""

    drives: tuple[Drive, ...]
    hidden: tuple[Hidden, ...]  # one a drive
    temperatures_c: Array  # of the air, one a drive

    def energy_shares(self) -> dict[str, float]:
        """Share of all energy that each hidden part consumes, and `all` of them together: energy
        with it less energy without it."""
        with_all_j = energy_j(self.drives, self.hidden)
        parts = [part for hidden in self.hidden for part in hidden.parts]
        shares = {}
        for field in dataclasses.fields(Hidden):
            if field.name in parts:
                shares[field.name] = 1 - self._energy_without_j((field.name,)) / with_all_j
        shares["all"] = 1 - self._energy_without_j(tuple(parts)) / with_all_j
        return shares

    def _energy_without_j(self, parts: tuple[str, ...]) -> float:
        return energy_j(self.drives, [hidden.without(parts) for hidden in self.hidden])


@dataclass(frozen=True)
class Case:
    """A case, with what is true of it."""

    number: str
    title: str
    seed: int
    cause: str  # of ground, motion, load, time, payload and none
    # Ids of the diagnosis that are right; none where nothing of the catalogue fits.
    effects: tuple[str, ...]
    make: Callable[[Generator], Scene]
    # Ids that are not wrong beside the right ones, but not enough alone.
    also_tolerated: tuple[str, ...] = ()

    @property
    def tolerated(self) -> tuple[str, ...]:
        """Ids that are not wrong beside the right ones, but not enough alone."""
        return (ALWAYS_TOLERATED, *self.also_tolerated)


@dataclass(frozen=True)
class Simulated:
    """A case with its recordings."""

    scene: Scene
    recordings: tuple[pd.DataFrame, ...]  # one a drive


def simulate(case: Case) -> Simulated:
    """Drive and record a case; the same case gives the same recordings."""
    rng = np.random.default_rng(case.seed)
    scene = case.make(rng)
    recordings = []
    for run, hidden, temperature_c in zip(
        scene.drives, scene.hidden, scene.temperatures_c, strict=True
    ):
        recordings.append(record(run, hidden, temperature_c, rng))
    return Simulated(scene, tuple(recordings))


def rough_far_half_and_payload(rng: Generator) -> Scene:
    """Rolling resistance is 50 % higher from 122 m of the way on; in drives 2, 3, 4, 6 and 7, 25 kg
    are taken up at a stop and carried to the end.

    Wrong: only one of the two; a load or radio for the far half; the payload as rough ground or as
    a load in time.
    """
    way = _way(11, length_m=245.0)
    rough = way.roughness((0.5, 1.01))
    drives = []
    hidden = []
    for taken_up_at in (None, 0.33, 0.62, 0.18, None, 0.80, 0.45):  # shares of the drive
        plan = Plan(rng.uniform(0.68, 0.90), random_stops=2, place_factor=slower_uphill(way))
        if taken_up_at is not None:
            stop = Stop(taken_up_at * way.round_trip_m, seconds=30.0)
            plan = dataclasses.replace(plan, stops=(stop,))
        run = drive(way, plan, rng)
        payload_kg = np.zeros(len(run.time_s))
        for stop in plan.stops:
            payload_kg = 25.0 * taken_up(run, stop.driven_m, after_s=15.0)
        surface_share = 0.5 * way.at(rough, run.place_m)
        drives.append(run)
        hidden.append(Hidden(surface_share=surface_share, payload_kg=payload_kg))
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def rough_stretches_and_viscous_drag(rng: Generator) -> Scene:
    """Rolling resistance is 60 % higher from 43 to 91 m and from 158 to 211 m; everywhere there is
    a viscous drag of 32 N s/m.

    Wrong: no ground, with all put on speed; no viscous drag, with all put on ground; a load in
    time.
    """
    way = _way(12, length_m=240.0)
    rough = way.roughness((0.18, 0.38), (0.66, 0.88))
    drives = []
    hidden = []
    for pace_mps in rng.permutation([0.64, 0.68, 0.72, 0.80, 0.88, 0.98, 0.76]):
        plan = Plan(pace_mps, random_spells=3, place_factor=slower_uphill(way))
        run = drive(way, plan, rng)
        surface_share = 0.6 * way.at(rough, run.place_m)
        drives.append(run)
        hidden.append(Hidden(surface_share=surface_share, viscous_ns_per_m=32.0))
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def rough_steepest_and_constant_load(rng: Generator) -> Scene:
    """Rolling resistance is 90 % higher on the one steep slope, of 0.115 rad from 125 to 182 m, up
    and down alike; from drive 4 on, 22 W are drawn all the time.

    Wrong: what grows with force or slope, such as slip, copper loss or payload, as it would not
    raise the way down; the load as ground or motion.
    """
    level_way = _way(13, length_m=240.0, steepest_rad=0.055)
    start_m = 0.52 * level_way.length_m
    end_m = 0.76 * level_way.length_m
    ramp = within(level_way.place_m, start_m, end_m, edge_m=6.0)
    grade_rad = level_way.grade_rad * (1 - ramp) + 0.115 * ramp
    way = dataclasses.replace(level_way, grade_rad=grade_rad)
    rough = way.roughness((0.52, 0.76))
    slower = slower_uphill(way, slower_share=0.15, steep_rad=0.1)
    drives = []
    hidden = []
    paces_mps = rng.permutation([0.66, 0.70, 0.75, 0.8, 0.86, 0.72, 0.68, 0.83])
    for number, pace_mps in enumerate(paces_mps, start=1):
        run = drive(way, Plan(pace_mps, place_factor=slower), rng)
        load_w = 22.0 if number >= 4 else 0.0
        surface_share = 0.9 * way.at(rough, run.place_m)
        drives.append(run)
        hidden.append(Hidden(surface_share=surface_share, load_w=load_w))
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def bent_steering(rng: Generator) -> Scene:
    """Every bend to the left drags with up to 126 N, and none to the right; no ground is rough.

    Wrong: rough ground in the bends, as the same places are free of it the other way; a load in
    time.
    """
    mean_curvature_per_m = 0.22
    way = _way(14, 225.0, 0.06, mean_curvature_per_m, bent_share=0.62)
    drives = []
    hidden = []
    for pace_mps in rng.permutation([0.65, 0.70, 0.74, 0.78, 0.86, 0.67, 0.82]):
        run = drive(way, Plan(pace_mps, dodges=10, place_factor=slower_uphill(way)), rng)
        slowest_mps = 0.05  # below it, no curvature is known
        curvature_per_m = run.yaw_rate_radps / np.maximum(run.speed_mps, slowest_mps)
        curvature_per_m = np.where(run.speed_mps > slowest_mps, curvature_per_m, 0.0)
        force_n = 90.0 * np.clip(curvature_per_m / mean_curvature_per_m, 0, 1.4)
        drives.append(run)
        hidden.append(Hidden(force_n=force_n))
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def chatter_on_slow_hills(rng: Generator) -> Scene:
    """The drive draws 70 % more between 0.40 and 0.55 m/s. That speed is driven on the slopes, both
    ways, but also in two slow spells a drive on the level; drives 3 and 7 take the slopes at
    0.7 m/s.

    Wrong: rough ground on the slopes, slip, copper loss or payload. The mirror of `rough_where_slow`,
    which has the same way and speeds.
    """
    way, hills = _slow_hills_way()
    drives = _slow_hills_drives(way, hills, rng)
    hidden = [Hidden(drive_share=chatter_share(run.speed_mps, 0.70)) for run in drives]
    return Scene(drives, tuple(hidden), _mild_c(rng, len(drives)))


def chatter_by_drive(rng: Generator) -> Scene:
    """The drive draws 50 % more between 0.40 and 0.55 m/s; the speed is set by the drive, and
    changes under way in four of nine.

    Wrong: rough ground; a load in time, as it would also be drawn standing and not end with the
    speed; a gain of the sensor.
    """
    way = _way(16, length_m=185.0, steepest_rad=0.07)
    paces_mps: tuple[tuple[float, float | None], ...] = (
        (0.47, None), (0.72, None), (0.66, 0.5), (0.50, None), (0.82, None), (0.5, 0.78), (0.62, None),
        (0.48, 0.64), (0.76, 0.49),
    )  # fmt: skip
    drives = []
    for pace_mps, new_pace_mps in paces_mps:
        plan = Plan(pace_mps, random_spells=1, spell_factor=(0.8, 0.9), far_stop_s=25.0)
        if new_pace_mps is not None:
            changed_at_m = rng.uniform(0.3, 0.7) * way.round_trip_m
            plan = dataclasses.replace(plan, new_pace=NewPace(changed_at_m, new_pace_mps))
        drives.append(drive(way, plan, rng))
    hidden = [Hidden(drive_share=chatter_share(run.speed_mps, 0.50)) for run in drives]
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def gearbox_warms_up(rng: Generator) -> Scene:
    """At the start of every drive, friction is 80 % above the rolling resistance; it falls within
    180 s of driving. Standing draws no more.

    Wrong: rough ground near the base, as the way back over it is free of it; motor heating, which
    rises; a load.
    """
    way = _way(17, length_m=235.0)
    drives = []
    hidden = []
    for _ in range(8):
        pace_mps = rng.uniform(0.6, 0.86)
        wait_s = rng.uniform(5, 60)
        plan = Plan(pace_mps, dt_s=0.2, place_factor=slower_uphill(way), wait_s=wait_s)
        run = drive(way, plan, rng)
        cold_share = 0.8 * (1 - warmth(run))
        drives.append(run)
        hidden.append(Hidden(force_n=cold_share * ROLLING_RESISTANCE * MASS_KG * GRAVITY_MPS2))
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def random_device_and_rough_stretch(rng: Generator) -> Scene:
    """Rolling resistance is 70 % higher from 72 to 149 m; a device of 38 W is switched at random
    times.

    Wrong: only one of the two; the device as ground, motion or a thermostat.
    """
    way = _way(18, length_m=240.0)
    rough = way.roughness((0.30, 0.62))
    drives = []
    hidden = []
    for _ in range(8):
        run = _ordinary(way, rng)
        surface_share = 0.7 * way.at(rough, run.place_m)
        load_w = 38.0 * switched(rng, run.time_s, on_s=80.0, off_s=120.0)
        drives.append(run)
        hidden.append(Hidden(surface_share=surface_share, load_w=load_w))
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def thermostat_compressor(rng: Generator) -> Scene:
    """A thermostat switches a compressor of 65 W, on at 26 °C inside and off at 22 °C: it runs the
    longer, the hotter the day.

    Wrong: ground or motion. An intermittent load alone, unrelated to temperature, is half right.
    """
    way = _way(19, length_m=240.0)
    temperatures_c = _hot_c(rng, 9)
    drives = []
    hidden = []
    for air_c in temperatures_c:
        run = _ordinary(way, rng)
        drives.append(run)
        hidden.append(Hidden(load_w=65.0 * thermostat(rng, run, air_c)))
    return Scene(tuple(drives), tuple(hidden), temperatures_c)


def random_device_on_hot_days(rng: Generator) -> Scene:
    """A device of 65 W is switched at random times on hot days, unrelated to the temperature.

    Wrong: a cooler, ground or motion.
    """
    way = _way(20, length_m=240.0)
    temperatures_c = _hot_c(rng, 9)
    time_s = np.arange(0, 1500, 0.1)  # longer than any of these drives takes
    devices = [switched(rng, time_s, on_s=95.0, off_s=125.0) for _ in temperatures_c]
    drives = []
    hidden = []
    for device in devices:
        run = _ordinary(way, rng)
        drives.append(run)
        hidden.append(Hidden(load_w=65.0 * device[: len(run.time_s)]))
    return Scene(tuple(drives), tuple(hidden), temperatures_c)


def soft_ground_after_rain(rng: Generator) -> Scene:
    """Rolling resistance is 85 % higher from 53 to 158 m, in drives 5 to 9 only.

    Wrong: a load, gain or payload from drive 5 on, as it is drawn only at that place and not
    standing; motion.
    """
    way = _way(21, length_m=240.0)
    rough = way.roughness((0.22, 0.66))
    drives = []
    hidden = []
    for number in range(1, 10):
        run = _ordinary(way, rng, dt_s=0.2)
        softer_share = 0.85 if number >= 5 else 0.0
        drives.append(run)
        hidden.append(Hidden(surface_share=softer_share * way.at(rough, run.place_m)))
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def radio_by_distance(rng: Generator) -> Scene:
    """The radio draws 950 W/km² by the square of the distance, 59 W at 250 m, standing and driving
    alike.

    Wrong: rough ground beyond the middle, as the same power is drawn standing there; motion; a load
    in time.
    """
    way = _way(22, length_m=250.0)
    drives = []
    hidden = []
    for _ in range(8):
        pace_mps = rng.uniform(0.70, 0.95)
        far_stop_s = rng.uniform(15, 35)
        stops = []
        for _ in range(2):
            driven_m = rng.uniform(0.3, 0.7) * way.round_trip_m
            stops.append(Stop(driven_m, rng.uniform(12, 25)))
        plan = Plan(pace_mps, far_stop_s=far_stop_s, random_stops=2, stops=tuple(stops))
        run = drive(way, dataclasses.replace(plan, place_factor=slower_uphill(way)), rng)
        distance_km = run.place_m / 1000.0
        drives.append(run)
        hidden.append(Hidden(load_w=950.0 * distance_km**2))
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def rough_where_slow(rng: Generator) -> Scene:
    """Rolling resistance is 65 % higher on all slopes steeper than about 0.033 rad, up and down
    alike; they are driven at 0.48 m/s, but at 0.7 m/s in drives 3 and 7.

    Wrong: a band of speeds, slip, copper loss or payload. The mirror of `chatter_on_slow_hills`.
    """
    way, hills = _slow_hills_way()
    drives = _slow_hills_drives(way, hills, rng)
    rough = hills * way.texture
    hidden = [Hidden(surface_share=0.65 * way.at(rough, run.place_m)) for run in drives]
    return Scene(drives, tuple(hidden), _mild_c(rng, len(drives)))


def nothing_hidden(rng: Generator) -> Scene:
    """The robot is as its file says.

    Wrong: any cause.
    """
    way = _way(24, length_m=240.0)
    drives = []
    for _ in range(7):
        plan = Plan(rng.uniform(0.6, 0.88), place_factor=slower_uphill(way))
        drives.append(drive(way, plan, rng))
    hidden = [Hidden() for _ in drives]
    return Scene(tuple(drives), tuple(hidden), _mild_c(rng, len(drives)))


def _way(
    seed: int,
    length_m: float,
    steepest_rad: float = 0.08,
    curvature_per_m: float = 0.10,
    bent_share: float = 0.35,
) -> Way:
    """The way of a case, which has a seed of its own, so that it is there before any drive."""
    rng = np.random.default_rng(seed)
    return draw_way(rng, length_m, steepest_rad, curvature_per_m, bent_share)


def _ordinary(way: Way, rng: Generator, dt_s: float = 0.1) -> Drive:
    """A drive at an ordinary pace."""
    plan = Plan(rng.uniform(0.66, 0.90), dt_s, place_factor=slower_uphill(way))
    return drive(way, plan, rng)


def _mild_c(rng: Generator, count: int) -> Array:
    """Temperatures of mild days, °C, shape (count,)."""
    return rng.uniform(*MILD_C, count)


def _hot_c(rng: Generator, count: int) -> Array:
    """Temperatures of hot days, °C, shape (count,)."""
    even_c = np.linspace(*HOT_C, count)[rng.permutation(count)]
    return np.asarray(even_c + rng.uniform(-HOT_SPREAD_C, HOT_SPREAD_C, count))


def _slow_hills_way() -> tuple[Way, Array]:
    """A steep way, and where its slopes are: 1 on them and 0 on the level, shape (n,)."""
    way = _way(15, length_m=205.0, steepest_rad=0.09)
    steep = np.clip((np.abs(way.grade_rad) - 0.030) / 0.006, 0, 1)
    window = np.hanning(16)  # 4 m
    return way, np.convolve(steep, window / window.sum(), "same")


def _slow_hills_drives(way: Way, hills: Array, rng: Generator) -> tuple[Drive, ...]:
    """Eight drives whose speed is set by the place: 0.48 m/s on slopes either way, 0.75 elsewhere.

    Drives 3 and 7 are in a hurry. Every drive has two slow spells at level places of its own.
    """
    drives = []
    for number in range(1, 9):
        hurries = number in (3, 7)
        pace_mps = rng.uniform(0.72, 0.78) * (1.2 if hurries else 1.0)
        slope_mps = 0.70 if hurries else rng.uniform(0.46, 0.50)
        spell_factor = 0.52 if hurries else 0.48 / pace_mps
        spells = []
        for _ in range(2):
            start_m = _level_place_m(way, rng)
            spells.append(Spell(start_m, start_m + rng.uniform(7, 11), spell_factor))
        slower = _slower_on(way, hills, slope_mps / pace_mps)
        plan = Plan(pace_mps, spells=tuple(spells), place_factor=slower)
        drives.append(drive(way, plan, rng))
    return tuple(drives)


def _level_place_m(way: Way, rng: Generator) -> float:
    """Where a drive passes a level place that is not at an end of the way, m driven since the
    start."""
    while True:
        driven_m = rng.uniform(0.05, 0.9) * way.round_trip_m
        place_m = driven_m if driven_m < way.length_m else way.round_trip_m - driven_m
        is_between = 4 < place_m < way.length_m - 4
        if is_between and abs(way.at(way.grade_rad, place_m)) < 0.02:
            return driven_m


def _slower_on(way: Way, hills: Array, slope_factor: float) -> PlaceFactor:
    """Factor of the pace that is `slope_factor` on slopes and 1 elsewhere."""

    def factor(place_m: Array, direction: int) -> Array:
        return np.asarray(1 - (1 - slope_factor) * way.at(hills, place_m))

    return factor


_ALL = (
    Case("01", "rough far half and payload", 101, "ground+payload", ("surface", "payload"),
         rough_far_half_and_payload),
    Case("02", "two rough stretches and viscous drag", 102, "ground+motion", ("surface", "viscous"),
         rough_stretches_and_viscous_drag),
    Case("03", "rough where steepest and constant load", 103, "ground+load", ("surface", "standby"),
         rough_steepest_and_constant_load, ("sensor_offset", "intermittent_load")),
    Case("04", "bent steering", 104, "motion", (), bent_steering, ("turning",)),
    Case("05", "chatter on slow hills", 105, "motion", (), chatter_on_slow_hills),
    Case("06", "chatter by drive", 106, "motion", (), chatter_by_drive),
    Case("07", "gearbox warms up", 107, "time", (), gearbox_warms_up),
    Case("08", "random device and rough stretch", 108, "ground+load", ("surface", "intermittent_load"),
         random_device_and_rough_stretch),
    Case("09", "compressor with thermostat", 109, "load", ("cooler",), thermostat_compressor,
         ("intermittent_load",)),
    # The first seed from 1100 on by which the time that the device is on is unrelated to temperature.
    Case("10", "random device on hot days", 1109, "load", ("intermittent_load",), random_device_on_hot_days),
    Case("11", "soft ground after rain", 111, "ground", ("surface",), soft_ground_after_rain),
    Case("12", "radio by distance", 112, "load", ("radio",), radio_by_distance),
    Case("13", "rough where slow", 105, "ground", ("surface",), rough_where_slow),  # drives as of 05
    Case("14", "nothing hidden", 114, "none", (), nothing_hidden),
)  # fmt: skip
CASES: Mapping[str, Case] = {case.number: case for case in _ALL}
"""All cases by number."""
