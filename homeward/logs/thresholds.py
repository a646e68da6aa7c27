"""Thresholds of reading recordings that are choices, each defined once and with its origin.

The limits of each channel are in the schema (`homeward.logs.channels`). Bounds on time and memory,
the numbers of formats and the lengths of averaging windows decide nothing by themselves and stand
beside their code.
"""

from collections.abc import Mapping
from types import MappingProxyType

from homeward import thresholds as shared

# --- Values: what is left out ---------------------------------------------------------------------

STRAY_SHARE = 0.01
"""Largest share of impossible values that count as glitches. Chosen: with a wrong unit most are
impossible."""

STANDSTILL_MPS = 0.02
"""Speed, m/s, up to which a robot stands, where its top speed is not known. Chosen: above one step
of a wheel encoder (a standing Husky of BorealTC, ICE/pro_04, reads up to 0.012 m/s); the slowest
robot that ships does ten times as much."""

MOST_ZERO_HEIGHTS, NEAR_ZERO_M = 0.2, 30.0
"""Largest share of heights of 0 that mean unknown, and least size of all others, m. Chosen: heights
above the start begin at 0, and the next point is less than 30 m higher."""

FASTEST_CHANGES: Mapping[str, float] = MappingProxyType({
    "speed_mps": 12.0, "wheel_left_mps": 12.0, "wheel_right_mps": 12.0, "distance_m": 70.0, "elevation_m": 70.0,
})  # fmt: skip
"""Largest rate of change of a channel, SI per second. Speeds: the grip of rubber on dry asphalt,
1.2 g (Wong, Theory of Ground Vehicles, ch. 1: 0.8 to 0.9 in a steady slide, up to 1.2 at the peak);
the way and the height: the limit of a speed in the schema."""
SPIKE_SAMPLES, SPIKE_S = 5, 0.25
"""Samples of the running median from which a spike deviates, and least time that a change is given,
s. Chosen: up to two wrong readings in a row are found, and noise of 3 m/s is none."""
FASTER_THAN_TOP = 1.5
"""Speed over the top speed of a robot's file from which single readings are impossible. Chosen:
downhill, and with settings that were changed, robots are faster than their file says, by less."""

MOST_BROKEN_SHARE = 0.1
"""Largest share of broken lines, or of impossible values other than 0; with more the mapping is for
other files, or the unit is wrong. Chosen."""

MOST_NOT_ASCII_SHARE = 0.1
"""Largest share of bytes beyond ASCII in a line of names that is no UTF-8: more are binary data.
Chosen: names of columns are words with few accents and signs of units."""

# --- Times ----------------------------------------------------------------------------------------

EPOCH_S = 6.3e8, 4.1e9
"""Years 1990 to 2099 in seconds since 1970; the ranges in ms, us and ns lie apart from it and from
each other."""

LONGEST_STEP_S = 30.0
"""Median time between the samples of a recording, s; a longer one is in another unit. Chosen:
driving needs more."""

LONGEST_RUN_S = 3 * 86400.0
"""Longest duration of a run, s: three days; chosen: longer ones are times in another unit."""

TYPICAL_STEP_S = 0.1
"""Typical time between samples, s, of which the most likely unit is the closest: robots are logged
at about 10 Hz."""

HALF_A_DAY_S = 43200.0
"""A time of day that falls by more, s, went past midnight: half-way between no fall and a whole
day."""

FASTEST_SAMPLE_HZ = 1e6
"""Samples a second below which a mapping's rate must be, Hz. Chosen: no logger of motion or power
is as fast."""

INCREASING_SHARE, EARLIEST_S = 0.99, -1.0
"""Least share of steps that do not go back in a column that may be the time, and its least first
value, s. Chosen: a clock may occasionally be set back, and times count from a start, up to
rounding."""

SLOW_STEP_S, EPOCH_COUNT = 2.0, 1e11
"""Median step, s, up to which a column without a unit looks like seconds, and first value from
which it looks like a count since 1970 in ms to ns: between 1990 in ms (6.3e11) and 2099 in s
(4.1e9). Chosen: most robots are logged at 1 Hz and faster."""

TOGETHER_SHARE = 0.5
"""Least share of the values of the channel that has fewest, in rows in which all that is needed is
known; with fewer, each row is of one topic. Of joined tables, the share of all rows. Chosen:
missing values are the exception in a table of samples."""

# --- Units ----------------------------------------------------------------------------------------

UNIT_LOG_RATIO = 0.12
"""Largest difference between the logarithms of the ratio of two channels and of a wrong unit's
factor, for that unit to be the cause; chosen: instruments agree within 12 %."""

MOST_ODOMETER_RATIO, LEAST_ODOMETER_M = 1.2, 10.0
"""Ratio of two ways of one run above which an odometer has another unit or wheel size, and way from
which they are compared, m. Chosen: worn and soft tyres and slip on firm ground make less than 10 %
each (Wong, Theory of Ground Vehicles, ch. 1)."""

HEADING_JUMP = 180.0
"""A heading that changes by more from sample to sample, in its own unit, is in degrees that wrap:
in rad it would have turned 28 times."""

COLDEST_K = 150.0
"""A temperature that is always above this, in its own unit, is in K: as degC it is too hot, and as
K colder than any place on earth."""

HOTTEST_AIR_C = 56.7
"""Highest air temperature measured, degC: Furnace Creek, 10 July 1913 (World Meteorological
Organization)."""

SOC_RISE = 0.05
"""Rise of a state of charge, while energy is drawn, from which it may be the charge used. Chosen:
as far as the schema lets one be off; a gauge recovers by less when a load ends."""

COUNTS = 10
"""Changes of a current or power, all in one direction, from which it may be a counter: those of a
measured one have random signs, and ten agree once in 500 recordings (2 / 2^10)."""

FEWEST_CLIMBS = 20
"""Windows from which the energy of climbs shows the sign of slopes. Chosen: as the samples of a run
that is used."""
SHARE_OF_WEIGHT, CLEAR_CLIMB = 0.5, 4.0
"""Share of the robot's weight by which the power must fall with the climbing rate, and standard
errors of that, for slopes of the wrong sign. Chosen: half, and two errors if those of a few climbs
are half of the true ones."""

TYPICAL_SIZES: Mapping[str, float] = MappingProxyType({
    "heading_rad": 7.0, "grade_rad": shared.STEEPEST_RAD, "speed_mps": 30.0, "yaw_rate_radps": 10.0,
    "voltage_v": 1000.0, "wheel_left_mps": 30.0, "wheel_right_mps": 30.0, "current_a": 500.0, "power_w": 2e5,
})  # fmt: skip
"""Largest size of each channel, SI, that values without a unit may have for it: the typical range
of a ground robot. Chosen, within the limits of the schema."""

# --- Messages of bags and flight logs -------------------------------------------------------------

SAME_BATTERY = 0.05
"""Relative difference of mean currents up to which one battery is the sum of others, and of
voltages up to which packs are in parallel. Chosen: the error of current sensors of battery
monitors, 1 to 5 %; packs in parallel share a voltage but for the drop on their leads."""

SAME_READING = 0.01
"""The same of the quantiles of two currents that are one battery's, reported twice. Chosen:
readings are then equal but for rounding and losses of messages."""

GAP_STEPS = 5.0
"""Median steps between samples; a longer step is a gap; chosen: a few messages may be lost."""

FASTEST_CLOCK_S = 0.02
"""Shortest step of the common clock, s; chosen: a finer clock adds no information on energy, which
is averaged over 0.5 s."""

THINNED_STEPS = 2.0
"""Steps of a channel in a tick of its own clock from which that clock is thinned out, and the
channel is averaged: a clock has every sample, or every second one or fewer."""

CLOCKS_DIFFER_S = 5.0
"""Delay of a topic over that of the others, s, from which its stamps are of another clock; chosen:
transport delays a message by less, another clock is off by far more."""

CLOCK_BACK_S = 1.0
"""Time by which stamps of one topic go back, s, from which its clock was set or began again.
Chosen: messages overtake each other by less."""

LEVEL_M = 0.05
"""Height range, m; chosen: a height that varies by less is that of planar odometry, which does not
measure height."""

PLANAR = 1e-4
"""Sine of a slope below which a pose has none; chosen: 0.006 degrees, below any sensor's
resolution. Below it, in its own unit, other channels of a network count as zero too, which means
not measured."""

UNIT_LENGTH_ERROR = 0.05
"""How far from 1 the length of a quaternion may be; chosen: one of zeros is no rotation, a rounded
one is."""

ORIENTED_SHARE = 0.5
"""Least share of samples with an orientation for a grade from it. Chosen: a majority."""

LONGEST_LAG, UNCORRELATED, MOST_CORRELATED = 400, 0.05, 0.9
"""Lag in windows, and correlation, at which the sum of an autocorrelation time ends. Over 200
seconds correlation is drift, and 0.05 is the standard error of an estimate from 400 windows, 1 /
sqrt(n). Largest autocorrelation r of noise (chosen: above it is drift): an error of 0.05 in r
changes the correlation time, (1 + r) / (1 - r) = 19, by half."""
