"""A look at a bag before anything is exported: who it is, whether it is whole, whether it has what is needed."""

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import file_digest
from itertools import pairwise
from pathlib import Path
from typing import Any

from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.needs import Need, check_needs, recording_command
from siren_ros.errors import BagError, InputError, writing
from siren_ros.recording.bag_guard import storage_files
from siren_ros.recording.bag_metadata import METADATA_FILE
from siren_ros.recording.recover import recover_bag


@dataclass(frozen=True)
class BagSurvey:
    """What is known of a bag before its export; JSON types, so that processes can exchange it."""

    bag: str
    """Path as it was given."""
    readable: str
    """Path that is read: the bag's own, or that of what could be recovered of it."""
    sha256: str
    """Of the bag's storage file as it was given."""
    note: str
    """What is lost; empty where the bag is whole."""
    episode: dict[str, Any]
    """What the card says of the episode."""

    @property
    def group(self) -> tuple[str, int]:
        """Map and seed: episodes that share both stay in one split."""
        return str(self.episode["map_sha256"]), int(self.episode["seed"])

    @property
    def name(self) -> str:
        """``S2_L2_seed0_town``."""
        return episode_name(*(self.episode[key] for key in ("template", "level", "seed", "map")))


def episode_name(template: str, level: str, seed: int, map_name: str) -> str:
    """What datasets call an episode; letters, digits, ``-`` and ``_``."""
    text = f"{template}_{level}_seed{seed}_{map_name}"
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in text)


def in_dataset_order(surveys: Sequence[BagSurvey]) -> list[tuple[BagSurvey, str]]:
    """Episodes in the order of every dataset of these bags, each with its id there.

    Raises:
        InputError: Two of them are the same bag.
    """
    ordered = sorted(surveys, key=lambda survey: (survey.name, survey.sha256))
    for before, after in pairwise(ordered):
        if before.sha256 == after.sha256:
            raise InputError("bag", after.bag, f"bags that differ; {before.bag} is the same one")
    names = [survey.name for survey in ordered]
    return [
        (survey, survey.name if names.count(survey.name) == 1 else f"{survey.name}-{survey.sha256[:8]}")
        for survey in ordered
    ]


def survey_bag(bag: Path, format_name: str, needs: Sequence[Need], scratch: Path) -> BagSurvey:
    """Looks at a bag; one that was cut off is recovered into ``scratch`` first.

    Raises:
        BagError: No episode, nothing that could be recovered, or not what the format needs.
    """
    sha256 = _sha256(bag)
    readable, lost = bag, ""
    try:
        if not (bag / METADATA_FILE).is_file():
            readable, lost = recovered(bag, scratch)
        return _look(bag, readable, sha256, lost, format_name, needs)
    except BagError as error:
        if lost or not storage_files(bag) or "undamaged" not in str(error):
            raise
    readable, lost = recovered(bag, scratch)
    return _look(bag, readable, sha256, lost, format_name, needs)


def _look(bag: Path, readable: Path, sha256: str, lost: str, format_name: str, needs: Sequence[Need]) -> BagSurvey:
    with open_source(readable) as source:
        check_needs(source, format_name, needs)
        description, outcome = source.description, source.outcome
    if outcome is None and not lost:
        lost = "the bag has no outcome: its writer was cut off"
    episode = {
        "template": description.template,
        "level": description.level.name,
        "seed": description.seed,
        "map": description.map_name,
        "map_sha256": description.map_sha256,
        "planned_duration_s": description.duration_s,
        "sensor_suite": description.sensor_suite,
        "preset": description.preset,
        "versions": dict(description.versions),
        "ended": "cut off" if outcome is None else outcome.end.value,
        "recorded_with": recording_command(description, description.sensor_suite),
    }
    return BagSurvey(str(bag), str(readable), sha256, lost, episode)


def _sha256(bag: Path) -> str:
    files = storage_files(bag)
    if len(files) != 1:
        raise BagError(str(bag), "a folder of a recorded episode, with one .mcap file")
    try:
        with files[0].open("rb") as file:
            return file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise BagError(str(bag), f"a bag that can be read ({error.strerror or error})") from error


def recovered(bag: Path, scratch: Path) -> tuple[Path, str]:
    """What can be read of a damaged bag, as a bag of its own, and what was lost.

    Raises:
        BagError: Nothing can be saved.
    """
    target = scratch / f"{_sha256(bag)}.recovered"
    with writing(scratch, "place"):
        scratch.mkdir(parents=True, exist_ok=True)
    if target.exists():
        return target, "the bag was cut off"
    found = recover_bag(bag, target)
    return found.path, f"the bag was cut off: {found.lost or 'its end is missing'}"
