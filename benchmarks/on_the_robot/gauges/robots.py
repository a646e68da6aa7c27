"""The true robot and pack of a drive, and the robot file that the companion gets."""

from __future__ import annotations

import json
import re
import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.random import Generator

from benchmarks.on_the_robot.gauges.cell import (
    CURVES,
    Floats,
    Pack,
    discharge,
    full_state,
    open_circuit_v,
)
from benchmarks.on_the_robot.gauges.sizes import Sizes, between
from homeward.companion import Companion

Curve = Literal["none", "chemistry", "measured"]
LABEL_C = 25.0  # C, makers state capacities at 20 to 25 C


@dataclass(frozen=True)
class TrueRobot:
    """What moves and what it consumes; powers are at the battery's terminals."""

    mass_kg: float
    rolling_resistance: float
    drag_ns2_per_m2: float
    gear_loss: float  # share of the wheels' power, added
    copper_w_per_n2: float  # copper loss grows with the square of the force
    standby_w: float
    cruise_mps: float


@dataclass(frozen=True)
class Label:
    """What is printed on a pack."""

    cells: int
    voltage_v: float
    energy_j: float

    @property
    def charge_ah(self) -> float:
        """Rated charge, Ah."""
        return self.energy_j / self.voltage_v / 3600.0


def read_preset(preset: str) -> dict[str, Any]:
    """Sections of a preset's robot file."""
    return tomllib.loads((files("homeward") / "robots" / f"{preset}.toml").read_text())


def draw_robot(preset: str, cruise_mps: list[float], sizes: Sizes, rng: Generator) -> TrueRobot:
    """Draw a robot near its file; its losses equal the file's when it cruises on level ground
    without wind."""
    stated = read_preset(preset)
    body = stated["body"]
    drive = stated["drive"]
    ancillary = stated["ancillary"]
    truth = sizes.truth
    pace_mps = between(rng.random(), cruise_mps)
    stated_force_n = body["mass_kg"] * 9.81 * body["rolling_resistance"]
    stated_wheel_w = stated_force_n * pace_mps
    gear_loss = 1.0 / (1.0 - drive["friction_loss"]) - 1.0
    stated_motor_w = stated_wheel_w * (1.0 + gear_loss)
    copper_w = stated_motor_w * drive["motor_loss"] / (1.0 - drive["motor_loss"])
    standby_w = (
        ancillary["sensing_idle_w"] + ancillary["communication_w"] + ancillary["controller_w"]
    )
    return TrueRobot(
        mass_kg=body["mass_kg"] * (1.0 + between(rng.random(), truth.payload_share)),
        rolling_resistance=body["rolling_resistance"] * between(rng.random(), truth.rolling_factor),
        drag_ns2_per_m2=body["drag_ns2_per_m2"] * between(rng.random(), truth.drag_factor),
        gear_loss=gear_loss * between(rng.random(), truth.gear_loss_factor),
        copper_w_per_n2=copper_w / stated_force_n**2,
        standby_w=standby_w * between(rng.random(), truth.standby_factor),
        cruise_mps=pace_mps,
    )


def label_of(preset: str, cells: int, cell_label_v: float, pack_share: float) -> Label:
    """Label of a pack with the preset's energy, times `pack_share`, made of other cells."""
    rated_energy_j = read_preset(preset)["battery"]["rated_energy_j"]
    return Label(cells=cells, voltage_v=cells * cell_label_v, energy_j=rated_energy_j * pack_share)


@dataclass(frozen=True)
class Wear:
    """By how much a pack differs from a new one at 25 C."""

    resistance_factor: float
    capacity_share: float
    outside_c: float


def draw_wear(sizes: Sizes, rng: Generator) -> Wear:
    """Draw the age of a pack, and the air around it."""
    return Wear(
        resistance_factor=between(rng.random(), sizes.truth.resistance_factor),
        capacity_share=between(rng.random(), sizes.truth.capacity_share),
        outside_c=between(rng.random(), sizes.truth.temperature_c),
    )


def worn_pack(chemistry: str, label: Label, sizes: Sizes, wear: Wear) -> Pack:
    """A true pack.

    A new pack gives the energy of its label at 25 C within the label's hours; a faded one that much
    less charge.
    """
    cell = sizes.cells[chemistry]
    circuit = sizes.circuit
    new = Pack(
        curve=CURVES[cell.curve],
        curve_v=np.array(cell.curve_v),
        cells=label.cells,
        label_ah=label.charge_ah,
        true_ah=label.charge_ah,
        learned_ah=label.charge_ah,
        cutoff_v=cell.cutoff_v * label.cells,
        ohm_sag_v=cell.ohm_sag_v,
        slow_sag_v=cell.slow_sag_v,
        diffusion_sag_v=cell.diffusion_sag_v,
        ohm_activation_k=cell.activation_k[0],
        slow_activation_k=cell.activation_k[1],
        cold_loss_per_k=cell.cold_loss_per_k,
        heat_j_per_k=cell.heat_j_per_k_wh * label.energy_j / 3600.0,
        well_share=cell.well_share,
        well_per_h=cell.well_per_h,
        slow_s=circuit.slow_s,
        diffusion_s=circuit.diffusion_s,
        knee_c=circuit.knee_c,
        low_charge_rise=circuit.low_charge_rise,
        low_charge_share=circuit.low_charge_share,
        cooling_s=circuit.cooling_s,
        outside_c=LABEL_C,
    )
    label_w = label.energy_j / (3600.0 * sizes.truth.label_hours)
    new_j, _new_ah = discharge(new, full_state(new, 1.0), label_w, sizes.truth.trip_s)
    faded = new._replace(
        true_ah=label.charge_ah * wear.capacity_share * label.energy_j / new_j,
        ohm_sag_v=cell.ohm_sag_v * wear.resistance_factor,
        slow_sag_v=cell.slow_sag_v * wear.resistance_factor,
        diffusion_sag_v=cell.diffusion_sag_v * wear.resistance_factor,
    )
    _faded_j, learned_ah = discharge(faded, full_state(faded, 1.0), label_w, sizes.truth.trip_s)
    return faded._replace(learned_ah=learned_ah, outside_c=wear.outside_c)


def measured_curve(pack: Pack, sizes: Sizes, rng: Generator) -> Floats:
    """Open-circuit curve as a user measures it: shares of charge and volts of the pack, shape
    (points, 2)."""
    shares = np.linspace(0.0, 1.0, sizes.curve.measured_points)
    cell_v = np.array([open_circuit_v(pack.curve, pack.curve_v, share) for share in shares])
    error_v = rng.normal(0.0, sizes.curve.measured_sd_v, shares.size)
    # A user would correct a curve that falls while the charge rises.
    pack_v = np.maximum.accumulate((cell_v + error_v) * pack.cells)
    rising_v = pack_v + 1e-4 * np.arange(shares.size)
    return np.column_stack([shares, rising_v])


def robot_file(
    folder: Path,
    preset: str,
    label: Label,
    chemistry: str,
    curve: Curve,
    measured_v: Floats | None = None,
) -> Path:
    """Write the preset with another pack into a folder, and return its path.

    Args:
        folder: Where to write it.
        preset: Name of the preset.
        label: What is printed on the pack.
        chemistry: Chemistry of the pack.
        curve: What the file says of the open-circuit voltage: nothing, the chemistry, or a measured
            curve.
        measured_v: Shares and volts of the pack, shape (points, 2); only for "measured".
    """
    text = (files("homeward") / "robots" / f"{preset}.toml").read_text()
    text = re.sub(r"(?m)^(chemistry|cells_in_series) = .*\n", "", text)
    text = re.sub(r"(?m)^rated_energy_j = .*$", f"rated_energy_j = {label.energy_j}", text)
    text = re.sub(
        r"(?m)^nominal_voltage_v = .*$", f"nominal_voltage_v = {label.voltage_v:.6g}", text
    )
    lines = "[battery]\n"
    if curve == "chemistry":
        lines += f'chemistry = "{chemistry}"\n'
        if chemistry != "flat":  # a flat curve is that of any number of cells
            lines += f"cells_in_series = {label.cells}\n"
    if curve == "measured":
        assert measured_v is not None
        lines += f"open_circuit_v = {json.dumps(measured_v.round(4).tolist())}\n"
    path = folder / f"{preset}.toml"
    path.write_text(text.replace("[battery]\n", lines))
    return path


def refusal(curve: Curve, chemistry: str, sizes: Sizes) -> str | None:
    """What the companion says against such a robot file; None if it accepts it."""
    place = sizes.robots["husky"]
    cells = place.cells[chemistry]
    cell = sizes.cells[chemistry]
    label = label_of(place.preset, cells, cell.label_v, 1.0)
    shares = np.array([0.0, 1.0])
    empty_v = open_circuit_v(CURVES[cell.curve], np.array(cell.curve_v), 0.0)
    full_v = open_circuit_v(CURVES[cell.curve], np.array(cell.curve_v), 1.0)
    straight_v = np.column_stack([shares, np.array([empty_v, full_v]) * cells])
    with tempfile.TemporaryDirectory() as folder:
        path = robot_file(Path(folder), place.preset, label, chemistry, curve, straight_v)
        try:
            Companion(path)
        except ValueError as error:
            return str(error)
    return None


def accepted_curve(chemistries: Sequence[str], sizes: Sizes) -> Curve:
    """The best that the installed version accepts without a measurement: the chemistries, or
    nothing."""
    for chemistry in chemistries:
        if refusal("chemistry", chemistry, sizes) is not None:
            return "none"
    return "chemistry"
