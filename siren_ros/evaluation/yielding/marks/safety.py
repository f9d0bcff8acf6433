"""How close it was: least TTC and PET of a vehicle with everybody, and its collisions."""

from collections.abc import Sequence

from siren_ros.evaluation.surrogate_safety.conflict_measures import PairMeasures
from siren_ros.evaluation.surrogate_safety.time_to_collision import HORIZON_S
from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.events import EventKind


def min_ttc_s(conflicts: Sequence[PairMeasures]) -> Measure:
    """Least time to collision."""
    times = [pair.time_to_collision_s.value for pair in conflicts if pair.time_to_collision_s is not None]
    return Measure(min(times)) if times else Measure.lacking(f"no contact was ahead within {HORIZON_S:g} s")


def min_pet_s(conflicts: Sequence[PairMeasures]) -> Measure:
    """Least post-encroachment time."""
    times = [pair.encroachment.time_s for pair in conflicts if pair.encroachment is not None]
    return Measure(min(times)) if times else Measure.lacking("nobody crossed its way")


def min_gap_m(conflicts: Sequence[PairMeasures]) -> Measure:
    """Least gap between the bodies; negative where they overlap."""
    return Measure(min(pair.gap_m.value for pair in conflicts)) if conflicts else Measure.lacking("nobody was there")


def collisions(record: EpisodeRecord, actor_id: int | None = None) -> Measure:
    """Number of collisions: of an actor, or of everybody."""
    found = record.events_of(EventKind.COLLISION)
    return Measure(float(sum(actor_id is None or actor_id in (event.actor_id, event.other_id) for event in found)))
