"""Files of tracks in each format: the same drive read from all of them, and files that are none."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from repository import shared_file

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.realism.ledger import STATISTICS, read_ledger
from siren_ros.scoring.evaluation.realism.quantities import TRAFFIC
from siren_ros.scoring.evaluation.realism.track_files import read_tracks, track_files_in

FRAMES = 30
HEADING = 0.5
X_M, Y_M = 10.0 + 0.6 * np.cos(HEADING) * np.arange(FRAMES), -3.0 + 0.6 * np.sin(HEADING) * np.arange(FRAMES)
"""A car at 6 m/s; a cyclist is at the same places."""


def _csv(path: Path, head: str, rows: list[str]) -> Path:
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def interaction(folder: Path) -> Path:
    rows = [
        f"{name},{frame},{100 * frame},{kind},{x},{y},99,99,{HEADING},4.5,1.8"
        for name, kind in (("7", "Car"), ("9", "Bike"))
        for frame, (x, y) in enumerate(zip(X_M, Y_M, strict=True))
    ]
    head = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
    return _csv(folder / "tracks.csv", head, rows)


def ngsim(folder: Path) -> Path:
    foot, front = 0.3048, (2.25 * np.cos(HEADING), 2.25 * np.sin(HEADING))
    size = f"{4.5 / foot},{1.8 / foot}"
    rows = [
        f"{name},{frame},{5000 + 100 * frame},{(x + front[0]) / foot},{(y + front[1]) / foot},{size},{kind},0"
        for name, kind in (("7", 2), ("9", 1))
        for frame, (x, y) in enumerate(zip(X_M, Y_M, strict=True))
    ]
    head = "Vehicle_ID,Frame_ID,Global_Time,Local_X,Local_Y,v_Length,v_Width,v_Class,v_Vel"
    return _csv(folder / "ngsim.csv", head, rows)


def paper(folder: Path) -> Path:
    rows = [
        f"{2 * frame},{0.1 * frame},{name},{kind},{x},{-y},0,{-np.degrees(HEADING)},0,0,0,False"
        for name, kind in ((7, "vehicle.siren.sedan"), (9, "vehicle.siren.bicycle"))
        for frame, (x, y) in enumerate(zip(X_M, Y_M, strict=True))
    ]
    head = "step,timestamp,actor_id,type_id,x,y,z,yaw,vx,vy,speed_mps,is_emv"
    return _csv(folder / "trajectory.csv", head, rows)


def argoverse(folder: Path) -> Path:
    count = 2 * FRAMES
    columns = {
        "track_id": ["7"] * FRAMES + ["AV"] * FRAMES,
        "object_type": ["vehicle"] * FRAMES + ["cyclist"] * FRAMES,
        "timestep": list(range(FRAMES)) * 2,
        "position_x": [*X_M, *X_M],
        "position_y": [*Y_M, *Y_M],
        "heading": [HEADING] * count,
    }
    path = folder / "scenario.parquet"
    pq.write_table(pa.table(columns), path)
    return path


def _commonroad(tag: str, role: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        states = "".join(
            f"<{'initialState' if not frame else 'state'}><position><point><x>{x}</x><y>{y}</y></point></position>"
            f"<orientation><exact>{HEADING}</exact></orientation><time><exact>{frame}</exact></time>"
            f"</{'initialState' if not frame else 'state'}>{'<trajectory>' if not frame else ''}"
            for frame, (x, y) in enumerate(zip(X_M, Y_M, strict=True))
        )
        shape = "<shape><rectangle><length>4.5</length><width>1.8</width></rectangle></shape>"
        one = "<{tag} id='{id}'>{role}<type>{kind}</type>{shape}{states}</trajectory></{tag}>"
        both = "".join(
            one.format(tag=tag, id=number, role=role, kind=kind, shape=shape, states=states)
            for number, kind in ((7, "car"), (9, "bicycle"))
        )
        path = folder / "scenario.xml"
        path.write_text(f"<commonRoad timeStepSize='0.1'>{both}</commonRoad>")
        return path

    return write


FORMATS = {
    "interaction": (interaction, True),
    "ngsim": (ngsim, True),
    "paper": (paper, False),
    "argoverse": (argoverse, False),
    "commonroad 2020a": (_commonroad("dynamicObstacle", ""), True),
    "commonroad 2018b": (_commonroad("obstacle", "<role>dynamic</role>"), True),
}


@pytest.mark.parametrize(("write", "has_sizes"), FORMATS.values(), ids=FORMATS.keys())
def test_every_format_gives_the_same_drive_of_the_car_alone(
    tmp_path: Path, write: Callable[[Path], Path], has_sizes: bool
) -> None:
    tracks = read_tracks(write(tmp_path))
    assert len(tracks) == FRAMES
    assert np.unique(tracks.track_id).size == 1
    assert tracks.time_s - tracks.time_s[0] == pytest.approx(0.1 * np.arange(FRAMES))
    assert np.stack((tracks.x_m, tracks.y_m)) == pytest.approx(np.stack((X_M, Y_M)), abs=1e-6)
    assert tracks.yaw_rad == pytest.approx(np.full(FRAMES, HEADING), abs=1e-6)
    assert tracks.speed_mps == pytest.approx(np.full(FRAMES, 6.0), abs=1e-6)
    sizes = np.stack((tracks.length_m, tracks.width_m), axis=-1)
    assert sizes == pytest.approx(np.full((FRAMES, 2), (4.5, 1.8))) if has_sizes else np.isnan(sizes).all()


def test_folder_gives_its_track_files_alone(tmp_path: Path) -> None:
    file = interaction(tmp_path)
    (tmp_path / "meta_data.csv").write_text("id,frameRate_hz\n0,10\n")
    (tmp_path / "map.xml").write_text("<net/>")
    assert track_files_in([tmp_path]) == [file]


@pytest.mark.parametrize("content", ["", "a,b\n1,2\n", "track_id,psi_rad\n1,x\n"])
def test_a_file_that_is_none_is_named(tmp_path: Path, content: str) -> None:
    file = tmp_path / "other.csv"
    file.write_text(content)
    with pytest.raises(InputError, match=r"other\.csv"):
        read_tracks(file)
    for path in (tmp_path / "empty", tmp_path / "missing"):
        (tmp_path / "empty").mkdir(exist_ok=True)
        with pytest.raises(InputError):
            track_files_in([path])


def test_published_tracks_are_read() -> None:
    folder = shared_file("real/tracks/tafbw/datasets/recorded_trackfiles/k733_2020-09-15/vehicle_tracks_000.csv")
    tracks = read_tracks(folder)
    assert len(tracks) == 9562  # its cars and trucks, counted in the file


def test_the_ledger_has_what_published_tracks_show_by_the_measures_of_episodes() -> None:
    k733 = [
        f"tafbw/datasets/recorded_trackfiles/k733_{day}/vehicle_tracks_000.csv" for day in ("2018-05-02", "2020-09-15")
    ]
    ngsim = [f"USA_{piece}_T-1.xml" for piece in ("Lanker-1_17", "Lanker-1_1", "Peach-2_1", "Peach-4_1")]
    first, second = ([read_tracks(shared_file("real/tracks", file)) for file in files] for files in (k733, ngsim))
    lines = [line for line in read_ledger() if line.read == "computed"]
    assert [line.line_id for line in lines] == [f"R0{number}" for number in range(1, 8)]
    for line in lines:
        used = (first[1:] if "2020" in line.setting else first), second
        samples = (np.concatenate([*map(TRAFFIC[line.samples], recordings)]) for recordings in used)
        low, high = sorted(map(STATISTICS[line.statistic], samples))
        bounds = (low, high) if line.line_id != "R07" else (0.4 * (low + high), 0.6 * (low + high))  # hardly a range
        assert (line.low, line.value, line.high) == pytest.approx((bounds[0], 0.5 * (low + high), bounds[1]), abs=0.011)
