"""Thresholds of the companion that are choices, each defined once and with its origin.

Steps and places of the estimator, the points of the trail, weights in running means and bounds on
memory decide nothing by themselves and stand beside their code. Limits that other packages have too
are in `homeward.thresholds`.
"""

from homeward.estimation import thresholds as estimation_thresholds
from homeward.physics import thresholds as physics_thresholds

# --- Advice ---------------------------------------------------------------------------------------

RISK = 1e-3
"""Default of the accepted risk of not getting home. Chosen: one mission in a thousand. As rare is a
battery that holds more than the prior allows: from there on another explanation is said."""

DETOUR = 1.3
"""Way on the ground over the straight line, for a home that moved off the trail and for docks
beside it. Roads have 1.2 to 1.5 (Ballou and others, Transportation Research A 36, 2002)."""

DEAD_RECKONING_ERROR = 0.1
"""Relative standard deviation of a way from dead reckoning with speed and heading. Chosen: twice
the upper end of the 1 to 5 % of calibrated odometry (Borenstein & Feng, 1996)."""

TURN_S, TURN_SD_S = 8.0, 4.6
"""Time for which a robot that turns round stands, s, and its standard deviation. Half a turn at 0.4
rad/s, the slowest rate of Nav2's behaviors (`min_rotational_vel`), lasts 7.9 s. Chosen: between
none, as of one that drives home in reverse, and twice that, uniformly."""

OFF_ROUTE_M = 50.0
"""Distance from the route, m, above which it is reported. Chosen: ten times the error of a
position."""

SOC_MISMATCH, SOC_MISMATCH_WINDOWS = 0.1, 3
"""Fall of the state-of-charge reading below the energy drawn, and windows in a row with it, that
indicate another battery. Monitors that measure voltage are off by some per cent. Chosen: above
that, and more than a single window."""

LEAST_RISE = 0.01
"""Rise of the energy left since its lowest value, over a full battery, that is said. Chosen: the
step of displays."""

OWN_COURSE = 0.1
"""Prior probability that a state-of-charge reading has a course of its own. Chosen: the drivers
of Husarion, Clearpath, Ubiquity, ROBOTIS, ROSbot and OpenMower map the voltage, but no count of
robots is known."""

GAUGE_CHANGES = 1.0 / 200.0
"""Probability in a window that a reading jumps, stays or is right again: once a charge. Chosen."""

GAUGE_OUTLIERS = 0.01
"""Probability that a reading is anywhere between empty and full. Chosen: some of the readings of a
charge."""

GAUGE_WANDERS, GAUGE_LEARNS = 0.02, 0.1
"""Deviation, before it is known, from reading to reading of a gauge that does not follow the
charge; weight of a new change in it. Chosen: a sag of a tenth of the range of a voltage while
driving, and some ten windows count."""

COUNTER_SD, COUNTER_GAIN_SD = 0.01, 0.02
"""Standard deviation of a counter of charge at the start, and of its gain: it shows whole per
cents, a current sensor is off by 1.5 % (data sheet of the ACS712), and a learned capacity by 1 to 2
% (Impedance Track)."""

GAUGE_LAG_S = 100.0
"""Standard deviation of the time by which a gauge may be late, s. Drivers publish every 1 to 5
minutes on purpose (Husqvarna's, hrp PR 17); chosen: a third of the longest."""

GAUGE_DOUBT = 3.0
"""Standard deviations of a reading up to which it corrects the errors of a gauge that follows.
Chosen."""

COARSEST, COARSEST_SD = 0.125, 0.03
"""Half the coarsest step of a gauge, by which the charge may differ from a reading that stays, and
how sharp that limit is. Four lamps have steps of a quarter; chosen: the errors of a counter over
three deviations."""

OWN_START_SD = 0.15
"""Standard deviation of the first reading of a gauge with a course of its own. Published maps of
the voltage are off by up to 30 %; chosen: two deviations."""

TOLD_SD, STARTS_FULL = 0.02, 0.8
"""Standard deviation of the charge at the start that somebody tells; probability that a battery is
charged at the start. Chosen: chargers end, and cells lose, some per cent; robots are charged before
they leave."""

EMPTY_SD = 0.005
"""Standard deviation, over a full battery, of the energy at which a battery is empty. Chosen: an
update."""

# --- Voltage --------------------------------------------------------------------------------------

RESISTANCE, RESISTANCE_SD = 0.04, 0.016
"""Either half of the resistance of a warm battery before it is known, the one that acts at once and
the slow one, as the share of its voltage that it sags at a rate of one charge an hour; standard
deviation. Cells of 0.14 to 0.21 Ohm Ah sag by 4 to 6 % when new, and twice that at the end of life
(ansh-bohrey.github.io): together 4 to 12 %, uniformly."""

POLARISES_S = 300.0
"""Time constant with which the slow half of the voltage follows the current, s. Diffusion in cells
takes minutes: it is the slow pair of equivalent circuits. Chosen: five; no published value stands
behind the number."""

CURVE_ERROR_LASTS = 0.2
"""Charge over which the error of an open-circuit curve becomes another one. Chosen: the published
curves of cells of one chemistry cross their mean some times."""

VOLTAGE_GAIN_SD, VOLTAGE_NOISE, SAG_ERROR = 0.005, 0.002, 0.15
"""Relative errors of the voltage: of the sensor's gain, of the mean of a window, and as a share of
the sag. Chosen: a divider of resistors of 1 % that was trimmed; polarisation has more time
constants than one, and saturates."""

VOLTAGE_OUTLIERS, VOLTAGE_RANGE = 0.01, 0.5
"""Probability that a voltage is anywhere within a range, relative. Chosen as GAUGE_OUTLIERS."""

STANDS_WINDOWS, DRIVES = 3, 0.5
"""Windows in a row with a speed of 0 and driving power before a warning, and the share of the power
of driving at cruise on level ground, beyond standing, from which power is driving power. Chosen:
1.5 % of the time of a charge, and half-way."""

# --- Arguments: what is allowed -------------------------------------------------------------------

RISKS = 1e-6, 0.5
"""Lowest and highest accepted risk of not getting home. Chosen: far below what can be tested, and
an even chance."""

MOST_CUTOFF = 1.2
"""Ratio of cut-off to nominal voltage that no battery exceeds. Chosen: a cell's charged voltage is
at most 1.17 times the nominal one (4.2 V over 3.6 V)."""

LEAST_VOLTAGE_V = 0.1
"""Lowest voltage of a battery, V, as a cut-off or as read. Chosen: below any cell in use."""

SLOWEST_MPS = 1e-3
"""Lowest speed on the way home, m/s. Chosen: above 0, because energy is divided by it."""

WINDOWS_S, LONGEST_REACTION_S = (0.1, 3600.0), 3600.0
"""Shortest and longest time over which readings are averaged, and longest time to turn, s. Chosen:
a reading at 10 Hz, and an hour."""

SHORTEST_PLACE = 1e-3
"""Shortest place over d_max; the longest is d_max. Chosen: below the error of a way, and it bounds
their number."""

LARGEST_HOME_M = 1000.0
"""Longest way home, m, at which a robot may count as being at home. Chosen: beyond any base."""

# --- Readings: what is left out -------------------------------------------------------------------

RANGES = 10.0
"""Multiple of the distance driven on one charge above which a way home is impossible. Chosen:
batteries that are swapped on the way, a tail wind and a way downhill make it several; another unit,
or a broken receiver, a thousand."""

EARTH_M = 4.0075e7
"""Largest coordinate, m: the circumference of the earth at the equator (WGS 84). Beyond it is no
frame on it."""

LEAST_STEP_S = 1e-6
"""Time, s, below which a reading repeats the last one. Chosen: above the resolution of seconds
since 1970 in double precision, 0.24 microseconds."""

TOP_SPEEDS = 2.0
"""Multiple of the robot's top speed above which a speed is impossible. Chosen: wide enough for any
drive of the robot, narrow enough to detect a broken instrument or another unit."""

POWERS, STEEP_RAD = 20.0, 0.3
"""Multiple of the power at top speed up the steepest typical slope above which a power is
impossible; that slope, rad. Chosen as TOP_SPEEDS."""

SOC_SLACK = 0.02
"""Share of a battery by which a reading may be below 0 or above 1. Chosen: a monitor may be off by
that at its ends; one in per cent is far beyond."""

HELD_INTERVALS = 3.0
"""Multiple of an instrument's typical interval for which its last value holds. Chosen: two readings
may be lost."""

GAP_INTERVALS = 3.0
"""Multiple of the typical interval beyond which readings are missing. Chosen as HELD_INTERVALS."""

LEAST_HOLD_S = 0.5
"""Time, s, for which a value holds, and after which a missing instrument is reported, however often
it is read. Chosen."""

NEW_INTERVAL, LONGEST_INTERVAL = 0.2, 2.0
"""Weight of a new interval in the typical one, and multiple of that up to which it counts. Chosen:
some five intervals count, and one gap does not become typical at once."""

JUMPS = 5
"""Positions in a row that are too far away until they are accepted. Chosen: fewer may be a
receiver's errors."""

NOISY = 6.0
"""Distance between two positions, in standard deviations of their noise along an axis, that noise
alone may make. Chosen: four deviations of a difference."""

POSITION_LEARNS = 0.02
"""Weight of a position in the estimated noise of positions. Chosen: fifty count."""

POSITION_DOUBT = 1e-3
"""Probability with which white noise exceeds the distance from which a position is followed rather
than filtered. Chosen: once in a thousand positions, which is 3.7 standard deviations."""

STILL_M, DRIVEN_M = 0.2, 20.0
"""Distance by which positions must have moved when the speed integrates to this, m. Chosen: 1 %, a
tenth of the error of dead reckoning."""

LATE = 3
"""Readings in a row from before the last one until the clock is assumed to be set back. Chosen:
fewer may be late."""

CLOCK_SET = 4.0
"""Distance by the speed over that by positions, in a gap, from which the clock was set and no time
passed. Chosen: a way with bends is not four times as long as it is far."""

STAYS_S = 60.0
"""Time, s, for which a warning is shown, and for which motion may be missing at the start. Chosen:
long enough to be read."""

# --- Windows: what their readings are used for ----------------------------------------------------

COVERED = 0.5
"""Share of the time for which power must have been read; otherwise the model predicts it. Chosen: a
majority."""

UNREAD = 0.3
"""Relative standard deviation of the mean power in the time without a reading. Chosen: as it varies
with stops and bends."""

STRAIGHT = 0.15
"""Relative difference allowed between the change of the way home and the way driven, for a way
straight out or back. Chosen: cos(32 degrees), and above the errors of speed and position of a short
way."""

SLOPE_OFFSET = 3.5e-3
"""Standard deviation of the sine by which a slope sensor is mounted at a tilt: 0.2 degrees. Chosen:
makers of attitude sensors state 0.2 to 0.5 degrees for the pitch at rest."""

NO_SLOPE_SD = 0.04
"""Standard deviation of a slope's sine that is not read: that of generated routes."""

MODEL_C = 20.0
"""Temperature of the air, C, for which the robot's own model counts where none is read. Chosen: a
laboratory's."""

DRIVEN_SHARE = 0.01
"""Way of a window, in places, above which it has an energy per metre; chosen: a robot that stands
has none."""

# --- Prior: how much a robot's file is trusted ----------------------------------------------------

LEAST_MODEL_ERROR = estimation_thresholds.MODEL_ERRORS[0]
"""Error of the model, a share, for a file that states its unexplained power: as of the
environments' agents where nothing is hidden."""

OMITTED, BETWEEN_RUNS = physics_thresholds.OMITTED, physics_thresholds.BETWEEN_RUNS
"""What the model omits of the energy of a way, and the spread of the energy between runs, for a
file that states neither."""

IDLE_SD = physics_thresholds.GENERIC_IDLE_SD
"""Relative standard deviation of the power at rest for a file that states no uncertainty."""

MEASURED_CAPACITY_SD, LEAST_CAPACITY = 0.025, 0.3
"""Relative standard deviation of a capacity that somebody measured by a discharge: a current sensor
of 1.5 % (data sheet of the ACS712), and 2 % of the charge at which it began. Least capacity over
the file's that may be given. Chosen: batteries are replaced at 0.6 to 0.8."""

LEAST_CAPACITY_SD = 1e-3
"""Least relative standard deviation of the capacity, whatever a file says. Chosen: below any
measured one, and above 0, because the estimator divides by its variance."""

MOST_AIR = 0.04
"""Upper limit of a robot's air drag c, N s^2/m^2 over kg^(2/3): twice that of 0.03 m^2 kg^(-2/3) of
frontal area, the largest of Husky, Jackal, TurtleBot3 and the F1TENTH car by their sizes, at a drag
coefficient of 1.2."""
