"""Thresholds of the diagnosis that are choices, each defined once and with its origin.

What follows from another is written so. Iterations, steps, grids of a search and bounds on time and
memory decide nothing by themselves and stand beside their code. A gain is the share of a squared
held-out error that a model explains. A schedule is an effect whose size is piecewise constant in
time or place, with estimated change points. Trees are boosted regression trees, without physics.
"""

from scipy.stats import norm

# --- Significance: how often a robot without a fault may be called faulty -------------------------

FALSE_ALARM_RATE = 0.01
"""Significance level of each family of tests, corrected for multiple testing within it: dependence
on channels and time, effects identified by a channel, schedules, and the voltage, state of charge
and odometer where recorded. Chosen so that all together stay near the 3 % that the project allows
on controls (benchmarks/concealed)."""

FEWEST_BLOCKS = 16
"""Least number of independent blocks: fewer have too few patterns of signs for a bootstrap test at
this level. Parts of the way that must agree on the sign of an odometer's error: by chance all do
with p = 2^-15. Stretches of a drive whose clock may drift: errors clustered by fewer are too
small."""

SIGNIFICANT = 0.05
"""Significance level of tests that stand alone, as of the reported 95 % intervals."""

NORMAL_95 = float(norm.ppf(1.0 - SIGNIFICANT / 2.0))
"""Standard errors of half a 95 % interval."""

CLEAR = float(round(NORMAL_95))
"""Standard errors beyond which two values differ. At two, one window in 20 of straight driving
counts as a turn, and few gentle turns are missed. Also used for the speed at rest, a capacity that
grows between two runs (with the errors of both), and the scale of a meter; a run is cut at a change
point where the squared studentised CUSUM exceeds its square."""

FAR_APART = 2.0 * CLEAR
"""Standard errors beyond which two values differ where the errors themselves are not well known:
those of a few ways may be half of the true ones (chosen), and errors clustered by a dozen stretches
are a quarter too small (Cameron, Gelbach & Miller, 2008, table 2). Two levels of a schedule are as
far apart in standard deviations of the residual: a window of one then lies beyond half-way to the
other with p = 0.02, the normal tail beyond two."""

FEWEST_RUNS = 3
"""Number of runs from which whole runs are held out. Of two runs, a fit would rest on one."""

SHORTEST_BLOCK, CORRELATION_TIMES = 10, 3.0
"""Least windows and correlation times of a block that counts as independent. Five seconds are
longer than starts and stops; where correlation falls exponentially, sums of blocks of n times
correlate by 1 / (4 n - 2), a tenth."""

FEWEST_BLOCKS_A_BIN, FEWEST_VALUES = 5, 8
"""Blocks of a bin of a channel's values that is tested: four or fewer have at most 16 patterns of
signs. Values of a bin, pieces in time or place of a schedule, heights of a slope: the mean of eight
is known to a third of the noise, 1 / sqrt(8)."""

# --- Effect size: what may be named ---------------------------------------------------------------

SMALLEST_GAIN = 0.05
"""Least share of the refit's held-out squared error that must be explained by a dependence on a
channel, a replay with an effect, a schedule beside other effects, or an effect in another channel
than power. A refit must lower the error of the robot file by as much. Chosen: a smaller share
lowers the held-out RMSE by less than 3 % (1 - sqrt(0.95))."""

SMALLEST_GAIN_TO_NAME = 0.1
"""Least share of the squared error that a named effect, or a further level of a schedule, must
explain: 5 % of the RMSE (1 - sqrt(0.9)), and a medium effect (r = 0.3, so 0.09: Cohen, Statistical
Power Analysis for the Behavioral Sciences, 1988, section 3.2). Less may come from a misspecified
form of another. Of the refit's error, it is a share of what exceeds noise of power, and of all of
it SMALLEST_GAIN. Of 24 parts of real recordings (benchmarks/real_drives.py, without four of the
BMW), 0.05 would also name regeneration, which the vehicles have, in three of the V9 and one of the
Leaf, and change no other name; of 15 (Husky, F1TENTH, Leaf), 0.2 would refuse regeneration in two
of the Leaf and viscous friction in one of the Husky, and add a clock lag in one."""

NO_WORSE = 1.0 / (1.0 - SMALLEST_GAIN_TO_NAME)
"""Ratio of errors (held out, or with a group held) up to which a model is no worse: the better one
would not be named beside it."""

RIVAL_SHARE = 1.0 - SMALLEST_GAIN
"""Share of the best hypothesis's gain from which another is not distinguishable from it; HALF for a
pair known to be confounded that no recorded channel separates."""

STRONG_BIC = 6.0
"""Least reduction of BIC by an effect: "strong" evidence (Kass & Raftery, 1995)."""

EXCITED = 1e-6
"""Share of the recorded rms by which a plausible change of a parameter must change the prediction:
above rounding."""

MOST_EFFECTS = 3
"""Most effects named in one diagnosis. Chosen: the residual holds too few windows to identify
more."""

MATERIAL_SHARE = 0.03
"""Least share of what was recorded. A parameter group must contribute it, at its fitted or assumed
value, to be fitted beside effects. A battery must lose it for the loss to be named. The residual
must reach it for its dependence on motion to count as unknown physics. The spread of a product,
ratio or sum over all models that fit as well (profile likelihood) stays below it where it is
identifiable. Chosen: six standard errors of a meter's scale (GAIN_ERROR)."""

# --- Model comparison: which explanation is preferred ---------------------------------------------

HALF = 0.5
"""A majority: of samples, of a window, of a way or its places, of the largest of several values.
What explains the greater part of something is its cause: named effects of the residual, motion or
the place of what a schedule explains, another effect that is known to be confounded of what the
first explains. Trees are clearly better than named effects if they leave less than half of their
squared error on unseen runs; where they are not, effects must explain half of what trees do (on ice
and snow, turning, the true effect, explains 0.56 to 0.63 of it). Twice the range or half of it are
equally useless, so that no trip counts as off by more. Of independent values a straight line
between two has as large an error as a step: both have twice the variance of linear prediction where
values correlate by a half."""

SIMPLER = 0.7
"""Ratio of two gains from which a simpler model is preferred though it explains less. Effects that
channels show are simpler than trees on the motion, and than a schedule whose cause these or the
place recorded: they need not be all that is missing. Chosen on synthetic drives."""

TWICE = 2.0
"""A factor of two, from which two quantities differ in kind: recorded and predicted energy
(parameters that are each known within some ten per cent do not make it up: is it the right robot?),
long and short steps between samples (a clock that jitters by half a step has nine in ten below
twice one in ten), the squared residual and what noise leaves of it, what time and a channel
explain. A drive is advised that halves the variance of what is least known."""

HALF_AGAIN = 1.5
"""A factor of one and a half, half-way to two: lengths of a window between windows above which one
is missing, the robot's top speed above which the robot or the unit is another one (and up to which
a speed read as km/h fits), and what all other samples reach, beyond which a sample may be a spike,
as a robot may draw a peak."""

NEARLY_ALL = 0.8
"""Nearly all, or nearly the same: the least reliability of a channel for a parameter that rests on
it alone, as for measurement in general (Nunnally, Psychometric Theory, 1978, p. 245: 0.8 for
research); the correlation from which two series count as the same, and two estimates as one; the
ratio of two gains from which one model explains as much as another; the probability that the air is
warmer in a window without a heater's power than in one with it (Mann-Whitney); the held-out R^2
below which a channel that was not recorded may be the reason."""

FEWEST_SWITCHES = 6
"""Fewest change points within runs of an intermittent load (on and off three times, so that there
are two periods); FEWEST_RUNS in which it switches on are enough. In some run it changes twice: what
changes once in each begins there."""

RARE_CHANGES = FEWEST_SWITCHES - 2
"""Most change points of an effect that rarely changes: one pair less than of an intermittent load,
so on and off twice with one period between, as a shower or a load that is taken up and put down. In
all recordings together of ground of places that are revisited, and in one run of an effect that
changes at atypical moments."""

SHORTEST_LEVEL = 4
"""Least windows of a level, two seconds: its mean is then known to half of the noise, 1 /
sqrt(4)."""

MOST_LEVELS = 4
"""Most levels of a schedule: half of the fewest pieces in time or place to search for one
(FEWEST_VALUES). Chosen."""

COST_OF_A_CHANGE = 3
"""Parameters that an estimated change point counts for in BIC (Zhang & Siegmund, 2007)."""

SAME_SCHEDULE = 0.02
"""Share of the windows of its rarest level in which two schedules may differ and count as the same.
Half or twice changes no test of schedules (tests/diagnosis/explain: change_points, proof,
explanation)."""

STOPS_MPS = 0.05
"""Mean speed of a window, up to which the robot stops in it: above STANDSTILL_MPS of
`homeward.logs.thresholds`, as a short stop leaves no window without motion."""

REVISITED = 1.8
"""Distance driven over extent of the way, from which place and time are not confounded. Chosen:
there and back."""

SMALLEST_GAIN_OF_THE_FLEXIBLE = 0.15
"""The same of what also fits what it does not cause: a dependence on time alone, as levels between
change points fit autocorrelated noise, and a fault of an instrument, as a lag or a scale absorbs
part of any effect of the load. Chosen below what the Husky's late clock explains."""

# --- Places: where something acts, in words -------------------------------------------------------

AT_WORK = 0.1
"""Share of its 0.99 quantile above which an effect is at work; a condition describes it if more
than half of the windows where one or the other holds are those of both. Chosen: it decides words
and places, and no verdict."""

# --- Parameters: what recordings determine --------------------------------------------------------

GAIN_ERROR = 0.005
"""Standard error of the scale of a power meter, added to every parameter estimated from power: 1 %
at two standard errors, a shunt of 0.5 % with its amplifier (INA226 data sheet; how to add it: JCGM
100:2008, 4.3)."""

MOST_TIMES = 5.0
"""Bound on fitted drag and mass over the robot file's, and of the mass on the inverse ratio: areas
and masses are known within a few times. Chosen."""

COLLINEAR = 1e-4
"""Share of a column's sum of squares orthogonal to the others, below which it is confounded with
them: its standard error is a hundred times that of a column by itself."""

GAUGE_GAIN_SD = 0.025
"""Relative standard error of the charge that a counter counts: its current sensor 1.5 % (Allegro
ACS712 data sheet), and 2 % of the full charge that it has learned (makers of gauges that learn it,
such as Impedance Track, state 1 to 2 %). Chosen: their sum of squares."""

CURVE_SD = 0.02
"""Relative standard error of the voltage by an open-circuit curve: cells of one chemistry are
within 75 mV of 3.7 V (`CHEMISTRIES` of `homeward.physics.battery`)."""

CAPACITY_SD = 0.063
"""Relative standard error of a battery's capacity by its file, against which the charge is weighed:
between 80 and 100 % of it (as the prior of `homeward.estimation`: 5.8 %), and GAUGE_GAIN_SD."""

GAUGE_STEP = 0.01
"""Least step of a state of charge to which its readings count as known: whole per cents, as drivers
and smart batteries show them (sensor_msgs/BatteryState; SBS 1.1, RelativeStateOfCharge)."""

LEAST_FALL = 2.0 * GAUGE_STEP
"""Fall of charge over all runs below which the capacity is not identifiable."""

# --- Runs: what can be used -----------------------------------------------------------------------

SHORTEST_RUN_S, FEWEST_SAMPLES = 5.0, 20
"""Least duration and samples of a run that is used: ten averaging windows of two samples. Chosen.
Fewest samples, or changes, from which the noise of a channel is estimated (within 16 %, 1 / sqrt(2
n)) and a fault of its logging seen."""

HARDLY_CHANGES = 0.1
"""Relative spread of a speed (range over the largest) or load (standard deviation over the mean) up
to which it hardly changes: half or twice changes no test of tests/diagnosis/explain on residuals,
proofs and explanations."""

UNIT_RATIO = 3.0
"""A ratio of recorded to expected power within this factor of 1000 is a wrong unit: half-way to
ten."""

GAP = 10.0
"""Median steps between samples above which there is a gap: single samples may be lost."""

STANDSTILL_SHARE = 0.02
"""Share of the robot's top speed up to which it stands. Chosen: for a robot of 1 m/s as
STANDSTILL_MPS in `homeward.logs.thresholds`, above one step of a wheel encoder; faster robots have
coarser ones."""

# --- Instruments: noise, lags and faults estimated from a recording's own channels ----------------

NEGLIGIBLE_NOISE = 0.001
"""Share of a channel's variance over windows that may be noise before the channel is smoothed.
Errors in variables attenuate a coefficient by this share (Fuller, Measurement Error Models, 1987,
section 1.1), less than any interval."""

RESET_M = 1.0
"""A distance counter that falls by more was reset; by less, the robot reversed within a sample.
Chosen."""

SAME_ODOMETER = 0.03
"""Odometers that differ by less are taken to agree: tyres wear and are inflated by as much
(calibrated odometry is good to 1 to 5 %: Borenstein & Feng, 1996)."""

UNCLEAR = 0.05
"""Share of noise in the variance of slopes, up to which slopes met again are recognised: a
reliability of 0.95."""

SHARP, AS_FAR, REVERSED = 0.9, 0.1, 0.35
"""Conditions for a turn of the way. Either the distance from base falls on both sides of it by the
first share of the way driven: at a corner of 52 degrees (twice the angle whose cosine it is), more
acute than those of a triangle with equal sides. Or distances before and after it, and slopes before
and (reversed) after it, differ by no more than the second and third share of their variance. Errors
that grow to a share e of the way make 2 e^2 of the variance of distances: 0.1 allows four times
those of odometry (CLOSED). On the slopes of a real ride (tests/diagnosis/read/test_way.py; ways of
0.5 to 5 km, noise as UNCLEAR allows, odometry off by 1 %) 0.35 misses 5 to 12 % of turns and takes
13 to 27 % of loops for one, 0.2 misses 18 to 27 % and takes 4 to 15 %, 0.5 misses 0 to 7 % and
takes 18 to 37 %."""

STEEPEST = 1.0
"""Largest slope, rise over run: no ground robot climbs it."""

COLD_C = 10.0
"""Mean temperature below which cold may explain a lower battery capacity: cells are rated at 25
degC, and their resistance about doubles towards 0 (Waag, Kaebitz & Sauer, 2013)."""

SMOOTHING_ERROR = 2.0
"""Factor on the standard deviation from a smoothed channel's posterior: the bias of smoothing adds
as much again (1.4 times in slopes with 0.7 degrees of noise, at most)."""

PLATEAUS = 0.1
"""Share of samples with a change, below which a channel that changes by whole steps is read at its
changes: with noise above a third of a step it would change in more (normal noise rounded to
steps)."""

SPIKE = 10.0
"""A single sample this many robust standard deviations off both its neighbours is a spike: Hampel's
identifier takes 3 (Davies & Gather, 1993); ripple of motor current has heavy tails."""

MOST_SPIKES = 0.005
"""Largest share of samples that are spikes: more are part of the robot's load. Chosen."""

MOST_SILENT = 0.05
"""Largest share of samples while driving in which a meter reads zero: with more it does so at any
low load. Chosen."""

CHARGES_S = 5.0
"""Power that flows back at standstill for longer comes from a charger: a capacitor lasts less.
Chosen."""

ZERO_ERROR = 0.05
"""Share of the mean driving power that a current sensor may read below zero at no load (1 to 3 % of
full scale is typical: Allegro ACS712 data sheet), so that less is no charging."""

HELD, JITTER = 0.95, 0.34
"""Least share of a channel's changes that come at even distances if the channel is held, and the
share of a period by which they may be off, one sample in three. With noise, repeats are chance.
Chosen."""

SHORTEST_LAG_S = 1.0
"""Shortest lag of a channel that is corrected: the lag of power, its reference, trades off with
inertia by some tenths."""

INDEPENDENT_S = 10.0
"""Length of a stretch whose error counts as independent in a drift: longer than a change of speed.
Chosen."""

CLOSED = 0.05
"""A drive is closed where it ends within this share of its length of where it began: odometry is
that good (Borenstein & Feng, 1996)."""

SAMPLES_A_WINDOW = 2
"""Samples that a window of a slow log holds at least: acceleration is a central difference over two
steps. Over windows of one sample a true inertia comes out 8 % too large at 1 Hz, over two 2 %, over
three -2 % (six drives)."""
