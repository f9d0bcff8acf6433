"""What a driver does to others: the same episode with it and with the paper's driver in its place, compared."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.reports.exam.examinee import lasting_deceleration_mps2
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest

PAPER: Final = "siren"
"""Name of the paper's driver: the model's own, in an episode without an AV."""
HARD_MPS2: Final = 4.0
"""Others who brake harder than this were forced to (ISO 15622 allows automatic systems 3.5 m/s² at speed, and 5 m/s²
below)."""
_LASTING_S: Final = 0.3
OTHERS: Final[Mapping[str, str]] = {
    "emv_delay_s": "later arrival of the first emergency vehicle, s",
    "braked_hard": f"others who braked harder than {HARD_MPS2:g} m/s²",
}
"""The figures by their names in a certificate, with their meaning."""


def actor_in_seat(record: EpisodeRecord) -> int:
    """The civilian that would be the AV under test in an episode without one.

    Raises:
        InputError: The episode has no civilians around its EMV, or its map cannot be found.
    """
    request = EpisodeRequest(**{**record.description.asked, "av": "civilian"})  # type: ignore[arg-type] # its own fields
    name = set_up_episode(request, record.description.files).plan.av
    found = [actor_id for actor_id, actor in record.actors.items() if actor.name == name]
    if not found:
        raise InputError("episode", record.description.template, f"one with the vehicle {name}")
    return found[0]


def compared_with_paper(record: EpisodeRecord, actor_id: int, paper: EpisodeRecord, paper_id: int) -> dict[str, float]:
    """The figures of ``OTHERS``: those of an episode less those of the same one with the paper's driver.

    Args:
        record: The episode with the driver.
        actor_id: The driver.
        paper: The same episode with the paper's driver.
        paper_id: Whom that one drives.
    """
    ways = [_way_m(one) for one in (record, paper)]
    common_m = min(way[-1] for way in ways)
    here_s, paper_s = (float(np.searchsorted(way, common_m)) * STEP_S for way in ways)
    braked = braked_hard(record, actor_id) - braked_hard(paper, paper_id)
    return {"emv_delay_s": here_s - paper_s, "braked_hard": float(braked)}


def _way_m(record: EpisodeRecord) -> Floats:
    """Distance that the first EMV has driven at each of its steps."""
    track = record.track(record.emv_ids[0])
    return np.cumsum(np.hypot(np.diff(track.x_m, prepend=track.x_m[:1]), np.diff(track.y_m, prepend=track.y_m[:1])))


def braked_hard(record: EpisodeRecord, actor_id: int) -> int:
    """Number of others, EMVs left out, who braked harder than ``HARD_MPS2`` for 0.3 s."""
    others = record.actors.keys() - {actor_id, *record.emv_ids, *record.walker_ids}
    lasting = (lasting_deceleration_mps2(record.track(other), _LASTING_S) for other in others)
    return sum(bool((one > HARD_MPS2).any()) for one in lasting)
