"""Thresholds of the physics that are choices, each defined once and with its origin.

The bounds of a robot's parameters are beside each parameter, in `homeward.physics.robot` and in the
file of each effect, and so are the limits of an effect's equation. Grids and steps decide nothing
by themselves and stand beside their code.
"""

from collections.abc import Mapping
from types import MappingProxyType

# --- Robots: what looks like another unit ---------------------------------------------------------

PLAUSIBLE: Mapping[str, tuple[float, float, str]] = MappingProxyType({
    "mass_kg": (0.05, 10_000.0, "kg"),  # a line follower; an armoured vehicle without its crew
    # steel on steel; loose sand (Wong, Theory of Ground Vehicles, 2.9)
    "rolling_resistance": (0.002, 0.6, ""),
    # 0.5 * 1.2 kg/m^3 * 1.2 * 14 m^2, a truck across the wind
    "drag_ns2_per_m2": (0.0, 10.0, "N s^2/m^2"),
    # a capacitor of 0.3 Wh; 550 kWh, the largest pack of an electric truck
    "rated_energy_j": (1e3, 2e9, "J"),
    "nominal_voltage_v": (1.0, 1000.0, "V"),  # one cell; 800 V packs when full
    "max_speed_mps": (0.005, 45.0, "m/s"),  # a planetary rover's 0.04 with a margin; 160 km/h
    "max_sensing_hz": (0.0, 1e5, "Hz"),
    "track_m": (0.0, 5.0, "m"),
    "traction_n_per_a": (0.0, 5000.0, "N/A"),
})  # fmt: skip
"""Lowest and highest value of ground robots and road vehicles, and the unit."""

LEAST_J_PER_KG, MOST_J_PER_KG = 250.0, 3e6
"""Rated energy over mass, J/kg: below, a charge does not lift the robot by 25 m; above, it exceeds
that of a battery cell."""

MOST_ANCILLARY_W = 20_000.0
"""Largest ancillary power at rest, W, of all parts together; chosen: 300 times the highest of the
presets (60 W)."""

LEAST_HEALTH = 0.01
"""Least energy of an aged battery over the rated one; chosen: less means a wrong unit of the
fade."""

# --- Uncertainty and range ------------------------------------------------------------------------

MOST_ERROR, MOST_LAG_S = 0.5, 3600.0
"""Upper limits of an instrument's relative error and of the lag of a state of charge, s. Chosen:
with more, a reading contains no information."""

OMITTED = 0.04
"""What the model omits of the energy of a way, a share, for a file that does not state its
unexplained power: spread of the ratio between the second and the first half of drives, over the
root of two, for a model fitted to all of them. An electric unicycle 0.04, a Leaf 0.04 to 0.06, a
BMW i3 on the road 0.10 (data sets of `homeward.datasets`). Chosen: the lower end, as the way home
crosses the ground of the way out."""

BETWEEN_RUNS = 0.1
"""Relative standard deviation of the energy between runs for a file that does not state it. Chosen:
files from several runs of rovers, batteries, a car and a Husky state 0.001 to 0.9, and 0.07 in the
median (benchmarks/on_the_robot/range_coverage.py, seed 0)."""

GENERIC_ROLLING_SD, GENERIC_PAYLOAD_SD = 0.153, 0.116
"""Relative deviation of rolling resistance and of mass from a file that states no uncertainty: root
mean squares of the ranges of `uncertain` missions, 0.8 to 1.3 times the file's resistance and a
payload of up to a fifth of the mass."""

GENERIC_IDLE_SD = 0.18
"""Relative deviation of the power at rest from a file that states no uncertainty: an embedded
computer draws 8 to 15 W (the paper, component breakdown), uniformly. Six software variants of a
standing TurtleBot3 differ by 5 %, and one run from its first to its last third by 8 %
(docs/results.md, groups of runs)."""

LONGEST_MEMORY_S = 1e6
"""Time, s, after which a robot that has consumed nothing counts as never running empty: ten of the
slowest time constants that an effect can have."""
