"""Sealed episodes: nobody without the salt can make them again, and their descriptions say nothing.

An episode follows from its request, so that its seed would be the key to every answer: who tries seeds until the first
seconds agree knows the rest. The salt of a sealed episode, a secret of at least 128 bits, takes part in every random
stream. Description, names and ids of actors tell nothing that a sensor does not see. The description has a
commitment: a hash by which everybody can check, once the salt is published, that the episode was made with it.

A seal hides nothing from programs that can read the salt, the bag, or the memory of the process that has them.
"""

import hashlib
import json
import secrets
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Final

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.errors import InputError, writing
from siren_ros.simulation.scenario.episode import MAX_SEED, EpisodeDescription, EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel

SALT_BYTES: Final = 16
"""Least length of a salt: 128 bits cannot be tried one after the other."""
_MOST_BYTES: Final = 64
"""Longest key of BLAKE2b."""
SEALED: Final = "sealed"
"""Key of ``EpisodeDescription.parameters`` with the commitment; also what a sealed description says in place of
names."""
_LARGEST_ID: Final = 2**16 - 1
"""Largest id of an actor in the points of a sweep."""
_OPENED: Final[dict[str, EpisodeDescription]] = {}
"""The whole description of the sealed episode that this process made last, by its commitment."""


def write_salt(path: Path) -> bytes:
    """Draw a salt from the system's entropy and write it to a file that its owner alone can read.

    Raises:
        InputError: The file exists, or cannot be written.
    """
    salt = secrets.token_bytes(SALT_BYTES)
    with writing(path, parameter="salt"):
        path.touch(mode=0o600, exist_ok=False)
        path.write_text(salt.hex() + "\n", encoding="ascii")
    return salt


def read_salt(path: Path) -> bytes:
    """Read a salt: hexadecimal digits of 16 to 64 bytes.

    Raises:
        InputError: The file has no salt; the message does not show what it has.
    """
    try:
        salt = bytes.fromhex(path.read_text(encoding="ascii"))
    except (OSError, ValueError):
        salt = b""
    if not SALT_BYTES <= len(salt) <= _MOST_BYTES:
        raise InputError("salt", str(path), f"a file with {SALT_BYTES} to {_MOST_BYTES} bytes as hexadecimal digits")
    return salt


def seed_of(request: EpisodeRequest) -> int:
    """The number from which all random streams of an episode follow: the seed, or 256 bits of salt and seed.

    It is larger than every seed exactly for a sealed episode.

    Raises:
        InputError: The salt cannot be used.
    """
    if not request.salt:
        return request.seed
    key = read_salt(Path(request.salt))
    digest = hashlib.blake2b(str(request.seed).encode(), key=key, digest_size=32, person=b"siren seed").digest()
    return MAX_SEED + 1 + int.from_bytes(digest, "big")


def actor_ids(seed: int, first: int) -> Iterator[int]:
    """Ids of the actors of an episode from ``first`` on, in the order of their entry; of a sealed one in no order."""
    if seed <= MAX_SEED:
        return count(first)
    drawn = random_stream(seed, "actor ids").permutation(_LARGEST_ID - first + 1) + first
    return chain(drawn.tolist(), count(_LARGEST_ID + 1))


def actor_name(seed: int, name: str) -> str:
    """The name of an actor as a sealed episode tells it: a hash, because that in SUMO says its part."""
    return hashlib.blake2b(name.encode(), key=str(seed).encode()[:_MOST_BYTES], digest_size=8).hexdigest()


def commitment(salt: bytes, content: object) -> str:
    """SHA-256 of a salt and of JSON types: it says nothing without the salt, and fits no other content with it."""
    return hashlib.sha256(salt + json.dumps(content, sort_keys=True).encode()).hexdigest()


def sealed(description: EpisodeDescription, request: EpisodeRequest) -> EpisodeDescription:
    """The whole description with its commitment, which this process notes; itself where the request has no salt."""
    if not request.salt:
        return description
    # Files by their names alone: the same episode has the same bytes wherever they lie.
    asked = {name: Path(value).name if isinstance(value, str) else value for name, value in request.to_json().items()}
    committed = commitment(read_salt(Path(request.salt)), {**asked, "map_sha256": description.map_sha256})
    whole = replace(description, parameters={**description.parameters, SEALED: {"commitment": committed}})
    _OPENED.clear()
    _OPENED[committed] = whole
    return whole


def told(description: EpisodeDescription) -> EpisodeDescription:
    """What a bag and the topic of an episode say: the description itself, or that of a sealed one, which says nothing.

    It keeps what everybody sees anyway: ids of the EMVs and the AV, the suites of sensors, the hash of the map.
    """
    if SEALED not in description.parameters:
        return description
    av = description.parameters.get("av")
    kept = {"av": {**av, "name": ""}} if isinstance(av, dict) else {}
    return replace(
        description,
        template=SEALED,
        map_name=SEALED,
        preset=SEALED,
        level=EmergencyLevel.L0,
        seed=0,
        duration_s=0.0,
        parameters={SEALED: description.parameters[SEALED], **kept},
        site={},
    )


def opened(description: EpisodeDescription) -> EpisodeDescription:
    """The whole description in the process that makes the episode, for its nodes; elsewhere the one that was told."""
    stored = description.parameters.get(SEALED)
    return _OPENED.get(str(stored["commitment"]), description) if isinstance(stored, dict) else description
