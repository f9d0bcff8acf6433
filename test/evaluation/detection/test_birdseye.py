"""The worst frame from above."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from detection_boxes import found_boxes, truth_boxes
from evaluation.made_frames import made_frames, to_map
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Annotation

from siren_ros.evaluation.detection import pictures as birdseye
from siren_ros.evaluation.detection.boxes import Boxes
from siren_ros.evaluation.detection.devkit_score import match
from siren_ros.evaluation.detection.frames import Frames, frames_of


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def two_templates() -> Frames:
    """Frames 0 to 3 are of S2, 4 to 7 of S3."""
    first, second = made_frames(camera=False).episodes
    return frames_of([first, replace(second, template="S3")])


def columns(rows: list[tuple[int, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Boxes of frames at distances ahead of the LiDAR."""
    places = np.array([to_map(frame, ahead, 0.0, -1.0) for frame, ahead in rows]).reshape(-1, 3)
    return np.array([frame for frame, _ in rows], dtype=np.intp), places, np.zeros((len(rows), 2)), np.zeros(len(rows))


def drawn(
    labels: list[tuple[int, float]],
    found: list[tuple[int, float, float]],
    template: str,
    path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> dict[str, tuple[int, list[float]]]:
    """Frame and distances ahead of what is drawn, by its name."""
    truth = truth_boxes(*columns(labels))
    boxes = found_boxes(*columns([one[:2] for one in found]), np.array([one[2] for one in found]))
    scores: Any = SimpleNamespace(name="made", truth=truth, found=boxes, matches=match(truth, boxes))
    groups: dict[str, tuple[int, list[float]]] = {}

    def kept(_axes: object, some: Boxes, place: np.ndarray, name: str) -> None:
        away = np.hypot(*(some.centre_m[:, :2] - place).T)
        if len(some):
            groups[name] = int(some.frame[0]), np.round(away, 6).tolist()

    monkeypatch.setattr(birdseye, "_draw", kept)
    monkeypatch.setattr(birdseye, "returns_from_above", lambda *_: np.zeros((1, 2)))
    birdseye.draw_worst_frame(scores, two_templates(), template, path)
    assert path.stat().st_size > 1000
    return groups


def test_the_frame_with_the_most_errors_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frame 1 has a miss and a false alarm, frame 2 one miss; frame 3 has no label; those of S3 do not count."""
    labels = [(0, 10.0), (1, 10.0), (1, 20.0), (2, 10.0), (5, 10.0), (5, 20.0), (5, 30.0)]
    found = [
        (0, 10.0, 0.9),
        (1, 10.5, 0.8),
        (1, 30.0, 0.7),
        (1, 40.0, 0.29),
        *((3, 5.0 * place, 0.9) for place in range(1, 6)),
        (5, 10.0, 0.31),
        (5, 20.0, 0.29),
    ]
    assert drawn(labels, found, "S2", Path("a.png"), monkeypatch) == {
        "label, found": (1, [10.0]),
        "label, missed": (1, [20.0]),
        "hit": (1, [10.5]),
        "false alarm": (1, [30.0]),
    }
    # A faint detection is left out, and the label that it would have taken is missed.
    assert drawn(labels, found, "S3", tmp_path / "b.png", monkeypatch) == {
        "label, found": (5, [10.0]),
        "label, missed": (5, [20.0, 30.0]),
        "hit": (5, [10.0]),
    }


def test_matches_are_within_two_metres_and_the_first_of_equal_frames_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels, found = [(6, 10.0), (7, 10.0)], [(6, 11.9, 0.9), (7, 12.1, 0.9)]
    assert drawn(labels, found, "S3", Path("a.png"), monkeypatch)["label, missed"] == (7, [10.0])
    alike = [(4, 10.0), (6, 10.0), (7, 10.0)]
    assert drawn(alike, [(7, 10.0, 0.9)], "S3", tmp_path / "b.png", monkeypatch) == {"label, missed": (4, [10.0])}


@pytest.mark.parametrize("yaw_rad", [0.0, 2.0])
def test_a_line_leads_from_the_centre_to_the_front(yaw_rad: float) -> None:
    """4.5 m long and 1.9 m wide, 10 m east and 5 m north of the sensor."""
    frame, place = np.zeros(1, dtype=np.intp), np.array([100.0, 50.0])
    box = found_boxes(frame, np.array([[110.0, 55.0, 1.0]]), np.zeros((1, 2)), np.array([yaw_rad]), np.array([0.456]))
    axes = Figure().add_subplot()
    birdseye._draw(axes, box, place, "false alarm")
    (outline,) = (one for one in axes.collections if isinstance(one, PolyCollection))
    (line,) = (one for one in axes.collections if isinstance(one, LineCollection))
    ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    assert line.get_segments()[0] == pytest.approx(np.array([[10.0, 5.0], [10.0, 5.0] + 2.25 * ahead]))
    corners = outline.get_paths()[0].vertices[:4] - (10.0, 5.0)
    assert np.hypot(*corners.T) == pytest.approx(np.full(4, np.hypot(2.25, 0.95)))
    assert outline.get_label() == "false alarm: 1"
    assert [text.get_text() for text in axes.texts] == ["0.46"]


def whole_picture(frames: Frames, picture: Any, monkeypatch: pytest.MonkeyPatch) -> Figure:
    """Frame 5 is drawn: a label that is found by a box, one that is missed, a false alarm."""
    truth = truth_boxes(*columns([(5, 10.0), (5, 20.0)]))
    boxes = found_boxes(*columns([(5, 10.0), (5, 30.0)]), np.array([0.9, 0.456]))
    scores: Any = SimpleNamespace(name="made", truth=truth, found=boxes, matches=match(truth, boxes))
    east = frames.episodes[1].vehicle_m[1] + np.array([[7.0, 1.0], [8.0, 2.0]])
    monkeypatch.setattr(birdseye, "returns_from_above", lambda *_: east)
    monkeypatch.setattr(birdseye, "front_picture", lambda *_: picture)
    kept: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: (kept.append(figure), path.touch()))
    birdseye.draw_worst_frame(scores, frames, "S3", Path("a.png"))
    (figure,) = kept
    return figure


def test_the_whole_picture_from_above(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = two_templates()
    (axes,) = whole_picture(frames, None, monkeypatch).axes
    first, second = axes.get_title().splitlines()
    assert first == "made: episode1 step 2"
    assert second.endswith("a confidence from 0.3 on, matches within 2 m")
    returns, sensor = axes.lines
    assert np.asarray(returns.get_xydata()) == pytest.approx(np.array([[7.0, 1.0], [8.0, 2.0]]))
    assert np.asarray(sensor.get_xydata()).tolist() == [[0.0, 0.0]]
    (reach,) = axes.patches
    assert isinstance(reach, Circle)
    assert (reach.center, reach.radius, reach.get_fill()) == ((0.0, 0.0), 50.0, False)
    for low, high in (axes.get_xlim(), axes.get_ylim()):
        assert low == -high
        assert high == pytest.approx(52.0), "the whole reach is in the picture"
    assert axes.get_aspect() == 1.0
    (arrow, confidence) = axes.texts
    assert isinstance(arrow, Annotation)
    # The LiDAR is turned by 60 degrees to the left of the east.
    assert arrow.xy == pytest.approx((5.0 * np.cos(np.pi / 3.0), 5.0 * np.sin(np.pi / 3.0)))
    assert arrow.get_position() == (0.0, 0.0)
    assert isinstance(confidence, Annotation)
    assert (confidence.get_text(), confidence.xy) == ("0.46", pytest.approx((15.0, 15.0 * np.sqrt(3.0))))


def test_labels_are_filled_and_detections_are_outlines(monkeypatch: pytest.MonkeyPatch) -> None:
    (axes,) = whole_picture(two_templates(), None, monkeypatch).axes
    outlines = {str(one.get_label()): one for one in axes.collections if isinstance(one, PolyCollection)}
    assert list(outlines) == ["label, found: 1", "label, missed: 1", "hit: 1", "false alarm: 1"]
    for name, one in outlines.items():
        is_label = name.startswith("label")
        assert (len(one.get_facecolor()) > 0) == is_label
        assert (one.get_alpha() or 0.0) < 1.0 if is_label else one.get_alpha() == 1.0
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()][2:] == list(outlines)
    assert legend.get_frame().get_alpha() == 1.0, "returns do not shine through"


def test_the_front_cameras_picture_stands_to_the_right(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Any] = []
    monkeypatch.setattr(birdseye, "draw_in_picture", lambda *given: shown.append(given))
    figure = whole_picture(two_templates(), "a picture", monkeypatch)
    above, front = figure.axes
    assert [axes.get_subplotspec().get_geometry() for axes in (above, front)] == [(1, 2, 0, 0), (1, 2, 1, 1)]
    ((axes, picture, groups, _),) = shown
    assert (axes, picture) == (front, "a picture")
    assert {name: len(boxes) for name, boxes in groups.items()} == {
        "label, found": 1, "label, missed": 1, "hit": 1, "false alarm": 1
    }  # fmt: skip
    alone = whole_picture(two_templates(), None, monkeypatch)
    assert figure.get_size_inches()[0] == 2 * alone.get_size_inches()[0], "the other picture is as wide"
