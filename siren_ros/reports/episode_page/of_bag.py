"""The page of a recorded episode, with why its actors drive as they do wherever that is known."""

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
    """The page of a bag, compared with others, with what its sensors measured; says where decisions are not known.

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
