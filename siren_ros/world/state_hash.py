"""One number for the state of the world at a step: two episodes that have it in common at every step are the same."""

from collections.abc import Sequence
from hashlib import blake2b
from typing import Final

import numpy as np

from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorStates
from siren_ros.world.traffic_state import SignalState

HASH_BYTES: Final = 8


def hash_state(states: ActorStates, signals: Sequence[SignalState]) -> int:
    """64-bit BLAKE2b (RFC 7693) over every field of every actor and the state of every traffic light.

    The fields are taken to the last bit, in declaration order, little-endian on every platform; lengths go in as well,
    so that no two states share their bytes.

    Args:
        states: All actors at the step.
        signals: All traffic lights at the same step.
    """
    digest = blake2b(digest_size=HASH_BYTES)
    digest.update(np.array([states.step, len(states), len(signals)], dtype="<u8").tobytes())
    for name, kind in ACTOR_STATE_DTYPES.items():
        digest.update(np.asarray(getattr(states, name)).astype(np.dtype(kind).newbyteorder("<"), copy=False).tobytes())
    for signal in signals:
        digest.update(f"{signal.signal_id}\0{signal.state}\0".encode())
    return int.from_bytes(digest.digest(), "little")
