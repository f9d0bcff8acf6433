"""Opened bags of episodes: their sensors with poses, their record and frames, and their survey before work begins.

A survey says whether a bag is a whole episode, whether it has what the work needs, and the licence of its map.
"""

import re
import shlex
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from enum import StrEnum
from functools import cached_property
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Brief, Matrix
from siren_ros.base.numerics.units import step_of_time_ns
from siren_ros.base.params.plain_files import sha256_of_file
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.boxes import from_camera_truth, from_ground_truth
from siren_ros.data.interfaces.conversions import (
    from_episode_description,
    from_episode_end,
    from_episode_outcome,
)
from siren_ros.data.interfaces.measurements import (
    from_camera_info,
    from_compressed_image,
    from_point_cloud,
    from_tf,
    matrix_between,
    matrix_of_transform,
)
from siren_ros.data.interfaces.topics import ACTORS, GROUND_TRUTH, MAP, TF, Topic
from siren_ros.data.recording.bag_folder import METADATA_FILE
from siren_ros.data.recording.bag_reader import BagMessage, OpenBag, damage_refused, open_bag, storage_files
from siren_ros.data.recording.episode_record import EpisodeRecord, outcome_of_what_is_held
from siren_ros.data.recording.recover import recover_bag
from siren_ros.data.sensor_messages.sensor_topics import EMV, Carrier
from siren_ros.errors import BagError, InputError, writing
from siren_ros.sensing.suite import EXPORTED_CAMERA
from siren_ros.simulation.roads.maps.map_compiler import BUILT_IN_MAPS, TOWN_NAME
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeIdentity, EpisodeOutcome, EpisodeRequest
from siren_ros.simulation.world.carrier import (
    BASE_FRAME,
    MAP_FRAME,
    STATION_FRAME,
    CameraIntrinsics,
    CameraTruth,
    GroundTruth,
)

LICENCE: Final = "Apache-2.0"
"""Licence of the code, the parameter files, the weights and the datasets, unless a dataset's maker states another. A
test compares ``LICENSE``, the packages' metadata and ``CITATION.cff`` with it."""
LICENCE_URL: Final = "https://www.apache.org/licenses/LICENSE-2.0"
UNKNOWN: Final = "that of its source, which SIREN does not know"

_BY_SOURCE: Final[tuple[tuple[Callable[[str, str], bool], str], ...]] = (
    (lambda name, file: name in {TOWN_NAME, *BUILT_IN_MAPS} and file in {"", name}, LICENCE),
    (lambda _, file: ".osm" in Path(file).suffixes, "ODbL-1.0, © OpenStreetMap contributors"),
    (lambda name, _: re.fullmatch(r"Town\d\d(HD)?(_Opt)?", name) is not None, "CC-BY, CARLA's assets"),
)


def licence_of_map(name: str, file: str) -> str:
    """The licence of a map, as far as its name shows.

    Args:
        name: The map's name in the episode.
        file: The file as the request names it; empty for the built-in town.
    """
    return next((licence for holds, licence in _BY_SOURCE if holds(name, file)), UNKNOWN)


FRONT_CAMERA: Final = EXPORTED_CAMERA


@dataclass(frozen=True)
class MountedSensor:
    """A LiDAR or camera of the EMV or of the AV under test."""

    name: str
    """Name of the sensor in its suite; for the AV's sensors it follows ``av/``."""
    topic: str
    base_from_sensor: Matrix
    """Transform from the sensor's frame (a camera's optical frame) to ``base_link``, shape ``(4, 4)``."""
    base_frame: str = field(default=BASE_FRAME, kw_only=True)
    """Name of the carrier's ``base_link`` on ``/tf``."""


@dataclass(frozen=True)
class MountedCamera(MountedSensor):
    """A camera with its projection."""

    model: CameraIntrinsics
    truth_topic: str
    """Topic of the camera's labels; empty if none were recorded."""

    def from_lidar(self, lidar: MountedSensor) -> Matrix:
        """Transform from a LiDAR's frame to the optical frame, shape ``(4, 4)``."""
        matrix: Matrix = np.linalg.inv(self.base_from_sensor) @ lidar.base_from_sensor
        return matrix


class EpisodeSource:
    """An open bag of one episode."""

    def __init__(self, bag: OpenBag) -> None:
        """Read the episode's description. Raises BagError if the bag has none."""
        self.bag = bag
        self.path = bag.path
        message = self._first(topics.EPISODE.name)
        if message is None:
            raise BagError(str(bag.path), f"a bag with an episode's description on {topics.EPISODE.name}")
        with damage_refused(bag.path):
            self.description: EpisodeDescription = from_episode_description(message)

    def _first(self, topic: str) -> Any | None:
        message = next(self.bag.messages({topic}), None)
        return None if message is None else message.read()

    @cached_property
    def outcome(self) -> EpisodeOutcome | None:
        """The recorded outcome; None if the bag was cut off before it."""
        message, end = self._first(topics.OUTCOME.name), self._first(topics.EPISODE_END.name)
        steps = [step_of_time_ns(states.time_ns) for states in self.bag.messages({topics.ACTORS.name})]
        with damage_refused(self.path):
            outcome = None if message is None else from_episode_outcome(message)
            return outcome_of_what_is_held(outcome, None if end is None else from_episode_end(end), steps)

    def has(self, topic: Topic) -> bool:
        """Whether messages of a topic were recorded."""
        return topic.name in self.bag.type_names

    @property
    def map_label(self) -> str:
        """Name of the map in datasets: its name with the start of its hash, which separates maps of the same name."""
        name = "".join(letter if letter.isalnum() else "-" for letter in self.description.map_name)
        return f"{name}-{self.description.map_sha256[:8]}"

    @cached_property
    def net_xml(self) -> str:
        """The compiled SUMO net; BagError if the bag has no map."""
        message = self._first(topics.MAP.name)
        if message is None:
            raise BagError(str(self.path), f"a bag with the episode's map on {topics.MAP.name}")
        return str(message.data)

    @cached_property
    def network(self) -> RoadNetwork:
        """The map as a road network; BagError if the bag has no map."""
        return parse_road_network(self.net_xml.encode())

    @cached_property
    def _mounts(self) -> dict[str, Matrix]:
        message = self._first(topics.TF_STATIC.name)
        with damage_refused(self.path):
            transforms = () if message is None else from_tf(message)
        return {transform.child: matrix_of_transform(transform) for transform in transforms}

    @property
    def station(self) -> Matrix | None:
        """Pose of a roadside suite in the ``map`` frame, shape ``(4, 4)``; None for sensors on a vehicle."""
        return self._mounts.get(STATION_FRAME)

    def _sensors(self, topic: Topic, carrier: Carrier) -> dict[str, str]:
        """A carrier's sensors with this kind of topic: topic by sensor name."""
        head, tail = topic.of_carrier(carrier.name).name.split("{sensor}")
        names = {
            name[len(head) : len(name) - len(tail)]: name
            for name, kind in self.bag.type_names.items()
            if kind == topic.type_name and name.startswith(head) and name.endswith(tail)
        }
        return {sensor: name for sensor, name in sorted(names.items()) if "/" not in sensor}

    @cached_property
    def lidar(self) -> MountedSensor | None:
        """The EMV's first LiDAR; None if it has none."""
        return self.lidar_on(EMV)

    def lidar_on(self, carrier: Carrier) -> MountedSensor | None:
        """A carrier's first LiDAR; None if it has none."""
        for name, topic in self._sensors(topics.LIDAR, carrier).items():
            message = next(self.bag.messages({topic}), None)
            if message is not None:
                mount = self._mounts.get(str(message.read().header.frame_id), np.eye(4))
                return MountedSensor(carrier.frame(name), topic, mount, base_frame=carrier.frame(BASE_FRAME))
        return None

    @cached_property
    def cameras(self) -> tuple[MountedCamera, ...]:
        """The EMV's cameras with recorded pictures, in the order of their names."""
        return self.cameras_on(EMV)

    def cameras_on(self, carrier: Carrier) -> tuple[MountedCamera, ...]:
        """A carrier's cameras with recorded pictures, in the order of their names."""
        cameras = []
        for name, topic in self._sensors(topics.IMAGE_COMPRESSED, carrier).items():
            info = self._first(topics.CAMERA_INFO.of_carrier(carrier.name).of_sensor(name, 1).name)
            if info is None or str(info.header.frame_id) not in self._mounts:
                continue
            truth = topics.IMAGE_TRUTH.of_carrier(carrier.name).of_sensor(name, 1).name
            with damage_refused(self.path):
                model = from_camera_info(info)
            mount = self._mounts[str(info.header.frame_id)]
            truth = truth if truth in self.bag.type_names else ""
            base = carrier.frame(BASE_FRAME)
            cameras.append(MountedCamera(carrier.frame(name), topic, mount, model, truth, base_frame=base))
        return tuple(cameras)

    @property
    def front_camera(self) -> MountedCamera | None:
        """The camera that looks ahead; None if there is none."""
        return next((camera for camera in self.cameras if camera.name == FRONT_CAMERA), None)

    def messages_by_step(self, topics: Collection[str]) -> Iterator[tuple[int, dict[str, BagMessage]]]:
        """Messages of some topics in the order of time, grouped by step; only one step is in memory.

        Raises BagError: the bag is damaged at the place that has been reached.
        """
        for time_ns, messages in groupby(self.bag.messages(topics), lambda message: message.time_ns):
            yield step_of_time_ns(time_ns), {message.topic: message for message in messages}

    def record(self) -> EpisodeRecord:
        """The episode's tracks and events, without sensors; raises as ``OpenBag.record``."""
        return self.bag.record()

    def tracks(self) -> EpisodeRecord:
        """Like ``record``, but without the controllers' commands and the events, which take time to read."""
        return self.bag.record(unread=(topics.EMV_COMMANDS.name, topics.YIELD_COMMANDS.name, topics.EVENTS.name))


@contextmanager
def open_source(path: Path) -> Iterator[EpisodeSource]:
    """Open an episode's bag; raises BagError as ``open_bag``, also for a bag that is not an episode."""
    with open_bag(path) as bag:
        yield EpisodeSource(bag)


@dataclass(frozen=True)
class LidarFrame(Brief):
    """Sensor data of one step; None or missing where nothing was recorded."""

    step: int
    points: npt.NDArray[np.void] | None
    truth: GroundTruth | None
    jpegs: dict[str, bytes]
    """JPEG pictures by the camera's name."""
    image_truths: dict[str, CameraTruth]
    map_from_base: Matrix | None
    """Pose of the LiDAR's carrier: a vehicle, or a station at the roadside."""


def lidar_of(source: EpisodeSource) -> MountedSensor:
    """The LiDAR of a bag; BagError if it has none."""
    if source.lidar is None:
        raise BagError(str(source.path), "an episode recorded with a LiDAR")
    return source.lidar


def lidar_frames(
    source: EpisodeSource, *, cameras: Sequence[MountedCamera] = (), pose: bool = False
) -> Iterator[LidarFrame]:
    """Iterate over the steps of an episode that have a sweep, labels or pictures.

    With ``cameras`` also their pictures and labels, with ``pose`` that of the vehicle or of the station. Raises
    BagError: the bag is damaged at the place that has been reached.
    """
    lidar = lidar_of(source)
    pictures = {camera.topic: camera.name for camera in cameras}
    labels = {camera.truth_topic: camera.name for camera in cameras if camera.truth_topic}
    topics = {lidar.topic, GROUND_TRUTH.name, *pictures, *labels, *((TF.name,) if pose else ())}
    for step, held in source.messages_by_step(topics):
        if not held.keys() - {TF.name}:
            continue
        with damage_refused(source.path):
            points = from_point_cloud(held[lidar.topic].read()) if lidar.topic in held else None
            truth = from_ground_truth(held[GROUND_TRUTH.name].read()) if GROUND_TRUTH.name in held else None
            jpegs = {pictures[name]: from_compressed_image(held[name].read()) for name in pictures if name in held}
            truths = {labels[name]: from_camera_truth(held[name].read()) for name in labels if name in held}
            frames = from_tf(held[TF.name].read()) if TF.name in held else None
            place = None if frames is None else matrix_between(frames, MAP_FRAME, BASE_FRAME)
            if pose and source.station is not None:
                place = source.station
        yield LidarFrame(step, points, truth, jpegs, truths, place)


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
        return sha256_of_file(files[0])
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
