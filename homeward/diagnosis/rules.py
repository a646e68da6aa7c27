"""Every threshold of the diagnosis that is a choice, once, with its origin."""


# --- Chance: how often a robot without a fault may be called faulty -----------------------------------------------

FALSE_ALARM_RATE = 0.01
"""Of each family of tests, each corrected for all that it tries: dependence on channels and time, causes that channels
tell, schedules, and the voltage, the gauge and the odometer where they were recorded. Chosen so that together they stay
about the 3 % that the project allows itself on controls (benchmarks/concealed)."""

PLACEBOS = 19
"""Of a formula: so that being better than all of them has p = 0.05."""

FEWEST_BLOCKS = 16
"""With fewer independent stretches no test at the stated rate is possible: most of the few patterns of signs are then
alike."""

# --- Size: what is worth a name -----------------------------------------------------------------------------------

SMALLEST_GAIN = 0.05
"""Share of the refit's held-out squared error that a dependence on a channel, a replay with an effect, or an effect in
another channel than power must explain, and that a refit must take off the robot file's. Chosen:
what is smaller takes less than 3 % off the held-out error (1 - sqrt(0.95))."""

SMALLEST_GAIN_TO_NAME = 0.1
"""The same of what is left, for an effect to be named: less is soon the form of another that does not quite fit.
Chosen on seeds 2 and 3 of benchmarks/concealed, where all single effects that are found explain more."""

SMALLEST_SHARE = 0.005
"""Of the rms of what was recorded, that an effect or a dependence must explain, and of its sum, that a schedule must
add or save: power meters err by as much (a shunt of 0.5 %; INA226 data sheet, 0.1 % beside it)."""

SMALLEST_GAIN_IN_TIME = 0.15
"""As SMALLEST_GAIN, of changes in time alone, for which a level per stretch also follows noise with a long memory.
Chosen on synthetic drives with a drift of the load."""

MUST_PAY = 6.0
"""Difference of BIC that an effect must bring: "strong" (Kass & Raftery, 1995)."""

VERY_STRONG = 10.0
"""Difference of BIC from which evidence counts as very strong (Kass & Raftery, 1995): what a formula, which names no
cause, must bring."""

MOST_EFFECTS = 3
"""Effects that are named at once. Chosen: each further one is looked for in what is left of fewer windows than it
needs."""

MATTERS = 0.03
"""Share of what was recorded that a group must move, by its fitted size or that of the robot file, to be fitted
beside effects; that is lost in a battery before its loss is named; and that a refit must leave before what motion tells
of it is unknown physics. Chosen."""

# --- Rivals: what stands for what ---------------------------------------------------------------------------------

AS_WELL = 0.8
"""Of what something else explains, from which it explains it as well: trees on the motion and its history against a
schedule, which then needs no unrecorded cause; and effects against such trees, which else are not what is missing.
Chosen on seeds 2 and 3 of benchmarks/concealed: wrong names explain 0.6 to 0.76 of what trees do, right ones 0.88 or
more. The history of a drive tells its time too, so that less proves nothing of a schedule."""

MOSTLY = 0.7
"""The same of what is simpler, and preferred though it explains less: a cause that a channel tells, or all effects
without a schedule, against a level per stretch, which follows whatever comes and goes (chosen on synthetic drives); and
the first effect alone against trees, as it need not be all that is missing (chosen as AS_WELL)."""

HALF = 0.5
"""More of it than not. Of what a refit leaves, that trees on the motion explain where it has not taken up what is
missing, and that named effects explain where their rest lasts and is no noise; of what trees within the runs explain,
where on other runs they do not do much better than the effects (on ice and snow, turning, which is right, explains 0.56
to 0.62 of it); and of a group's squared column, in common with one that it may stand for."""

TOLD_BY_PLACE = 0.25
"""Of what a schedule explains, that place and height explain on runs that were held out: then it is no matter of time.
Chosen on seed 305 of benchmarks/concealed, where they explain nothing of true schedules."""

SELDOM = 4
"""Changes in all recordings of what changes seldom, on and off twice: ground of places that are met again (showers),
and what changes at moments that are unusual for it. Chosen on seeds 305 and 306 of benchmarks/concealed: causes outside
the catalogue that took such names changed 6 to 43 times, showers at most 3."""

COMES_BACK = 6
"""Changes within runs of a load that comes and goes: on and off three times, so that there are two periods."""

IN_SO_MANY_RUNS = 3
"""Runs in which a load comes on, for it to be one that comes and goes: as three times in one run."""

CLEARLY_APART = 4.0
"""Standard deviations of what is left between two levels with a gap: noise with memory has none. Chosen."""

LEVEL_WORTH = 0.1
"""Of what the levels so far explain, that a further one must add. Chosen."""

CUSUM_CUTS = 4.0
"""Squared departure of a CUSUM, studentised, from which a run is cut in two: two standard errors."""

MET_AGAIN = 1.8
"""Times its extent that a way is driven, from which places are told from times. Chosen: most of it there and back."""

MUCH_BETTER = 0.6
"""Squared error of trees on unseen runs over that of what is named, from which they do much better: as AS_WELL."""

SMALLEST_GAIN_BESIDE = 0.01
"""Share of the refit's held-out squared error that a further effect must explain beside those that are named: what is
less is soon the form of the first that does not quite fit. Chosen on seed 2 of benchmarks/concealed."""

SMALLEST_GAIN_OF_A_FAULT = 0.15
"""Share of the squared error that a fault of an instrument must explain: beforehand it is less likely than physics, and
a lag or a scale takes up some of whatever depends on the load. Chosen below what the Husky's late clock explains."""

TIME_MUST_BEAT = 2.0
"""Times what any channel explains: only then is a mismatch a matter of time. Chosen on synthetic drives."""

EQUAL = 1.1
"""Times the held-out error: no worse. Chosen on synthetic drives."""

ALIKE_IN_SIZE = 0.97
"""A rival that explains this share of what the best hypothesis does may be meant as well. Chosen on synthetic
drives."""

ALIKE_BY_NATURE = 0.5
"""The same of one that is known to look alike, where no channel shows the difference. Chosen on synthetic drives."""

ALIKE_PRODUCT = 0.02
"""Relative spread, over all models that fit as well, of a product, ratio or sum that is called known: four standard
errors of a meter's scale. Chosen."""

ENTWINED = 0.9
"""Correlation of two estimates from which only what they make together counts as determined: the error of each is
then more than twice (1 / sqrt(1 - 0.9^2)) what it would be were the other known."""

# --- Places: where something acts, in words ------------------------------------------------------------------------

AT_WORK = 0.1
"""Of its usual peak (the 0.99 quantile), beyond which an effect is at work. Chosen."""

TELLING = 0.6
"""Overlap (F1) with when an effect is at work, beyond which a condition tells it. Chosen."""

EXCEPTION = 0.35
"""Of the windows, below which one side of a split is the exception and the other the rule. Chosen."""

# --- Parameters: what recordings determine ------------------------------------------------------------------------

GAIN_ERROR = 0.005
"""Standard error of the scale of a power meter, in every parameter that power tells: 1 % at two standard errors, a
shunt of 0.5 % with its amplifier (INA226 data sheet; how to add it: JCGM 100:2008, 4.3)."""

MOST_TIMES = 5.0
"""Of what a robot file says, that its drag and mass may be, or for the mass this part of it: areas and masses are known
within a few times. Chosen; mass had it from the first."""

COLLINEAR = 1e-4
"""A column of which less than this share of its squares is its own cannot be told apart from the others: its standard
error is a hundred times that of a column by itself."""

NOISE_ONLY = 0.2
"""A column whose own part has less than this autocorrelation varies by measurement noise only. Chosen on the
recordings of the Husky."""

LEAST_FALL = 0.02
"""Of the charge, over all runs: less says nothing of the capacity, as gauges show whole per cents."""

GAUGE_ERROR = 0.05
"""Of the capacity, that a gauge of charge is trusted with. Chosen."""

MEASURES = 0.1
"""Rise of the log-determinant of the information from which a drive is advised: a tenth is 5 % off one interval."""

SEPARATES = 0.6931471805599453
"""The same from which a drive tells effects apart: log 2, as the variance of what is least known is then halved."""

# --- Runs: what can be used ----------------------------------------------------------------------------------------

SHORTEST_RUN_S, FEWEST_SAMPLES = 5.0, 20
"""Of a run that is used: ten averaging windows of two samples. Chosen."""

MOST_MISSING = 0.5
"""Share of the samples without motion or power, beyond which they are logged in rows of their own. Chosen."""

TOO_FAST = 1.5
"""Times the robot's top speed: beyond it is another robot or another unit. Chosen; km/h are 3.6 times m/s."""

UNIT_RATIO = 3.0
"""A ratio of recorded to expected power within this factor of 1000 is a wrong unit: half-way to ten."""

# --- Instruments: what a recording's own channels say of their noise, lags and faults -----------------------------

NEGLIGIBLE_NOISE = 0.001
"""Share of a channel's variance over windows that may be noise before the channel is smoothed. Errors in variables
attenuate a coefficient by this share (Fuller, Measurement Error Models, 1987, section 1.1), less than any interval."""

RESET_M = 1.0
"""A counter of distance that falls by more was reset; by less, the robot backed up within a sample."""

SAME_ODOMETER = 0.03
"""Odometers that differ by less are taken to agree: tyres wear and are inflated by as much (calibrated odometry is good
to 1 to 5 %: Borenstein & Feng, 1996)."""

COLD_C = 10.0
"""Mean temperature below which the cold may be why a battery gives less: cells are rated at 25 degC, and their
resistance about doubles towards 0 (Waag, Kaebitz & Sauer, 2013)."""

SMOOTHING_ERROR = 2.0
"""Times the standard deviation that a smoothed channel's own likelihood says: what smoothing takes off the signal adds
as much again (1.4 times in slopes with 0.7 degrees of noise, at most)."""

STRAIGHT = 2.0
"""Standard deviations of its error over a window that a turning rate must be off zero to be a bend: two leave one
window in 20 of driving straight, and hide few gentle bends."""

ALIKE = 0.8
"""Correlation from which two series are taken for one: slopes out and, reversed, home; what is left of one window and
of the next, so that it is no noise of power (on seeds 305 and 306 of benchmarks/concealed unrecorded causes leave 0.9
and more, ordinary instruments 0.6 at most); by rank, the fading of a battery and another cause. As RELIABLE."""

RELIABLE = 0.8
"""Least reliability of a channel for a parameter that rests on it alone, as for measurement in general (Nunnally,
Psychometric Theory, 1978, p. 245: 0.8 for research)."""

SMOOTHED_AT_ONCE = 50_000
"""Samples from which the noise of a channel is estimated: its standard error is then below 1 % (1 / sqrt(2 n))."""

PLATEAUS = 0.1
"""A channel that changes in less than this share of its samples, always by whole steps, is told by the changes: were
its noise above a third of a step, it would change in more (normal noise rounded to steps)."""

SPIKE = 10.0
"""A single sample this many robust standard deviations off both its neighbours is a spike: Hampel's identifier takes 3
(Davies & Gather, 1993); ripple of motor current has heavy tails."""

SPIKE_BEYOND = 1.5
"""A spike also lies beyond what all other samples reach, by this factor: a peak that the robot can draw is not one."""

AT_THE_START_S = 0.5
"""An averaging window: a spike this close to a start of motion may be the start's, the break-away of friction or the
inrush of the motor."""

MOST_SPIKES = 0.005
"""Share of the samples: more of them are how the robot draws its power."""

MOST_SILENT = 0.05
"""Share of the samples: a battery that reads zero for longer while it drives is read by a meter that shows no more."""

CHARGES_S = 5.0
"""A robot that gives power back while it stands does so from its charger if it lasts: a capacitor lasts less."""

ZERO_ERROR = 0.05
"""Of the mean power of driving: what a current sensor may read below zero of nothing (1 to 3 % of full scale is usual:
Allegro ACS712 data sheet), so that less is no charging."""

HELD = 0.95
"""Share of a channel's changes that come after at least one repeated sample where the channel is held: with noise,
repeats are chance."""

HELD_SMOOTH = 0.5
"""Least lag-one autocorrelation of held values for interpolating between them: of independent values a straight line
has as large an error as a step (both have twice the variance of linear prediction at half a step for 0.5)."""

LONGEST_CHANNEL_LAG_S = 20.0
"""A channel that is later than this is not looked for: a filter of a barometer or GNSS receiver takes seconds."""

SHORTEST_CHANNEL_LAG_S = 1.0
"""Nor one less late than this: the lag of power, against which it is found, trades with inertia by some tenths."""

LONGEST_DRIFT_S = 4.0
"""Nor a clock that drifts by more over a run: 100 ppm, a poor crystal, are 0.4 s an hour; loggers lose more."""

SMALLEST_DRIFT_S = 0.1
"""A fifth of an averaging window: less moves hardly any power from one window to the next."""

LAG_MUST_EXPLAIN = 0.05
"""Share of the squared error of power that setting a lag right must take away: as much as a named effect must, so that
no lag is left that would be named."""

CLEAR_DRIFT = 5.0
"""Standard errors that a clock's drift must be from zero: clustered errors of a dozen stretches are a quarter too small
(Cameron, Gelbach & Miller, 2008, table 2), and there may be dozens of runs."""

CLOSED = 0.05
"""A drive is closed where it ends within this share of its length of where it began: odometry is that good
(Borenstein & Feng, 1996)."""

CLEAR_TILT = 4.0
"""Standard errors that the mean slope of closed drives must be from zero to be a tilted sensor."""

SAMPLES_A_WINDOW = 2
"""Samples that a window of a slow log holds at least: acceleration is a central difference over two steps. Over windows
of one sample a true inertia comes out 8 % too large at 1 Hz, over two 2 %, over three -2 % (six drives)."""

RIGHT_ROBOT = 2.0
"""A robot file whose energy is off by more than this factor is asked about: the presets' parameters, each estimated
within some ten per cent, do not add up to it."""

EXPLAINS = 0.9
"""Held-out R^2 below which a channel that was not recorded may be why: slopes of 2 % take as much as a seventh of the
rolling resistance of the presets, so that on hills a fit without slopes stays below."""

BEYOND_NOISE = 2.0
"""Times the squared error that the noise of power and of the other channels makes, from which something else is left.
Chosen on seed 305 of benchmarks/concealed: unrecorded causes leave 2.6 times as much and more, controls 0.1 to 1."""
