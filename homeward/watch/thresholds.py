"""Thresholds of watching recordings and networks that are choices, each defined once and with its
origin.

Sizes of buffers, periods of drawing, saving and publishing, and the cutting of a recording into
windows decide nothing by themselves and stand beside their code.
"""

from homeward.companion import thresholds as companion_thresholds

# --- Recordings: predictions and their quality ----------------------------------------------------

CALIBRATED = 0.8, 0.97
"""Lowest and highest coverage of the 90 % interval that count as right. Chosen: moments of a run
are correlated, so that few are independent."""

BETWEEN_RUNS = 0.3
"""Relative standard deviation of the charge between runs for a file that does not state it. Chosen:
as of the Husky's runs on one ground, for which diagnoses of half of them state 0.12 to 0.9, and
0.28 in the median."""

LEAST_WAY_M = 1e-3
"""Least way left, m; chosen: at the end a millimetre counts as none."""

# --- Networks: charge, position and time ----------------------------------------------------------

CHARGED = 0.1
"""Rise of the state of charge from which the battery was charged or swapped: monitors that measure
voltage rise by some per cent when the robot stops. Chosen: above those."""

SOC_STEP = 0.015
"""Fall of the state of charge after which a charge is over: more than a step of most monitors,
which show whole per cents (Smart Battery Data Specification 1.1)."""

SAME_FRAME_M = 2.0
"""Poses this near, m, are in one frame, however soon they follow; chosen: below a position's
error."""

TOP_SPEEDS = companion_thresholds.TOP_SPEEDS
"""Multiple of the top speed that a robot may have had meanwhile; chosen: as for speeds that are
read."""

JUMP_S = 2.0
"""Allowed difference of a stamp from the time passed since the last one, s. Chosen: messages are
late by less."""

BEHIND_S = 1.0
"""Delay of the clock without messages, s, so that the next message is not late. Chosen: below
JUMP_S."""

FEWEST_SIGNS = 50
"""Readings while driving from which the sign of a current is determined. Chosen: noise has no
majority."""

DOUBTED_S = 60.0
"""Driving time after which units are doubted, s. Chosen: thirty means, of which a measured one
falls and rises."""

LEAST_OF_WINDOW = 0.5
"""Share of the averaging window of an accelerometer after which it gives a slope. Chosen: half, as
the speed is averaged over half of it in bags (`homeward.logs.bags.grade`)."""

# --- Networks: silence ----------------------------------------------------------------------------

SILENT_INTERVALS, SHORTEST_SILENCE_S = 5.0, 2.0
"""Multiple of the typical interval, and minimum time, s, after which a topic counts as silent.
Chosen: single messages may be lost."""

SHORTEST_INTERVAL_S = 0.1
"""Time, s, by which a new interval may exceed its limit in the typical one (LONGEST_INTERVAL in
`homeward.companion.thresholds`). Chosen: so that a typical interval of zero, of messages that came
at once, can grow."""

WITHOUT_MOTION_S = 2.0
"""Time without motion, s, after which the companion is updated without readings. Chosen: above the
gaps of a topic."""
