"""Checks bags before work on them begins: whether each is a whole episode and contains what the work needs."""

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from hashlib import file_digest
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from siren_ros.data.interfaces.topics import ACTORS, GROUND_TRUTH, MAP
from siren_ros.data.record.episode_source import EpisodeSource, open_source
from siren_ros.data.record.licences import licence_of_map
from siren_ros.data.recording.bag_folder import METADATA_FILE
from siren_ros.data.recording.bag_reader import storage_files
from siren_ros.data.recording.recover import recover_bag
from siren_ros.errors import BagError, InputError, writing
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeRequest
from siren_ros.simulation.scenario.splits import EpisodeIdentity


class Need(StrEnum):
    """Something that a bag must contain."""

    TRACKS = "tracks"
    MAP = "map"
    EMV = "EMV"
    LIDAR = "lidar"
    FRONT_CAMERA = "front camera"
    CAMERA = "camera"


_NEEDS: Final[dict[Need, tuple[Callable[[EpisodeSource], bool], str, str]]] = {
    Need.TRACKS: (lambda source: source.has(ACTORS), "the actors' states", ""),
    Need.MAP: (lambda source: source.has(MAP), "the map", ""),
    Need.EMV: (lambda source: bool(source.description.emv_ids), "an emergency vehicle", ""),
    Need.LIDAR: (
        lambda source: source.lidar is not None and source.has(GROUND_TRUTH),
        "a LiDAR with its ground truth",
        "lidar",
    ),
    Need.FRONT_CAMERA: (lambda source: source.front_camera is not None, "a front camera", "front"),
    Need.CAMERA: (lambda source: bool(source.cameras), "a camera", "full"),
}
"""For each need: how to check a bag, its name in messages, and the smallest shipped suite that records it. Later suites
record everything that earlier ones do."""


def check_needs(source: EpisodeSource, format_name: str, needs: Sequence[Need]) -> None:
    """Check that a bag contains what a format needs.

    Raises BagError: what is missing, and the command that records this episode with it.
    """
    missing = [need for need in needs if not _NEEDS[need][0](source)]
    if missing:
        what = " and ".join(_NEEDS[need][1] for need in missing)
        suites = [suite for need, (_, _, suite) in _NEEDS.items() if suite and need in missing]
        command = recording_command(source.description, [source.description.sensor_suite, *suites][-1])
        raise BagError(str(source.path), f"an episode with {what}, for {format_name}; `{command}` records one")


_FURTHER: Final = ("site", "values", "look", "av", "av_sensors", "predictor", "detector")
"""Fields of a request that the command includes if they differ from their defaults."""


def recording_command(description: EpisodeDescription, sensors: str) -> str:
    """Command that records an episode again with a suite of sensors."""
    values = {
        "template": description.template,
        "level": description.level.name,
        "seed": str(description.seed),
        "duration_s": f"{description.duration_s:.1f}",
        "preset": description.preset,
        "sensors": sensors,
    }
    if (path := str(description.parameters.get("map", ""))) or description.map_name != "town":
        values["map"] = path or description.map_name
    defaults = {field.name: field.default for field in fields(EpisodeRequest)}
    further = {name: description.asked.get(name, defaults[name]) for name in _FURTHER}
    values |= {name: str(value) for name, value in further.items() if value != defaults[name]}
    arguments = " ".join(f"-p {name}:={shlex.quote(value)}" for name, value in values.items())
    return f"ros2 run siren_ros cosim --ros-args {arguments}"


@dataclass(frozen=True)
class BagSurvey:
    """What is known about a bag before its export; JSON types, so that processes can exchange it."""

    bag: str
    """Path of the bag, as given."""
    readable: str
    """Path that is read: the bag itself, or a recovered copy."""
    sha256: str
    """Hash of the bag's storage file, as given."""
    note: str
    """What is lost; empty if the bag is complete."""
    episode: dict[str, Any]
    """The card's entry for the episode."""

    @property
    def identity(self) -> EpisodeIdentity:
        """Values that decide the episode's split."""
        map_name, template, values = (str(self.episode[key]) for key in ("map", "template", "values"))
        return EpisodeIdentity(map_name, template, int(self.episode["seed"]), values)

    @property
    def name(self) -> str:
        """Name of the episode, such as ``S2_L2_seed0_town``."""
        return episode_name(*(self.episode[key] for key in ("template", "level", "seed", "map")))


def episode_name(template: str, level: str, seed: int, map_name: str) -> str:
    """Name of an episode in datasets; it has letters, digits, ``-`` and ``_``."""
    text = f"{template}_{level}_seed{seed}_{map_name}"
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in text)


def in_dataset_order(surveys: Sequence[BagSurvey]) -> list[tuple[BagSurvey, str]]:
    """Sort episodes into the order that every dataset of these bags has, and give each its id there.

    Raises InputError: two of them are the same bag.
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
    """Survey a bag; a bag that was cut off is first recovered into ``scratch``.

    Raises BagError: no episode, nothing that could be recovered, or not what the format needs.
    """
    sha256 = bag_sha256(bag)

    def survey(readable: Path, lost: str) -> BagSurvey:
        with open_source(readable) as source:
            check_needs(source, format_name, needs)
            if source.outcome is None:
                lost = lost or "the bag has no outcome: its writer was cut off"
            return BagSurvey(str(bag), str(readable), sha256, lost, _episode(source))

    if not (bag / METADATA_FILE).is_file():
        return survey(*recovered(bag, scratch))
    try:
        return survey(bag, "")
    except BagError as error:
        if not storage_files(bag) or "undamaged" not in str(error):
            raise
    return survey(*recovered(bag, scratch))


def _episode(source: EpisodeSource) -> dict[str, Any]:
    """The card's entry for an episode."""
    description, outcome = source.description, source.outcome
    return {
        "template": description.template,
        "level": description.level.name,
        "seed": description.seed,
        "values": description.draw,
        "map": description.map_name,
        "map_sha256": description.map_sha256,
        "map_licence": licence_of_map(description.map_name, str(description.asked.get("map", ""))),
        "planned_duration_s": description.duration_s,
        "sensor_suite": description.sensor_suite,
        "preset": description.preset,
        "versions": dict(description.versions),
        "ended": "cut off" if outcome is None else outcome.end.value,
        "recorded_with": recording_command(description, description.sensor_suite),
    }


def bag_sha256(bag: Path) -> str:
    """SHA-256 of a bag's storage file; BagError where there is none."""
    files = storage_files(bag)
    if len(files) != 1:
        raise BagError(str(bag), "a folder of a recorded episode, with one .mcap file")
    try:
        with files[0].open("rb") as file:
            return file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise BagError(str(bag), f"a bag that can be read ({error.strerror or error})") from error


def recovered(bag: Path, scratch: Path) -> tuple[Path, str]:
    """Recover the readable part of a damaged bag into a new bag; returns its path and what was lost.

    Raises BagError: nothing can be saved.
    """
    target = scratch / f"{bag_sha256(bag)}.recovered"
    with writing(scratch, "place"):
        scratch.mkdir(parents=True, exist_ok=True)
    if target.exists():
        return target, "the bag was cut off"
    recovery = recover_bag(bag, target)
    return recovery.path, f"the bag was cut off: {recovery.lost or 'its end is missing'}"
