"""Finds moments of episodes that readers may want to see: failures, contacts, and the closest approaches."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, SirenError
from siren_ros.reports.episode_page.motion import check_motion
from siren_ros.reports.study_report.episode_pages import EpisodePages
from siren_ros.reports.study_report.page import Link, Section, quoted
from siren_ros.scoring.judging.predicates import evaluate_predicate
from siren_ros.scoring.judging.surrogate_safety import conflict_series, pair_measures
from siren_ros.scoring.pictures.birdseye import interaction_steps
from siren_ros.simulation.scenario.templates import own_level
from siren_ros.simulation.world.traffic_state import EventKind


class Kind(StrEnum):
    """Kind of a moment, in the order in which they are shown."""

    CONTACT = "contact"
    FAILURE = "failure"
    """A condition of the predicate does not hold at the template's own level."""
    CLOSE = "close"


MOST: Final = {Kind.CONTACT: 20, Kind.FAILURE: 20, Kind.CLOSE: 5}
"""Largest number of moments of each kind on a page."""


@dataclass(frozen=True)
class Notable:
    """A moment of an episode."""

    kind: Kind
    text: str
    step: int
    actor_id: int
    rank: float
    """Rank of the moment in its kind; the page shows those with the lowest."""


def notable_moments(record: EpisodeRecord) -> tuple[Notable, ...]:
    """Find at most one moment per kind: hardest contact, decisive moment of the first failed condition, smallest TTC.

    Nothing of a record that no page can show.
    """
    try:
        check_motion(record)
    except InputError:
        return ()
    return (*_contact(record), *_failure(record), *_closest(record))


def _contact(record: EpisodeRecord) -> Iterator[Notable]:
    contacts = record.events_of(EventKind.COLLISION)
    if contacts:
        speeds_mps = [float(event.detail.get("impact_speed_mps", 0.0)) for event in contacts]
        speed_mps = max(speeds_mps)
        event = contacts[speeds_mps.index(speed_mps)]
        text = f"contact with {event.other_id} at {speed_mps:.1f} m/s, the hardest of {len(contacts)}"
        yield Notable(Kind.CONTACT, text, event.step, event.actor_id, -speed_mps)


def _failure(record: EpisodeRecord) -> Iterator[Notable]:
    episode = record.description
    try:
        failing = evaluate_predicate(record).failing if own_level(episode.template) == episode.level.name else ()
    except SirenError:  # without a predicate there is no expectation to fail
        return
    for part in failing[:1]:
        moment = part.decisive
        step, actor_id = (moment.step, moment.actor_id) if moment else (interaction_steps(record)[0], record.emv_ids[0])
        yield Notable(Kind.FAILURE, str(part), step, actor_id, 0.0)


def _closest(record: EpisodeRecord) -> Iterator[Notable]:
    pairs = pair_measures(*conflict_series(record, record.emv_ids[0]))
    times = [(pair.time_to_collision_s, pair.actor_id) for pair in pairs if pair.time_to_collision_s is not None]
    if times:
        soonest, other_id = min(times, key=lambda pair: pair[0].value)
        text = f"least TTC of the EMV, {soonest.value:.2f} s to {other_id}"
        yield Notable(Kind.CLOSE, text, soonest.step, record.emv_ids[0], soonest.value)


def moments_section(found: Iterable[tuple[Path, Notable]], pages: EpisodePages) -> Section | None:
    """Section of moments with links to pages of episodes, or commands that show them; None without moments."""
    links, left_out = [], 0
    ordered = sorted(found, key=lambda item: (item[1].rank, item[0].name))
    for kind, most in MOST.items():
        of_kind = [item for item in ordered if item[1].kind is kind]
        left_out += 0 if kind is Kind.CLOSE else len(of_kind[most:])
        links += [_link(bag, notable, pages) for bag, notable in of_kind[:most]]
    if not links:
        return None
    text = (
        "The hardest contact of each episode, what decided that an interaction failed at its template's own level, "
        "and the episodes whose EMV came closest to a collision. A link opens the episode at this moment, in a file in "
        f"the folder {pages.folder.name} next to this one; the other moments have the command that shows them."
    )
    more = (f"{left_out} more are not named.",) if left_out else ()
    return Section("moments", "Moments to look into", (text, *more), links=tuple(links))


def _link(bag: Path, notable: Notable, pages: EpisodePages) -> Link:
    time_s = notable.step * STEP_S
    text = f"{bag.name}, {time_s:.2f} s, vehicle {notable.actor_id}: {notable.text}"
    command = f"./env siren view {quoted(bag)} --time-s {time_s:g} --actor {notable.actor_id}"
    return Link(text, pages.address(bag, time_s, notable.actor_id), command)
