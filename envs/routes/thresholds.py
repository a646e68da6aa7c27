"""Thresholds of routes and tracks that are choices, each defined once and with its origin.

The lengths over which a track is smoothed are beside their code (`homeward.envs.routes.tracks`);
the limits of a route's quantities are in the table of them (`homeward.envs.routes.route`).
"""

from homeward import thresholds as shared

# --- Routes ---------------------------------------------------------------------------------------

STEEPEST_SINE = 0.7
"""Sine of the steepest slope of a route: 44 degrees. Chosen: at 45, wheels slide with a friction
coefficient of 1."""

# --- Tracks: points that are used, and tracks that are refused ------------------------------------

SPACING_M = shared.POSITION_M
"""Least distance between points, m: nearer ones differ by the receiver's noise."""

LONGEST_M = 1e6
"""Longest way of a route or track, m. Chosen: more than any ground robot or road vehicle drives on
a charge, and it bounds the memory of a profile to some hundred MB."""

JUMP_M = 100_000.0
"""Largest distance between neighbouring points, m; chosen: farther than a ground robot drives on a
charge."""

SEGMENT_GAP_M = 100.0
"""Largest gap between segments of a track that are one way, m. Chosen: a receiver loses its
position for less than a minute in a short tunnel; a segment that begins farther away is another
drive."""

SHORTEST_M = 100.0
"""Shortest track, m: four standard deviations of the smoothing Gaussian, which would leave nothing
of a shorter one."""

MISSING_SHARE = 0.2
"""Share of the points that may lack an elevation; chosen: gaps can then be bridged linearly."""

MOST_ELEVATION_M = 20_000.0
"""Largest size of an elevation, m; larger ones are unknown. Chosen: the highest mountain has 8,849
m; heights in feet are found by their slopes."""

STEEPEST_OF_TRACK = 0.5
"""Sine of 30 degrees, to which slopes are limited; chosen: the steepest streets have 19 degrees
(Baldwin Street, Dunedin)."""

CAPPED_SHARE = 0.02
"""Largest share of limited slopes; chosen: with more limited slopes the heights are wrong."""

# --- Tracks: rises that are noise -----------------------------------------------------------------

LEAST_RISE_M = 2.0
"""Least rise, m; smaller ones are noise; chosen on two tracks of known ascent, see
docs/results.md."""

NOISE_DEVIATIONS = 3.0
"""Least rise in standard deviations of the noise that remains: of normal noise one in several
hundred exceeds it."""
