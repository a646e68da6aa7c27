"""What a drive needs of a battery, whichever engine gives its voltage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from benchmarks.on_the_robot.gauges import pybamm_pack
from benchmarks.on_the_robot.gauges.cell import Pack, discharge, full_state
from benchmarks.on_the_robot.gauges.ground import Ground
from benchmarks.on_the_robot.gauges.robots import Label, Wear, worn_pack
from benchmarks.on_the_robot.gauges.sizes import Sizes, TruthSizes
from benchmarks.on_the_robot.gauges.way import WayHome, WayOut, drive_home, drive_out

Engine = Literal["circuit", "pybamm"]


class Battery(Protocol):
    """A battery at the start of a drive."""

    @property
    def cells(self) -> int:
        """Cells in series."""

    @property
    def learned_ah(self) -> float:
        """Charge that it gives at 25 C before it is cut off, Ah."""

    @property
    def cutoff_v(self) -> float:
        """Voltage of the pack at which it is cut off."""

    @property
    def outside_c(self) -> float:
        """Temperature of the air."""

    def drive_out(self, ground: Ground, update_s: float, truth: TruthSizes) -> WayOut:
        """Drive out until the battery is cut off or the way ends."""

    def drive_home(self, way: WayOut, turn: int, ground: Ground, truth: TruthSizes) -> WayHome:
        """Turn at the update with index `turn`, and drive home along the same way."""

    def left_j(self, way: WayOut, index: int, power_w: float, truth: TruthSizes) -> float:
        """Energy that it still delivers at an update under a steady power, to its cut-off, J."""


@dataclass(frozen=True)
class Circuit:
    """The circuit of `cell.py`."""

    pack: Pack
    start_share: float

    @property
    def cells(self) -> int:
        """Cells in series."""
        return self.pack.cells

    @property
    def learned_ah(self) -> float:
        """Charge that it gives at 25 C before it is cut off, Ah."""
        return self.pack.learned_ah

    @property
    def cutoff_v(self) -> float:
        """Voltage of the pack at which it is cut off."""
        return self.pack.cutoff_v

    @property
    def outside_c(self) -> float:
        """Temperature of the air."""
        return self.pack.outside_c

    def drive_out(self, ground: Ground, update_s: float, truth: TruthSizes) -> WayOut:
        """Drive out until the battery is cut off or the way ends."""
        return drive_out(
            self.pack, full_state(self.pack, self.start_share), ground, update_s, truth
        )

    def drive_home(self, way: WayOut, turn: int, ground: Ground, truth: TruthSizes) -> WayHome:
        """Turn at the update with index `turn`, and drive home along the same way."""
        return drive_home(self.pack, way, turn, ground, truth)

    def left_j(self, way: WayOut, index: int, power_w: float, truth: TruthSizes) -> float:
        """Energy that it still delivers at an update under a steady power, to its cut-off, J."""
        return float(discharge(self.pack, way.states[index], power_w, truth.trip_s)[0])


def make_battery(
    engine: Engine, chemistry: str, label: Label, sizes: Sizes, wear: Wear, start_share: float
) -> Circuit | pybamm_pack.PybammPack:
    """A worn battery, charged to a share."""
    if engine == "pybamm":
        return pybamm_pack.make_pack(chemistry, label, sizes, wear, start_share)
    return Circuit(worn_pack(chemistry, label, sizes, wear), start_share)
