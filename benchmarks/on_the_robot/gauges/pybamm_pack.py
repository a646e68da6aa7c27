"""A pack of PyBaMM's cells, stepped through every drive: what `--engine pybamm` drives with.

The cells are of parameter sets that neither `homeward` nor the circuit of `cell.py` took a curve
from, where there is one: `lfp` has only Prada2013, to which the circuit's curve was fitted. They
are single particles, of Mohtat2020 with electrolyte, as cold as the air all the time. The
electrolyte of Ai2020 leaves its range in the cold (7 mol/l at half a charge an hour and -7 C, where
the solver fails), and Prada2013 lacks what its dynamics need. Power is averaged over steps of
`STEP_S`, so the peaks of shorter hills and the seconds below the cut-off until a protection trips
are left out.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.on_the_robot.gauges.cell import KELVIN, Floats, full_state
from benchmarks.on_the_robot.gauges.ground import Ground
from benchmarks.on_the_robot.gauges.robots import LABEL_C, Label, Wear, worn_pack
from benchmarks.on_the_robot.gauges.sizes import Sizes, TruthSizes
from benchmarks.on_the_robot.gauges.way import (
    CELL,
    CURRENT_A,
    ENERGY_J,
    POWER_W,
    SHARE,
    TEMPERATURE_C,
    TIME_S,
    VOLTAGE_V,
    WayHome,
    WayOut,
    drive_out,
)

PARAMETER_SETS = {
    "nmc": "Mohtat2020",  # NMC and graphite, Mohtat et al. 2020
    "lipo": "Ai2020",  # LCO and graphite in a pouch, Ai et al. 2020
    "lfp": "Prada2013",  # LFP and graphite, Prada et al. 2013
}
STEP_S = 20.0  # s, chosen: an hour in 180 steps; diffusion in cells takes minutes
ENDLESS = 1e6  # chosen: a battery so many times the charge of a label does not end on the way


@dataclass(frozen=True)
class Cell:
    """A cell's model, built once, with all that differs between drives as an input.

    Attributes:
        full_ah: Charge between 0 and 100 % at rest.
        nominal_ah: Charge on its label.
    """

    chemistry: str
    values: Any
    model: Any
    solver: Any
    full_ah: float
    nominal_ah: float

    def inputs(self, share: float, temperature_c: float, contact_ohm: float) -> dict[str, float]:
        """What a drive begins with: share of charge, air, and what its resistance has risen by, in
        ohms of a cell."""
        begins = _stoichiometries(self.chemistry, share)
        concentrations = {
            f"Initial concentration in {electrode} electrode [mol.m-3]": float(stoichiometry)
            * float(self.values[f"Maximum concentration in {electrode} electrode [mol.m-3]"])
            for electrode, stoichiometry in zip(("negative", "positive"), begins, strict=True)
        }
        air_k = temperature_c + KELVIN
        air = {"Ambient temperature [K]": air_k, "Initial temperature [K]": air_k}
        return {**concentrations, **air, "Contact resistance [Ohm]": contact_ohm}

    def step(self, state: Any, power_w: float, time_s: float, inputs: dict[str, float]) -> Any:
        """Draw a power for a time; None if the cell is cut off before its end."""
        solution = self.until_cut_off(state, power_w, time_s, inputs)
        if solution is None or solution.termination != "final time":
            return None
        return solution.last_state

    def until_cut_off(
        self, state: Any, power_w: float, most_s: float, inputs: dict[str, float]
    ) -> Any:
        """Draw a power until the cell is cut off, at most for a time; None if it cannot give that
        power at all."""
        import pybamm

        try:
            return self.solver.step(
                state,
                self.model,
                most_s,
                inputs={**inputs, "Power function [W]": power_w},
                save=False,
            )
        except pybamm.SolverError as error:
            if "non-positive at initial conditions" in str(error):  # below the cut-off as it begins
                return None
            raise


@dataclass(frozen=True)
class PybammPack:
    """A pack of equal cells.

    Attributes:
        cells: In series.
        parallel: Strings, of any number above 0, so that the pack has the energy of its label.
        learned_ah: Charge that it gives at 25 C before it is cut off.
        true_ah: Charge between 0 and 100 % at rest.
        cutoff_v: Of the pack.
        outside_c: Temperature of the air, and of the cells.
        label_j: Energy on the label.
        inputs: Of the cell's model, at the start.
        start_share: Share of charge at the start.
        endless: A battery without an end, with which the same way is driven to know what power it
            takes.
    """

    chemistry: str
    cells: int
    parallel: float
    learned_ah: float
    true_ah: float
    cutoff_v: float
    outside_c: float
    label_j: float
    inputs: dict[str, float]
    start_share: float
    endless: Any

    @property
    def cell(self) -> Cell:
        """Its cell."""
        return cell_of(self.chemistry, self.cutoff_v / self.cells)

    def drive_out(self, ground: Ground, update_s: float, truth: TruthSizes) -> WayOut:
        """Drive out until the battery is cut off or the way ends."""
        without_end = drive_out(
            self.endless,
            full_state(self.endless, 1.0),
            ground,
            update_s,
            replace(truth, trip_s=np.inf),
        )
        records = without_end.records.copy()
        records[:, TEMPERATURE_C] = self.outside_c
        states: list[Any] = []
        state = None
        step_start = (0.0, 0.0, self.start_share)  # time, energy and share at the last step's end
        for first, last in _stretches(records[:, TIME_S]):
            end_s = records[last, TIME_S]
            end_j = records[last, ENERGY_J]
            next_state = self._step(
                state, (end_j - step_start[1]) / (end_s - step_start[0]), end_s - step_start[0]
            )
            if next_state is None:
                break
            share = self._share(next_state)
            times_s = records[first : last + 1, TIME_S]
            shares = np.interp(times_s, [step_start[0], end_s], [step_start[2], share])
            begin_v = self._voltage_v(next_state) if state is None else self._voltage_v(state)
            records[first : last + 1, SHARE] = shares
            records[first : last + 1, VOLTAGE_V] = np.interp(
                times_s, [step_start[0], end_s], [begin_v, self._voltage_v(next_state)]
            )
            state = next_state
            step_start = (end_s, end_j, share)
            states.extend([state] * (last + 1 - first))
        driven = records[: len(states)]
        driven[:, CURRENT_A] = driven[:, POWER_W] / driven[:, VOLTAGE_V]
        return WayOut(driven, states)

    def drive_home(self, way: WayOut, turn: int, ground: Ground, truth: TruthSizes) -> WayHome:
        """Turn at the update with index `turn`, and drive home along the same way."""
        start_cell = int(way.records[turn, CELL])
        cross_s = (ground.length_m / ground.home_mps)[start_cell::-1]
        drawn_j = cross_s * ground.home_w[start_cell::-1]
        times_s = np.cumsum([truth.turning_s, *cross_s])
        joules = np.cumsum([truth.turning_s * ground.standby_w, *drawn_j])
        state = way.states[turn]
        end_s = 0.0
        end_j = 0.0
        for _first, last in _stretches(times_s):
            step_s = times_s[last] - end_s
            step_j = joules[last] - end_j
            state = self._step(state, step_j / step_s, step_s)
            end_s = times_s[last]
            end_j = joules[last]
            if state is None:
                return WayHome(False, float(end_j), 0.0)
        return WayHome(True, float(end_j), max(self._share(state), 0.0))

    def left_j(self, way: WayOut, index: int, power_w: float, truth: TruthSizes) -> float:
        """Energy that it still delivers at an update under a steady power, to its cut-off, J."""
        return _given_j(self, way.states[index], power_w)[0]

    def _step(self, state: Any, power_w: float, time_s: float) -> Any:
        return self.cell.step(state, power_w / self.cells / self.parallel, time_s, self.inputs)

    def _share(self, state: Any) -> float:
        """Share of charge in a state."""
        drawn_ah = float(state["Discharge capacity [A.h]"].entries[-1]) * self.parallel
        return self.start_share - drawn_ah / self.true_ah

    def _voltage_v(self, state: Any) -> float:
        """Voltage of the pack in a state."""
        return float(state["Terminal voltage [V]"].entries[-1]) * self.cells


def missing() -> str | None:
    """What to install, in a line; None if all is there."""
    if find_spec("pybamm") is None:
        return "--engine pybamm needs PyBaMM, which is not installed: pip install pybamm"
    return None


@cache
def cell_of(chemistry: str, cutoff_v: float) -> Cell:
    """The cell of a chemistry that is cut off at a voltage."""
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")  # it would ask on the terminal
    import pybamm

    values = pybamm.ParameterValues(PARAMETER_SETS[chemistry])
    parameters = pybamm.LithiumIonParameters()
    charges = {
        "Q_n": values.evaluate(parameters.n.Q_init), "Q_p": values.evaluate(parameters.p.Q_init),
        "Q_Li": values.evaluate(parameters.Q_Li_particles_init),
    }  # fmt: skip
    full_ah = float(pybamm.lithium_ion.ElectrodeSOHSolver(values, parameters).solve(charges)["Q"])
    by_drive = (
        "Power function [W]", "Ambient temperature [K]", "Initial temperature [K]", "Contact resistance [Ohm]",
        "Initial concentration in negative electrode [mol.m-3]",
        "Initial concentration in positive electrode [mol.m-3]",
    )  # fmt: skip
    open_values = values.copy()
    open_values.update(
        {**dict.fromkeys(by_drive, "[input]"), "Lower voltage cut-off [V]": cutoff_v},
        check_already_exists=False,
    )
    particles = pybamm.lithium_ion.SPMe if chemistry == "nmc" else pybamm.lithium_ion.SPM
    model = particles({"operating mode": "power", "contact resistance": "true"})
    simulation = pybamm.Simulation(
        model, parameter_values=open_values, solver=pybamm.IDAKLUSolver(rtol=1e-4, atol=1e-6)
    )
    simulation.build()
    nominal_ah = float(values["Nominal cell capacity [A.h]"])
    return Cell(chemistry, values, simulation.built_model, simulation.solver, full_ah, nominal_ah)


@cache
def _stoichiometries(chemistry: str, share: float) -> tuple[float, float]:
    """Of the negative and the positive electrode, at a share of charge; computed once, as it takes
    half a second."""
    import pybamm

    values = pybamm.ParameterValues(PARAMETER_SETS[chemistry])
    begins = pybamm.lithium_ion.get_initial_stoichiometries(
        share, values, pybamm.LithiumIonParameters()
    )
    return float(begins[0]), float(begins[1])


def make_pack(
    chemistry: str, label: Label, sizes: Sizes, wear: Wear, start_share: float
) -> PybammPack:
    """A true pack, faded and with risen resistance; see `robots.worn_pack`."""
    sizes_of_cell = sizes.cells[chemistry]
    cell = cell_of(chemistry, sizes_of_cell.cutoff_v)
    circuit = worn_pack(chemistry, label, sizes, Wear(1.0, 1.0, LABEL_C))

    def pack(
        parallel: float, contact_ohm: float, temperature_c: float, share: float, learned_ah: float
    ) -> PybammPack:
        return PybammPack(
            chemistry=chemistry,
            cells=label.cells,
            parallel=parallel,
            learned_ah=learned_ah,
            true_ah=parallel * cell.full_ah,
            cutoff_v=circuit.cutoff_v,
            outside_c=temperature_c,
            label_j=label.energy_j,
            inputs=cell.inputs(share, temperature_c, contact_ohm),
            start_share=share,
            endless=circuit._replace(true_ah=ENDLESS * circuit.true_ah),
        )

    # A new pack gives the energy of its label at 25 C within the label's hours.
    label_w = label.energy_j / (3600.0 * sizes.truth.label_hours)
    parallel = label.charge_ah / cell.nominal_ah
    # the rate of a cell changes with their number; chosen: it is then exact to 0.1 %
    for _again in range(3):
        new_j, _new_ah = _given_j(pack(parallel, 0.0, LABEL_C, 1.0, 0.0), None, label_w)
        parallel *= label.energy_j / new_j
    # at a current that empties a cell in an hour
    risen_v = (wear.resistance_factor - 1.0) * sizes_of_cell.ohm_sag_v
    parallel *= wear.capacity_share
    contact_ohm = risen_v / cell.nominal_ah
    _learned_j, learned_ah = _given_j(pack(parallel, contact_ohm, LABEL_C, 1.0, 0.0), None, label_w)
    return pack(parallel, contact_ohm, wear.outside_c, start_share, learned_ah)


def _given_j(pack: PybammPack, state: Any, power_w: float) -> tuple[float, float]:
    """Energy, J, and charge, Ah, that a pack delivers from a state under a steady power, to its
    cut-off."""
    most_s = 2.0 * pack.label_j / power_w
    solution = pack.cell.until_cut_off(
        state, power_w / pack.cells / pack.parallel, most_s, pack.inputs
    )
    if solution is None:
        return 0.0, 0.0
    before_ah = 0.0 if state is None else float(state["Discharge capacity [A.h]"].entries[-1])
    begin_s = 0.0 if state is None else float(state.t[-1])
    drawn_ah = float(solution["Discharge capacity [A.h]"].entries[-1]) - before_ah
    return power_w * (float(solution.t[-1]) - begin_s), drawn_ah * pack.parallel


def _stretches(times_s: Floats) -> Sequence[tuple[int, int]]:
    """First and last index of parts of a way that last at least `STEP_S` each; what is left over is
    a shorter one."""
    stretches = []
    start = 0
    begin_s = 0.0
    for index, time_s in enumerate(times_s):
        if time_s - begin_s >= STEP_S or index == len(times_s) - 1:
            stretches.append((start, index))
            start = index + 1
            begin_s = float(time_s)
    return stretches
