"""What the record says about the conflicts that a camera on the EMV saw: everything that a label is derived from."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from siren_ros.evaluation.surrogate_safety import Encounters, conflict_series, post_encroachment
from siren_ros.numerics.arrays import Flags, Floats, Ids
from siren_ros.numerics.geometry import footprint_corners
from siren_ros.recording.episode_record import EpisodeRecord, StateRows, Steps
from siren_ros.sensors.specification import Mount
from siren_ros.world.traffic_state import EventKind


def in_view(encounters: Encounters, mount: Mount, horizontal_fov_rad: float, range_m: float) -> Flags:
    """Whether a part of each pair's other vehicle lies within the view of a camera on the subject, shape ``(N,)``.

    A vehicle is in view where a corner of its footprint lies within the horizontal field of view and within the range.
    What stands between is not considered: the pictures' instance masks tell who was really seen.

    Args:
        encounters: The subject that carries the camera, with the others.
        mount: Of the camera, in the subject's ``base_link``.
        horizontal_fov_rad: Full angle.
        range_m: From the camera.
    """
    subject, other = encounters.subject, encounters.other
    corners = footprint_corners(other.x_m, other.y_m, other.yaw_rad, *encounters.other_size_m.T)
    cos, sin = np.cos(subject.yaw_rad), np.sin(subject.yaw_rad)
    eye_x = subject.x_m + cos * mount.x_m - sin * mount.y_m
    eye_y = subject.y_m + sin * mount.x_m + cos * mount.y_m
    dx, dy = corners[..., 0] - eye_x[:, None], corners[..., 1] - eye_y[:, None]
    look = subject.yaw_rad + mount.yaw_rad
    ahead = dx * np.cos(look)[:, None] + dy * np.sin(look)[:, None]
    aside = dy * np.cos(look)[:, None] - dx * np.sin(look)[:, None]
    within = np.abs(np.arctan2(aside, ahead)) <= 0.5 * horizontal_fov_rad
    return np.asarray((within & (np.hypot(ahead, aside) <= range_m)).any(axis=1))


VIEW_RANGE_M: Final = 80.0
"""Beyond this a car is a few pixels wide in a picture of 800 pixels and 100 degrees."""
SEEN_BEFORE_STEPS: Final = 40
"""A conflict counts if the camera saw the other vehicle at any time of the two seconds up to it."""


@dataclass(frozen=True)
class Camera:
    """The camera that the video is made with, as far as the field of view needs it."""

    mount: Mount
    horizontal_fov_rad: float


@dataclass(frozen=True)
class Moments:
    """Pairs of the EMV and a seen civilian on a collision course; arrays of shape ``(N,)`` sorted by actor and step."""

    step: Steps
    actor_id: Ids
    time_to_collision_s: Floats
    closing_mps: Floats
    required_deceleration_mps2: Floats
    gap_m: Floats

    def __len__(self) -> int:
        return len(self.step)


@dataclass(frozen=True)
class SeenEncroachment:
    """The least PET of the EMV and a seen civilian."""

    actor_id: int
    step: int
    time_s: float


@dataclass(frozen=True)
class SeenContact:
    """A contact of the EMV with a seen civilian."""

    actor_id: int
    step: int
    impact_mps: float


@dataclass(frozen=True)
class Evidence:
    """All that labels need of a window of an episode; steps are the episode's."""

    moments: Moments
    encroachments: tuple[SeenEncroachment, ...]
    contacts: tuple[SeenContact, ...]

    def within(self, first_step: int, end_step: int) -> "Evidence":
        """What lies from a step to the one before another."""
        inside = (self.moments.step >= first_step) & (self.moments.step < end_step)
        return Evidence(
            Moments(*(getattr(self.moments, one.name)[inside] for one in fields(Moments))),
            tuple(one for one in self.encroachments if first_step <= one.step < end_step),
            tuple(one for one in self.contacts if first_step <= one.step < end_step),
        )


def evidence_of(record: EpisodeRecord, emv_id: int, camera: Camera, steps: tuple[int, int]) -> Evidence:
    """The conflicts between an EMV and the civilians in its camera's view, within a window of an episode.

    Args:
        record: The episode.
        emv_id: The vehicle with the camera.
        camera: Where it looks.
        steps: First step of the window and the one after its last.

    Raises:
        InputError: The EMV is no actor of the episode.
    """
    series = conflict_series(record, emv_id, steps)
    pairs, contacts = series.encounters, series.contacts
    visible = in_view(pairs, camera.mount, camera.horizontal_fov_rad, VIEW_RANGE_M)
    seen = _recently(visible, pairs.actor_id, pairs.step)
    moments = np.flatnonzero(seen & np.isfinite(contacts.time_s))
    seen_at = {(int(actor), int(step)) for actor, step in zip(pairs.actor_id[seen], pairs.step[seen], strict=True)}
    return Evidence(
        Moments(
            pairs.step[moments],
            pairs.actor_id[moments],
            contacts.time_s[moments],
            contacts.closing_mps[moments],
            contacts.required_deceleration_mps2[moments],
            contacts.gap_m[moments],
        ),
        tuple(_encroachments(record, emv_id, steps, seen_at)),
        tuple(_contacts(record, emv_id, steps, seen_at)),
    )


def _recently(visible: Flags, actor_id: Ids, step: Steps) -> Flags:
    """Whether the last SEEN_BEFORE_STEPS of each pair's actor had one at which it was visible."""
    last = np.full(len(step), -np.inf)
    last[visible] = step[visible]
    first = np.flatnonzero(np.append(True, actor_id[1:] != actor_id[:-1]))
    for begin, end in zip(first, np.append(first[1:], len(step)), strict=True):
        last[begin:end] = np.maximum.accumulate(last[begin:end])
    return np.asarray(step - last <= SEEN_BEFORE_STEPS)


def _encroachments(
    record: EpisodeRecord, emv_id: int, steps: tuple[int, int], seen_at: set[tuple[int, int]]
) -> Iterator[SeenEncroachment]:
    def way(actor_id: int) -> tuple[StateRows, tuple[float, float]]:
        track, actor = record.track(actor_id), record.actors[actor_id]
        return track.select((track.step >= steps[0]) & (track.step < steps[1])), (actor.length_m, actor.width_m)

    emv, size_m = way(emv_id)
    for actor_id in sorted({actor for actor, _ in seen_at}):
        track, other_size_m = way(actor_id)
        pet = post_encroachment(emv, track, size_m, other_size_m)
        if pet is not None and (actor_id, pet.step) in seen_at:
            yield SeenEncroachment(actor_id, pet.step, pet.time_s)


def _contacts(
    record: EpisodeRecord, emv_id: int, steps: tuple[int, int], seen_at: set[tuple[int, int]]
) -> Iterator[SeenContact]:
    for event in record.events_of(EventKind.COLLISION):
        pair = {event.actor_id, event.other_id}
        if emv_id not in pair or not steps[0] <= event.step < steps[1]:
            continue
        other = next(iter(pair - {emv_id}))
        # A contact stops both; the step itself may be the first at which they touch.
        if {(other, event.step), (other, event.step - 1)} & seen_at:
            yield SeenContact(other, event.step, float(event.detail["impact_speed_mps"]))
