"""Records of the environments: one mission, one place of a route, and what all missions of an env
share."""

from __future__ import annotations

import numpy as np

from homeward.envs.conditions.gauges import GAUGE_DTYPE, GAUGES
from homeward.physics.battery import CURVE_DTYPE
from homeward.physics.kernel import STATE_FIELDS
from homeward.physics.robot import ROBOT_DTYPE

STOP, GO, RETURN = range(3)

AHEAD = ((1, 2), (2, 3), (3, 5), (5, 9), (9, 17), (17, 33), (33, 65))
"""Stretches of the way ahead whose mean grade and interest are observed: first and after-last place
from here. The farther, the coarser; together they hold the longest route. Chosen: each as long as
all before it."""
IN_SIGHT = 2
"""Stretches that are seen; beyond, there is a forecast, unless the route is known. Chosen: two
places."""

PLACE_DTYPE = np.dtype(
    [
        # The ground, as the route is drawn or read.
        ("sin_grade", np.float32),  # along the way out
        ("roughness", np.float32),
        ("curvature_per_m", np.float32),
        ("east", np.float32),  # direction of the way out, as a unit vector
        ("north", np.float32),
        ("interest", np.float32),
        # Readings of the robot and, from its first visit on, its own predictions.
        ("sine_read", np.float32),  # of the grade
        # that the battery must hold at the start of this place to get home; this and the rest by
        # the robot's own model
        ("home_cost_j", np.float32),
        ("home_j_per_m", np.float32),  # towards home, all power
        ("back_j_per_m", np.float32),  # towards home, drive only
        ("out_j_per_m", np.float32),  # away from home, drive only
        ("standing_w", np.float32),  # standing here, nothing sensed
        # see `homeward.envs.kernel`; this and the next two for the potential
        ("interest_to_here", np.float32),
        # as home_cost_j and home_j_per_m, by the true robot on the true ground
        ("true_home_cost_j", np.float32),
        ("true_home_j_per_m", np.float32),
        ("unused", np.float32, (3,)),  # to the end of the second line
        ("sine_ahead", np.float32, (len(AHEAD),)),  # means, as they are seen or forecast from here
        ("interest_ahead", np.float32, (len(AHEAD),)),
    ],
    align=True,
)
"""One place of a route. It fills two cache lines of the processor, because each takes time to
load."""

MISSION_DTYPE = np.dtype(
    [
        *(field for field in STATE_FIELDS if len(field) == 2),
        ("position_m", np.float64),  # along the route, home is 0
        ("direction", np.float64),  # of travel: 1 away from home, -1 towards it
        ("furthest_m", np.float64),
        ("dwell_s", np.float64),  # left of a pit stop
        ("legs", np.float64),  # between check posts, completed
        ("backlog", np.float64),  # samples on board
        ("backlog_information", np.float64),  # information in them
        ("delivered", np.float64),  # information sent home by radio
        ("lost", np.float64),  # information that did not fit on board
        ("modelled_j", np.float64),  # energy used by the robot's own model
        # Weather (`homeward.envs.conditions.weather`).
        ("temperature_c", np.float64),  # air, now
        ("warming_k", np.float64),  # in a decision
        ("wind_mps", np.float64),  # mean of the mission, and where it comes from
        ("wind_from_rad", np.float64),
        ("mean_east_mps", np.float64),  # the same as a vector, towards where it comes from
        ("mean_north_mps", np.float64),
        ("gust_east_mps", np.float64),  # present deviation of the wind from its mean
        ("gust_north_mps", np.float64),
        # its autocorrelation over a decision, and deviation of its change
        ("gust_keeps", np.float64),
        ("gust_kick", np.float64),
        ("forecast_east_mps", np.float64),  # of the wind at the start
        ("forecast_north_mps", np.float64),
        # Instruments (`homeward.envs.conditions.instruments`): errors and readings.
        ("meter_gain", np.float64),
        ("meter_offset_w", np.float64),
        ("soc_followed", np.float64),  # lagged state of charge, before noise and rounding
        ("soc_lowest", np.float64),  # reading so far, or `gauges.LOST`
        # metered energy with the same lag, as a share of a full battery
        ("metered_followed", np.float64),
        # sums over the readings, to estimate the metered energy of a full battery
        ("sum_used_metered", np.float64),
        ("sum_metered_squared", np.float64),
        ("soc", np.float64),  # read
        ("metered", np.float64),  # state of charge by the meter
        ("metered_j", np.float64),  # energy by the meter since the start
        ("supplied_j", np.float64),  # energy that chargers supplied, by their meters
        # the same as a share of a full battery, by the estimate of `metered`
        ("charged", np.float64),
        ("gauge", np.int64),  # which one the mission has
        # share of charge at which it is set anew; 0 if it is not, or was
        ("gauge_reset_left", np.float64),
        ("gauge_shift", np.float64),  # what it shows too much since
        ("read_w", np.float64),
        ("read_mps", np.float64),
        ("key", np.uint64),  # determines weather and noise (`homeward.envs.conditions.draws`)
        ("mean_grade", np.float64),  # sine of the route's mean slope, known beforehand
        ("sensing_hz", np.float64),  # in the decision before
        ("potential", np.float64),  # of the state, for the shaping
        ("score", np.float64),  # if the robot were home now
        ("cost", np.float64),  # 1 once stranded
        ("score_reward", np.float64),  # terms of the reward of the decision before
        ("shaping_reward", np.float64),
        ("place", np.int64),  # index of the place that the robot is in
        ("mapped", np.int64),  # places whose cost is known: those driven
        ("decisions", np.int64),
        ("asked", np.int64),  # decisions in a row that have chosen a return
        ("returning", np.bool_),  # the return is final
        ("home", np.bool_),
        ("over", np.bool_),
        ("here", PLACE_DTYPE),  # copy of the place that the robot is in
        # The arrays last: what every step touches stays together in the caches.
        *(field for field in STATE_FIELDS if len(field) > 2),
    ],
    align=True,
)
"""One mission: the kernel's state and what the environment adds."""

MAX_PLACES = 64
"""Most places of a route; a longer profile is cut into longer places. Chosen: twice those of a
generated route; a place takes 128 bytes in every mission."""

ROUTE_DTYPE = np.dtype([("places", PLACE_DTYPE, (MAX_PLACES,)), ("apart", PLACE_DTYPE)], align=True)
"""The route of one mission; the shared record says how many places it has. The last field keeps
routes from lying at multiples of a power of two, where they would evict each other from the
caches."""

MOST_DOCKS = 8
"""Most docks of a route. Chosen: their table stays in a few cache lines."""
DOCK_DTYPE = np.dtype([("position_m", np.float64), ("charger_w", np.float64)], align=True)
"""A dock: position along the route, and power of its charger."""

INVERSES = {
    "per_usable_j": "usable_j",
    "per_reach_m": "reach_m",
    "per_max_speed": "max_speed_mps",
    "per_max_sensing": "max_sensing_hz",
    "per_backlog": "backlog_limit",
    "per_link_m": "link_m",
    "per_score": "score_scale",
    "per_max_decisions": "max_decisions",
    "per_decision": "decision_s",
    "per_energy_per_m": "energy_per_m",
    "per_out_and_home_j_per_m": "out_and_home_j_per_m",
    "per_place_m": "place_m",
    "per_return_decisions": "return_decisions",
    "per_cruise_w": "cruise_w",
}
"""Fields of the shared record that hold the inverse of another: a step has no time for
divisions."""

SHARED_DTYPE = np.dtype(
    [
        ("mission", np.int64),  # its number (`homeward.envs.missions.CODES`), and its properties
        ("shuttles", np.bool_),
        ("senses", np.bool_),
        ("route_is_known", np.bool_),
        ("inexact", np.bool_),  # whether instruments have errors
        ("shaped", np.bool_),
        ("discrete", np.bool_),
        ("curved", np.bool_),  # whether the battery's voltage changes with its charge
        ("max_decisions", np.int64),
        ("return_decisions", np.int64),  # in a row that choose it make the return final
        ("places", np.int64),  # of a route
        ("decision_s", np.float64),
        ("min_speed_mps", np.float64),
        ("max_speed_mps", np.float64),
        ("max_sensing_hz", np.float64),
        ("place_m", np.float64),  # length of one place
        ("length_m", np.float64),  # of the route
        ("reach_m", np.float64),  # distance scale of the observation
        ("usable_j", np.float64),  # of a full battery, by the robot's file
        ("cruise_w", np.float64),  # power that drives this battery empty at cruise
        ("cruise_mps", np.float64),  # speed at which the way home is predicted
        ("energy_per_m", np.float64),  # of the robot's own model, from d_max
        ("out_and_home_j_per_m", np.float64),  # that out and, with nothing sensed, back home
        ("saturation_per_m", np.float64),  # samples per metre that give half of the information
        ("backlog_limit", np.float64),  # samples
        ("radio_hz", np.float64),  # samples the radio sends per second beside the base
        ("link_m", np.float64),  # distance at which it sends half of that
        ("pit_stop_s", np.float64),
        ("information_per_m", np.float64),  # expected, for the potential
        ("score_scale", np.float64),  # score of a good mission
        ("discount", np.float64),
        # drive energy per metre against drag at 1 m/s, by the robot's own model
        ("drag_j_per_m", np.float64),
        # Sizes of the instruments' errors, see `homeward.envs.conditions.instruments`.
        ("soc_noise", np.float64),
        # root mean square of what the gauges show beyond what a counter shows
        ("soc_error", np.float64),
        # lag of the state of charge, and share of a difference that is
        ("soc_lag_decisions", np.float64),
        ("soc_keeps", np.float64),  # left after a decision
        ("power_gain", np.float64),
        ("power_offset_w", np.float64),
        ("power_noise", np.float64),
        ("speed_noise", np.float64),
        ("grade_noise", np.float64),
        # prior: state of charge used over energy by the meter, as shares
        ("soc_per_metered", np.float64),
        ("soc_prior", np.float64),  # weight of that, as a sum of squares of metered shares
        *((name, np.float64) for name in INVERSES),
        ("curve", CURVE_DTYPE),  # of the robot's file
        ("resistance_ohm", np.float64),  # of the battery, by the same
        ("gauge_count", np.int64),  # gauges, of which each mission has one
        ("gauges", GAUGE_DTYPE, (len(GAUGES),)),
        ("dock_count", np.int64),  # docks, by increasing position
        ("docks", DOCK_DTYPE, (MOST_DOCKS,)),
    ],
    align=True,
)
"""Constants that all missions of an environment share, and that agents know."""

UNIFORM_DTYPE = np.dtype([("low", np.float64), ("span", np.float64)])
DRAWN_DTYPE = np.dtype(
    [(name, UNIFORM_DTYPE) for name in ("health", "rolling", "payload", "surface")]
)

HIDDEN_DTYPE = np.dtype(
    [
        # whether missions have true robots that are not the one of the file
        ("own_robots", np.bool_),
        ("forecast_errs", np.bool_),
        ("weather_changes", np.bool_),
        ("generated", np.bool_),  # whether every mission has a route of its own
        ("hidden_wind", np.bool_),
        ("full_j", np.float64),  # usable energy of the true robot's full battery, before its health
        ("drawn", DRAWN_DTYPE),
        ("temperature_c", np.float64),  # of a given route, and its wind
        ("wind_mps", np.float64),
        ("wind_from_rad", np.float64),
        # the robot around which the true ones are drawn, by default the nominal one
        ("truth", ROBOT_DTYPE),
        ("fixed", ROUTE_DTYPE),  # the route of every mission, unless routes are generated
    ],
    align=True,
)
"""Constants that are hidden from agents."""

CONSTANTS_DTYPE = np.dtype(
    [
        ("shared", SHARED_DTYPE),
        ("nominal", ROBOT_DTYPE),  # the robot of the file, which is the robot's own model
        ("hidden", HIDDEN_DTYPE),
    ],
    align=True,
)
"""All constants of an environment, in the form of the kernels."""
