"""Reads tracks of real traffic from the files of other people: the format is known from the ending and the first line.

Formats: tables of INTERACTION, which Test Area Autonomous Driving Baden-Württemberg uses too (``track_id … psi_rad``);
NGSIM's tables (feet, front bumper); the paper's ``trajectory.csv``; Argoverse 2's scenarios (Parquet, no sizes);
CommonRoad's scenarios of 2018b and 2020a. Vehicles on two wheels and people are left out.
"""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.arrays import Floats
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.realism.road_tracks import RoadTracks

_FOOT_M: Final = 0.3048
_KINDS: Final = frozenset({"car", "truck", "bus", "van", "taxi", "vehicle", "truck/bus", "priorityvehicle"})
"""Names of vehicles on four wheels or more, in lower case."""
_PEOPLE: Final = ("pedestrian", "walker", "bicycle", "motorcycle", "cyclist", "bike")
_NGSIM_MOTORCYCLE: Final = 1
_MADE_OF: Final = (
    "tracks of INTERACTION, TAF-BW or NGSIM (.csv), trajectory.csv, Argoverse 2 (.parquet) or CommonRoad (.xml)"
)

Columns = Mapping[str, "npt.NDArray[np.generic]"]


def track_files_in(paths: Iterable[Path]) -> list[Path]:
    """The files themselves, and all files of tracks below folders, by name.

    Raises:
        InputError: A path does not exist, or a folder has no such file.
    """
    files: list[Path] = []
    for path in paths:
        if not path.exists():
            raise InputError("tracks", str(path), "an existing file or folder")
        found = [path] if path.is_file() else [file for file in sorted(path.rglob("*")) if _is_track_file(file)]
        if not found:
            raise InputError("tracks", str(path), f"a folder with {_MADE_OF}")
        files += found
    return files


def _is_track_file(file: Path) -> bool:
    if file.suffix == ".csv":
        with file.open("rb") as opened:
            return _table_of(opened.readline(4096).decode(errors="replace")) is not None
    if file.suffix == ".xml":
        with file.open("rb") as opened:
            return b"<commonRoad" in opened.read(4096)
    return file.suffix == ".parquet"


def read_tracks(file: Path) -> RoadTracks:
    """Read one file.

    Raises:
        InputError: It has another format, or lacks a column.
    """
    try:
        if file.suffix == ".xml":
            return _commonroad(fromstring(file.read_bytes()))
        if file.suffix == ".parquet":
            return _argoverse(_arrays(pq.read_table(file)))
        with file.open("rb") as opened:
            read = _table_of(opened.readline(4096).decode(errors="replace"))
        if read is not None:
            return read(_arrays(pa.csv.read_csv(file)))
    except (OSError, pa.ArrowException, ParseError, DefusedXmlException, KeyError, ValueError, TypeError) as error:
        raise InputError("tracks", str(file), f"{_MADE_OF} ({error})") from error
    raise InputError("tracks", str(file), _MADE_OF)


def _arrays(table: pa.Table) -> Columns:
    return {name.strip(): column.to_numpy() for name, column in zip(table.column_names, table.columns, strict=True)}


def _floats(columns: Columns, name: str) -> Floats:
    return np.asarray(columns[name], dtype=np.float64)


def _ids(names: "npt.NDArray[np.generic]") -> Floats:
    """Numbers for names, the same for the same name."""
    return np.unique(names.astype(str), return_inverse=True)[1].astype(np.float64)


def _is_vehicle(names: "npt.NDArray[np.generic]") -> "npt.NDArray[np.bool_]":
    lower = np.char.lower(names.astype(str))
    known = np.isin(lower, list(_KINDS)) | np.char.startswith(lower, "vehicle.")
    return np.asarray(known & ~np.any([np.char.find(lower, word) >= 0 for word in _PEOPLE], axis=0))


def _interaction(columns: Columns) -> RoadTracks:
    keep = _is_vehicle(columns["agent_type"])
    places = (_floats(columns, name)[keep] for name in ("x", "y", "psi_rad", "length", "width"))
    return RoadTracks.of_columns(_ids(columns["track_id"])[keep], _floats(columns, "timestamp_ms")[keep] / 1e3, *places)


def _ngsim(columns: Columns) -> RoadTracks:
    """The place is that of the front bumper; the heading is that of the motion, kept while the vehicle stands."""
    ids, time_s = _floats(columns, "Vehicle_ID"), _floats(columns, "Global_Time") / 1e3
    named = ("Local_X", "Local_Y", "v_Length", "v_Width")
    x_m, y_m, length_m, width_m = (_FOOT_M * _floats(columns, name) for name in named)
    keep = np.flatnonzero(_floats(columns, "v_Class") != _NGSIM_MOTORCYCLE)
    order = keep[np.lexsort((time_s[keep], ids[keep]))]
    ids, time_s, x_m, y_m, length_m, width_m = (
        column[order] for column in (ids, time_s - time_s.min(), x_m, y_m, length_m, width_m)
    )
    yaw_rad = np.empty(len(ids))
    for vehicle in np.unique(ids).tolist():
        rows = np.flatnonzero(ids == vehicle)
        yaw_rad[rows] = _motion_yaw_rad(x_m[rows], y_m[rows])
    x_m, y_m = x_m - 0.5 * length_m * np.cos(yaw_rad), y_m - 0.5 * length_m * np.sin(yaw_rad)
    return RoadTracks.of_columns(ids, time_s, x_m, y_m, yaw_rad, length_m, width_m)


_MOVED_M: Final = 1.0


def _motion_yaw_rad(x_m: Floats, y_m: Floats) -> Floats:
    """Heading from each place to the first one at least 1 m further; the last known one at the end."""
    points = np.stack((x_m, y_m), axis=-1)
    yaw_rad, row = np.zeros(len(points)), 0
    last = np.pi / 2.0
    for row in range(len(points)):
        apart = points[row:] - points[row]
        far = np.flatnonzero(np.hypot(*apart.T) >= _MOVED_M)
        if len(far):
            last = float(np.arctan2(apart[far[0], 1], apart[far[0], 0]))
        yaw_rad[row] = last
    return yaw_rad


def _paper(columns: Columns) -> RoadTracks:
    """The paper's table is in CARLA's left-handed frame, and has no sizes."""
    keep = _is_vehicle(columns["type_id"])
    named = ("actor_id", "timestamp", "x", "y", "yaw")
    ids, time_s, x_m, y_m, yaw_deg = (_floats(columns, name)[keep] for name in named)
    nothing = np.full(len(ids), np.nan)
    return RoadTracks.of_columns(ids, time_s, x_m, -y_m, -np.radians(yaw_deg), nothing, nothing)


def _argoverse(columns: Columns) -> RoadTracks:
    keep = _is_vehicle(columns["object_type"])
    place = (_floats(columns, name)[keep] for name in ("position_x", "position_y", "heading"))
    ids, nothing = _ids(columns["track_id"])[keep], np.full(int(keep.sum()), np.nan)
    return RoadTracks.of_columns(ids, 0.1 * _floats(columns, "timestep")[keep], *place, nothing, nothing)


def _commonroad(root: Element) -> RoadTracks:
    step_s = float(root.attrib["timeStepSize"])
    rows: list[tuple[float, ...]] = []
    of_2018 = (obstacle for obstacle in root.iter("obstacle") if obstacle.findtext("role") == "dynamic")
    for number, obstacle in enumerate((*root.iter("dynamicObstacle"), *of_2018)):
        if (obstacle.findtext("type") or "").lower() not in _KINDS:
            continue
        size = tuple(float(obstacle.findtext(f"shape/rectangle/{name}") or "nan") for name in ("length", "width"))
        for state in (*obstacle.findall("initialState"), *obstacle.findall("trajectory/state")):
            named = ("time/exact", "position/point/x", "position/point/y", "orientation/exact")
            time, *pose = (float(state.findtext(name) or "nan") for name in named)
            rows.append((float(number), step_s * time, *pose, *size))
    if not rows:
        raise InputError("tracks", "CommonRoad", "a scenario with dynamic obstacles whose states are exact")
    return RoadTracks.of_columns(*np.array(rows).T)


_TABLES: Final[Mapping[str, Callable[[Columns], RoadTracks]]] = {
    "psi_rad": _interaction,
    "v_Length": _ngsim,
    "type_id": _paper,
}
"""Readers of tables, by a column that only this format has."""


def _table_of(head: str) -> Callable[[Columns], RoadTracks] | None:
    names = {name.strip().strip('"') for name in head.split(",")}
    return next((read for name, read in _TABLES.items() if name in names), None)
