"""Steps from the seat on the crossing of ``hand_made_record``.

The own vehicle drives north in the right lane, the EMV follows.
"""

from typing import Any

import numpy as np
from hand_made_record import NORTHBOUND, Driven, at_speed, crossing, hand_made, with_states

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.running.seat.sight import Sight, Way, sight_of
from siren_ros.simulation.world.actors import Lights

EMV, OWN = 1, 2
NETWORK = crossing()
WAY = Way.of(NETWORK, Polyline.through(NORTHBOUND))


def seen(
    own_m: float = 50.0,
    own_mps: float = 10.0,
    emv_m: float = 20.0,
    emv_mps: float = 10.0,
    aside_m: tuple[float, float] = (0.0, 0.0),
    others: dict[int, Driven] | None = None,
    signal: str = "",
    lights: int = 0,
) -> tuple[Sight, Sight]:
    """Two steps; ``aside_m`` is where the own vehicle is across its lane at each of them."""
    vehicles = {
        EMV: Driven(NORTHBOUND, at_speed(emv_m, emv_mps, 2)),
        OWN: Driven(NORTHBOUND, at_speed(own_m, own_mps, 2)),
        **(others or {}),
    }
    record = hand_made(NETWORK, vehicles, lambda _: signal)
    record = with_states(
        record,
        x_m=lambda state: state.x_m - np.where(state.actor_id == OWN, aside_m[state.step], 0.0),
        lights=lambda state: np.where(state.actor_id == EMV, int(Lights.SIREN), lights).astype(np.uint8),
    )
    signals = record.traffic[1].signals
    before, after = (sight_of(state, signals, record.actors, OWN, WAY, own_m) for state in record.states)
    return before, after


def sight_at(*args: Any, **known: Any) -> Sight:
    """The second of the two steps of ``seen``."""
    return seen(*args, **known)[1]
