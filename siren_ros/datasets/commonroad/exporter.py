"""CommonRoad scenarios out of recorded episodes: the EMV is the planning problem, everybody else an obstacle."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

from siren_ros.datasets.commonroad.lanelets import add_network
from siren_ros.datasets.exporting.file_writer import FileWriter
from siren_ros.datasets.exporting.format import EpisodePart, EpisodeReport
from siren_ros.datasets.exporting.staging import link
from siren_ros.datasets.sources.episode_source import EpisodeSource
from siren_ros.datasets.sources.sampling import FRAME_S
from siren_ros.datasets.sources.tracks import Track, tracks_of
from siren_ros.datasets.sources.xml_text import child, document
from siren_ros.errors import BagError
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.episode import EpisodeDescription
from siren_ros.world.actors import EMERGENCY_CLASSES, ActorClass

VERSION: Final = "2020a"
_TYPE_OF_CLASS: Final = {ActorClass.TRUCK: "truck", ActorClass.BUS: "bus"}
_PROBLEM: Final = 5_000_000
_OBSTACLES: Final = 6_000_000
_GOAL_LENGTH_M: Final = 10.0
_GOAL_WIDTH_M: Final = 4.0
_UNKNOWN_PLACE: Final = {"geoNameId": -999, "gpsLatitude": 999, "gpsLongitude": 999}
"""What CommonRoad writes where a map has no place on earth."""


class CommonRoadExporter:
    """One XML file for each episode."""

    def __init__(self, intersections: str) -> None:
        self._arm_names = intersections

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Writes the scenario; all tracks of the episode are in memory."""
        record = source.record()
        tracks = tracks_of(record)
        emv_id = min(record.emv_ids)
        emv = next((track for track in tracks if track.actor.actor_id == emv_id), None)
        if emv is None or len(emv) < 2:
            raise BagError(str(source.path), "an episode in which the EMV drives")
        root = _root(record, source.description, self._arm_names)
        others = [track for track in tracks if track is not emv and len(track) > 1]
        for track in others:
            _add_obstacle(root, track)
        _add_problem(root, emv)
        files.write(f"{episode_id}.xml", document(root))
        types = Counter(obstacle_type(track.actor.actor_class) for track in others)
        return EpisodeReport({"scenarios": 1, "obstacles": len(others)}, dict(types))

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """A folder for each split."""
        for part in parts:
            for path in part.folder.glob("*.xml"):
                link(path, folder / part.split / path.name)


def obstacle_type(actor_class: ActorClass) -> str:
    """CommonRoad's type of a vehicle; emergency vehicles are ``priorityVehicle``."""
    if actor_class in EMERGENCY_CLASSES:
        return "priorityVehicle"
    return _TYPE_OF_CLASS.get(actor_class, "car")


def benchmark_id(description: EpisodeDescription) -> str:
    """CommonRoad's name: ``ZAM_SirenS2town-1_1_T-1``; ZAM is its country of what is nowhere."""
    letters = "".join(letter for letter in f"{description.template}{description.map_name}" if letter.isalnum())
    return f"ZAM_Siren{letters}-{description.seed + 1}_1_T-1"


def _root(record: EpisodeRecord, description: EpisodeDescription, arm_names: str = "outgoing") -> Element:
    root = Element(
        "commonRoad",
        {
            "timeStepSize": f"{FRAME_S:g}",
            "commonRoadVersion": VERSION,
            "author": "SIREN",
            "affiliation": "SIREN",
            "source": f"SIREN, template {description.template}, level {description.level.name}",
            "benchmarkID": benchmark_id(description),
            "date": "1970-01-01",
        },
    )
    place = child(root, "location")
    origin = record.network.origin_lat_lon_deg
    known = {} if origin is None else {"gpsLatitude": origin[0], "gpsLongitude": origin[1]}
    for tag, value in {**_UNKNOWN_PLACE, **known}.items():
        child(place, tag, value)
    tags = child(root, "scenarioTags")
    child(tags, "urban")
    child(tags, "simulated")
    add_network(root, record, arm_names)
    return root


def _add_obstacle(root: Element, track: Track) -> None:
    made = child(root, "dynamicObstacle", id=_OBSTACLES + track.actor.actor_id)
    child(made, "type", obstacle_type(track.actor.actor_class))
    rectangle = child(child(made, "shape"), "rectangle")
    child(rectangle, "length", track.actor.length_m)
    child(rectangle, "width", track.actor.width_m)
    _add_state(child(made, "initialState"), track, 0)
    trajectory = child(made, "trajectory")
    for row in range(1, len(track)):
        _add_state(child(trajectory, "state"), track, row)


def _add_state(state: Element, track: Track, row: int) -> None:
    point = child(child(state, "position"), "point")
    child(point, "x", float(track.x_m[row]))
    child(point, "y", float(track.y_m[row]))
    values = {
        "orientation": float(track.yaw_rad[row]),
        "time": int(track.frame[row]),
        "velocity": float(track.speed_mps[row]),
        "acceleration": float(track.accel_mps2[row]),
    }
    for tag, value in values.items():
        child(child(state, tag), "exact", value)


def _add_problem(root: Element, emv: Track) -> None:
    """From where the EMV starts to where it is at the end."""
    problem = child(root, "planningProblem", id=_PROBLEM + emv.actor.actor_id)
    state = child(problem, "initialState")
    _add_state(state, emv, 0)
    for tag in ("yawRate", "slipAngle"):
        child(child(state, tag), "exact", 0.0)
    goal = child(problem, "goalState")
    rectangle = child(child(goal, "position"), "rectangle")
    child(rectangle, "length", _GOAL_LENGTH_M)
    child(rectangle, "width", _GOAL_WIDTH_M)
    child(rectangle, "orientation", float(emv.yaw_rad[-1]))
    centre = child(rectangle, "center")
    child(centre, "x", float(emv.x_m[-1]))
    child(centre, "y", float(emv.y_m[-1]))
    time = child(goal, "time")
    child(time, "intervalStart", max(1, int(emv.frame[-1]) // 2))
    child(time, "intervalEnd", int(emv.frame[-1]))
