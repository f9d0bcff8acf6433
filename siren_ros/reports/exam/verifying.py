"""Verifies a certificate: its episodes are graded again from their bags, and rulebook, marks and verdict compared.

Bags are found by the hashes on the certificate, so that neither folders nor names matter.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.data.episode_source import bag_sha256
from siren_ros.errors import InputError, SirenError, shown_text
from siren_ros.reports.exam.certificate import ABOUT, Certificate, Content, as_json
from siren_ros.reports.exam.grading import Rulebook, Sitting, load_rulebook
from siren_ros.reports.exam.sitting import MadeEpisode, sit_in_made_episode
from siren_ros.running.generation.closed_loop import AnswerTimes

_OF_PLACE: Final = frozenset({"siren", "bag", "paper", "rulebook", "episodes"})
"""What may differ: version, folders, and the name of a rulebook of the user's, whose hash counts."""


def differences(content: Content, bags: Sequence[Path], rulebook: str = "", jobs: int = 1) -> tuple[str, ...]:
    """What differs between a certificate and what its bags give; nothing if it is confirmed.

    Args:
        content: The certificate (``read_certificate``).
        bags: Bags among which those of the certificate are, with those of the paper's driver.
        rulebook: File of a rulebook of the user's; empty for the shipped one that the certificate names.
        jobs: Processes.

    Raises:
        InputError: The certificate's content is none, or there is no such rulebook.
    """
    try:
        return _differences(content, bags, rulebook, jobs)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError("certificate", repr(error), "the content of a certificate.json of siren exam") from error


_BAGS: Final = {"bag_sha256": "", "paper_sha256": " of the paper's driver"}


def _differences(content: Content, bags: Sequence[Path], rulebook: str, jobs: int) -> tuple[str, ...]:
    book = load_rulebook(rulebook or content["rulebook"])
    by_hash = {bag_sha256(bag): bag for bag in bags}
    said, episodes = [], content["episodes"]
    calls = []
    for one in episodes:
        lost = [key for key in _BAGS if one.get(key) and one[key] not in by_hash]
        said += [
            f"{shown_text(one['episode'])}: no bag{_BAGS[key]} has the hash {shown_text(one[key])}" for key in lost
        ]
        if not lost:
            calls.append((one, by_hash, book))
    if said:
        return tuple(said)
    with ProcessPool(max(min(jobs, len(calls)), 1)) as pool:
        graded = pool.map(_again, calls)
    if errors := tuple(str(one) for one in graded if isinstance(one, SirenError)):
        return errors
    sittings = tuple(one for one in graded if isinstance(one, Sitting))
    hashes = {str(bag): digest for digest, bag in by_hash.items()}
    about = {key: content[key] for key in ABOUT if key in content}
    again = json.loads(as_json(Certificate(content["driver"], book, sittings, about), hashes))
    if matrix := about.get("matrix"):
        cells = math.prod(len(matrix[axis]) for axis in ("templates", "levels", "seeds", "maps", "sites"))
        said += (
            [f"{cells} episodes in the matrix, {len(episodes)} on the certificate"] if cells != len(episodes) else []
        )
    for key in sorted((content.keys() | again.keys()) - _OF_PLACE):
        if content.get(key) != again.get(key):
            said.append(f"{key} differs")
    for one, other in zip(episodes, again["episodes"], strict=True):
        said += [f"{shown_text(other['episode'])}: {what}" for what in _of_episode(one, other)]
    return tuple(said)


def _again(one: Mapping[str, Any], by_hash: Mapping[str, Path], book: Rulebook) -> Sitting | SirenError:
    """The sitting of an episode of a certificate, graded again."""
    answers = AnswerTimes(**one["answers"]) if one.get("answers") else None
    if one["no_result"]:
        return Sitting(one["bag"], one["episode"], one["actor_id"], (), one["no_result"], answers=answers)
    paper = by_hash[one["paper_sha256"]] if one.get("paper_sha256") else None
    try:
        return sit_in_made_episode(MadeEpisode(by_hash[one["bag_sha256"]], paper, answers, one["actor_id"]), book)
    except SirenError as error:
        return error


def _of_episode(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    said = [
        f"{key} differs"
        for key in sorted(one.keys() | other.keys())
        if key not in {*_OF_PLACE, "marks"} and one.get(key) != other.get(key)
    ]
    marks = {mark["clause"]: mark for mark in one["marks"]}, {mark["clause"]: mark for mark in other["marks"]}
    for clause in sorted(marks[0].keys() | marks[1].keys()):
        first, second = (each.get(clause) for each in marks)
        if first != second:
            grades = [mark["grade"] if mark else "nothing" for mark in (first, second)]
            said.append(
                f"{shown_text(clause)}: {shown_text(str(grades[0]))} on the certificate, {grades[1]} from the bag"
            )
    return said
