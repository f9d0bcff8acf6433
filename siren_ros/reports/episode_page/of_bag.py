"""Builds the page of a recorded episode, with the reasons of its drivers' decisions if they are known."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import SirenError
from siren_ros.reports.episode_page.build import episode_page
from siren_ros.reports.episode_page.sensed import NOTHING, Sensed
from siren_ros.running.generation.decisions import Decision, decisions_of


def page_of_bag(
    bag: Path,
    against: Sequence[Path] = (),
    complain: Callable[[str], None] = lambda _: None,
    sensed: Sensed = NOTHING,
) -> str:
    """Page of a bag with sensor data, compared with others; ``complain`` gets a line if decisions are unknown.

    Raises:
        SirenError: A bag cannot be read, or as ``episode_page``.
    """
    others = [read_episode(other) for other in against]
    record = read_episode(bag)
    decisions: list[tuple[int, Mapping[int, Decision]]] | str
    try:
        decisions = list(decisions_of(record))
    except SirenError as error:
        complain(f"the page does not say why vehicles drive as they do: {error}")
        decisions = f"Not known: {error}."
    return episode_page(record, decisions, others, sensed)
