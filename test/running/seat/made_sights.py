"""Steps from the seat, made by hand: a straight road of two lanes with a junction from 100 to 130 m."""

import math
from dataclasses import replace

import numpy as np

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.running.seat.sight import LanesBeside, Other, Sight, Siren, Way
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorDescription, ActorStates

LENGTH_M = 300.0
ROWS = int(LENGTH_M) + 1
LIMIT_MPS = 10.0
OWN = ActorDescription(0, "own", ActorClass.SEDAN, 4.5, 1.8, 1.5, (0, 0, 0))
EMV = ActorDescription(1, "emv0", ActorClass.AMBULANCE, 6.0, 2.2, 2.6, (255, 255, 255), is_emv=True)


def straight_way(**columns):
    """In the left one of two lanes of 3.5 m; the junction is from 100 to 130 m."""
    whole = np.ones(ROWS)
    inside = np.zeros(ROWS, np.bool_)
    inside[100:130] = True
    way = Way(
        curve=Polyline.through(np.array([[0.0, 0.0], [LENGTH_M, 0.0]])),
        lane=np.zeros(ROWS, np.int32),
        right_m=-5.25 * whole,
        driving_right_m=-5.25 * whole,
        lane_right_m=-1.75 * whole,
        lane_left_m=1.75 * whole,
        leftmost=np.ones(ROWS, np.bool_),
        in_junction=inside,
        limit_mps=LIMIT_MPS * whole,
        changes=0.0 * whole,
        duty=np.zeros(ROWS, np.bool_),
        lines=(),
        lanes=LanesBeside(3.5 * whole, 0.0 * whole, whole),
    )
    return replace(way, **columns)


def to_the_right():
    """Columns of a path that changes to the right lane from 60 to 80 m, by 17.5 cm in each row."""
    rows = np.arange(ROWS)
    moved_m = 0.175 * np.clip(rows - 60, 0, 20)
    return {
        "changes": np.where((rows >= 60) & (rows < 80), -1.0, 0.0),
        "lane_left_m": 1.75 + np.where(rows < 70, moved_m, moved_m - 3.5),  # from the middle on, of the right lane
    }


def sight(s_m=20.0, **known):
    """Alone at the speed limit in the middle of the lane."""
    plain = {
        "step": 100,
        "way": straight_way(),
        "s_m": s_m,
        "left_m": 0.0,
        "turn_rad": 0.0,
        "speed_mps": LIMIT_MPS,
        "length_m": 4.5,
        "width_m": 1.8,
        "sirens": (),
        "others": (),
        "red_m": math.inf,
        "in_junction": 100.0 <= s_m < 130.0,
        "states": ActorStates(100, **{name: np.zeros(1, dtype) for name, dtype in ACTOR_STATE_DTYPES.items()}),
        "bodies": {0: OWN, 1: EMV},
        "row": 0,
    }
    return Sight(**{**plain, **known})


def siren(gap_m, left_m=0.0, length_m=6.0, speed_mps=12.0):
    """An EMV behind (``gap_m`` above 0), beside or ahead, on the own road."""
    ahead_m = -gap_m - 4.5 - length_m
    return Siren(1, gap_m, left_m, speed_mps, ahead_m <= 0.0, ahead_m, along=True)


def car(gap_m, left_m=0.0, speed_mps=0.0):
    return Other(gap_m, left_m, 0.9, speed_mps, 4.5)
