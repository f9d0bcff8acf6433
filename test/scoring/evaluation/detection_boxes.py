"""Tables of boxes for the tests of the detection task."""

from collections.abc import Sequence

import numpy as np

from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes, TruthBoxes, attributes_of


def _shared(
    frame: np.ndarray, centre_m: np.ndarray, velocity_mps: np.ndarray, yaw_rad: np.ndarray
) -> dict[str, object]:
    return {
        "frame": frame.astype(np.intp),
        "centre_m": centre_m,
        "size_m": np.tile([4.5, 1.9, 1.6], (len(frame), 1)),
        "yaw_rad": yaw_rad,
        "velocity_mps": velocity_mps,
        "attribute": attributes_of(velocity_mps),
    }


def truth_boxes(frame: np.ndarray, centre_m: np.ndarray, velocity_mps: np.ndarray, yaw_rad: np.ndarray) -> TruthBoxes:
    count = len(frame)
    return TruthBoxes(
        **_shared(frame, centre_m, velocity_mps, yaw_rad),  # type: ignore[arg-type] # arrays by name
        actor_id=np.arange(count, dtype=np.uint32),
        actor_class=np.zeros(count, dtype=np.uint8),
        lidar_points=np.full(count, 50, dtype=np.uint32),
        visible=np.ones(count),
        mode=np.zeros(count, dtype=np.uint8),
    )


def found_boxes(
    frame: np.ndarray, centre_m: np.ndarray, velocity_mps: np.ndarray, yaw_rad: np.ndarray, score: np.ndarray
) -> FoundBoxes:
    return FoundBoxes(
        **_shared(frame, centre_m, velocity_mps, yaw_rad),  # type: ignore[arg-type] # arrays by name
        score=score,
        label=np.full(len(frame), "car"),
    )


def made_boxes(
    truth_x_m: Sequence[float], found_x_m: Sequence[float], score: Sequence[float]
) -> tuple[TruthBoxes, FoundBoxes]:
    """Boxes of one frame on the x axis."""

    def columns(x_m: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        count = len(x_m)
        centre = np.stack((np.array(x_m), np.zeros(count), np.ones(count)), axis=-1)
        return np.zeros(count, dtype=np.intp), centre, np.tile([3.0, 0.0], (count, 1)), np.zeros(count)

    return truth_boxes(*columns(truth_x_m)), found_boxes(*columns(found_x_m), np.array(score))


def random_boxes(rng: np.random.Generator, frames: int) -> tuple[TruthBoxes, FoundBoxes]:
    """Labels, and detections near most of them with errors, among false alarms; some confidences are equal."""
    frame = np.repeat(np.arange(frames), rng.integers(0, 9, size=frames))
    count = len(frame)
    centre = np.column_stack((rng.uniform(-30, 30, size=(count, 2)), np.ones(count)))
    velocity, yaw = rng.normal(0, 5, size=(count, 2)), rng.uniform(-3, 3, size=count)
    truth = truth_boxes(frame, centre, velocity, yaw)
    kept = rng.random(count) < 0.8
    alarms = rng.integers(0, frames, size=40)
    all_frames = np.r_[frame[kept], alarms]
    places = np.r_[centre[kept] + rng.normal(0, 1.0, size=(kept.sum(), 3)), rng.uniform(-30, 30, size=(40, 3))]
    speeds = np.r_[velocity[kept] + rng.normal(0, 1, size=(kept.sum(), 2)), rng.normal(0, 5, size=(40, 2))]
    turns = np.r_[yaw[kept] + rng.normal(0, 0.2, size=kept.sum()), rng.uniform(-3, 3, size=40)]
    scores = rng.uniform(0.05, 1.0, size=len(all_frames)).round(2)
    order = np.argsort(all_frames, kind="stable")
    return truth, found_boxes(all_frames[order], places[order], speeds[order], turns[order], scores[order])
