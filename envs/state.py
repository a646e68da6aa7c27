"""Records of the environments: one mission, one place of a route, and what all missions of an env share."""

from __future__ import annotations

import numpy as np

from homeward.physics.kernel import STATE_FIELDS
from homeward.physics.robot import ROBOT_DTYPE

OUT_AND_BACK, SURVEY, PATROL = range(3)
STOP, GO, RETURN = range(3)

PLACE_DTYPE = np.dtype(
    [
        (name, np.float32)
        for name in (
            # The ground, as the route is drawn or read.
            "sin_grade",  # along the way out
            "roughness",
            "curvature_per_m",
            "east",  # direction of the way out, as a unit vector
            "north",
            "interest",
            "grade_near",  # mean ahead, within sight
            "interest_near",
            "grade_far",  # mean ahead, beyond it; 0 unless the route is known
            "interest_far",
            # What the mission knows once the robot has come here.
            "headwind_mps",  # along the way out, on this day
            "home_cost_j",  # from the start of this place home; this and the rest by the robot's own model
            "home_j_per_m",  # towards home, all power
            "back_j_per_m",  # towards home, drive only
            "out_j_per_m",  # away from home, drive only
            "standing_w",  # standing here, nothing sensed
        )
    ],
    align=True,
)
"""One place of a route: one line of the processor's cache, as a robot that comes to it has to wait for each."""

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
        ("modelled_j", np.float64),  # what the robot's own model says it has used
        ("gauge_bias", np.float64),  # share by which the fuel gauge misreads what was used
        ("temperature_c", np.float64),  # air, on this day
        ("wind_mps", np.float64),
        ("wind_from_rad", np.float64),
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
        ("returning", np.bool_),
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
"""Most places of a route; a longer profile is cut into longer places."""

ROUTE_DTYPE = np.dtype([("places", PLACE_DTYPE, (MAX_PLACES,)), ("apart", PLACE_DTYPE)], align=True)
"""The route of one mission; the shared record says how many places it has. The last field keeps routes from lying at
multiples of a power of two, where they would drive each other out of the caches."""

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
    "per_place_m": "place_m",
}
"""Fields of the shared record that hold the inverse of another: a step has no time for divisions."""

SHARED_DTYPE = np.dtype(
    [
        ("mission", np.int64),
        ("difficulty", np.int64),
        ("own_robots", np.bool_),  # whether missions have true robots that are not the one of the file
        ("hidden_wind", np.bool_),
        ("generated", np.bool_),
        ("shaped", np.bool_),
        ("discrete", np.bool_),
        ("max_decisions", np.int64),
        ("places", np.int64),  # of a route
        ("decision_s", np.float64),
        ("min_speed_mps", np.float64),
        ("max_speed_mps", np.float64),
        ("max_sensing_hz", np.float64),
        ("place_m", np.float64),  # length of one place
        ("length_m", np.float64),  # of the route
        ("reach_m", np.float64),  # distance scale of the observation
        ("usable_j", np.float64),  # of a full battery, as the robot believes
        ("full_j", np.float64),  # the same in truth, before the day's battery health
        ("cruise_mps", np.float64),  # speed at which the way home is costed
        ("energy_per_m", np.float64),  # of the robot's own model, from d_max
        ("saturation_per_m", np.float64),  # samples per metre that give half of the information
        ("backlog_limit", np.float64),  # samples
        ("radio_hz", np.float64),  # samples the radio sends per second beside the base
        ("link_m", np.float64),  # distance at which it sends half of that
        ("pit_stop_s", np.float64),
        ("information_per_m", np.float64),  # expected, for the potential
        ("score_scale", np.float64),  # score of a good mission
        ("discount", np.float64),
        ("drag_j_per_m", np.float64),  # drive energy per metre against drag at 1 m/s, by the robot's own model
        *((name, np.float64) for name in INVERSES),
    ],
    align=True,
)
"""What all missions of an environment share."""

CONSTANTS_DTYPE = np.dtype(
    [
        ("shared", SHARED_DTYPE),
        ("nominal", ROBOT_DTYPE),  # the robot as its file says, and as it takes itself to be
        ("fixed", ROUTE_DTYPE),  # the route of every mission, unless routes are generated
        ("day", np.float64, (3,)),  # of that route: temperature (C), wind (m/s) and its direction (rad)
        ("truth", ROBOT_DTYPE),  # the robot around which the true ones are drawn: as a rule the nominal one
    ],
    align=True,
)
"""What no mission changes."""
