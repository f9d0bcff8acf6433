"""Boxes, frames and scores of detectors made by hand, for the tests of the detection task.

The frames are of two episodes without a bag: the LiDAR is turned, lifted and away from the map's origin.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from busy_record import BEHIND, FIRST, busy_record

from siren_ros.base.numerics.arrays import Matrix
from siren_ros.base.tables import NOTHING, Interval
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes, TruthBoxes, attributes_of, joined
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames, Frames, frames_of
from siren_ros.scoring.evaluation.detection.metrics import DISTANCES_M, ERRORS, DevkitScore, match
from siren_ros.scoring.evaluation.detection.scoring import DetectorScores
from siren_ros.scoring.evaluation.scores import Score, single
from siren_ros.simulation.world.actors import EMERGENCY_CLASSES, PEOPLE_CLASSES, ActorClass


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


LIDAR_YAW_RAD = np.pi / 3.0
LIDAR_M = (100.0, 50.0, 2.0)
CAMERA_FROM_LIDAR = np.array([[0.0, -1.0, 0, 0], [0, 0, -1.0, -0.5], [1.0, 0, 0, -1.5], [0, 0, 0, 1.0]])
"""The front camera is 1.5 m ahead of the LiDAR and 0.5 m below it; its axes are right, down, ahead."""
GLOBAL_M = (1000.0, 2000.0)
STEPS = (0, 2, 10, 12)
"""Of each episode; 0 and 10 are keyframes."""
PICTURED = (True, False, True, True)


def map_from_lidar(frame: int) -> Matrix:
    """The LiDAR of a frame goes on by 1 m along x from frame to frame."""
    cos, sin = np.cos(LIDAR_YAW_RAD), np.sin(LIDAR_YAW_RAD)
    x, y, z = LIDAR_M
    return np.array([[cos, -sin, 0, x + frame], [sin, cos, 0, y], [0, 0, 1.0, z], [0, 0, 0, 1.0]])


def to_map(frame: int, ahead_m: float, left_m: float, up_m: float) -> list[float]:
    """A place as the LiDAR has it, in the map, written out."""
    cos, sin = np.cos(LIDAR_YAW_RAD), np.sin(LIDAR_YAW_RAD)
    x, y, z = LIDAR_M
    return [x + frame + ahead_m * cos - left_m * sin, y + ahead_m * sin + left_m * cos, z + up_m]


def columns_ahead(rows: Sequence[tuple[int, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frame, centre, velocity and yaw of boxes that stand at distances ahead of the LiDAR."""
    places = np.array([to_map(frame, ahead, 0.0, -1.0) for frame, ahead in rows]).reshape(-1, 3)
    return np.array([frame for frame, _ in rows], dtype=np.intp), places, np.zeros((len(rows), 2)), np.zeros(len(rows))


def made_frames(camera: bool = True) -> Frames:
    """Four frames of each of two episodes, without labels."""
    nothing = truth_boxes(np.zeros(0, dtype=np.intp), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
    count = len(STEPS)
    return frames_of(
        [
            EpisodeFrames(
                bag="bag",
                episode_id=f"episode{number}",
                template="S2",
                seed=number,
                step=np.array(STEPS, dtype=np.intp),
                map_from_lidar=np.array([map_from_lidar(count * number + row) for row in range(count)]),
                vehicle_m=np.array([to_map(count * number + row, 0.0, 0.0, 0.0)[:2] for row in range(count)]),
                pictured=np.array(PICTURED),
                lidar_frame="lidar",
                base_from_lidar=np.eye(4),
                camera_from_lidar=CAMERA_FROM_LIDAR if camera else None,
                global_from_map_m=np.array(GLOBAL_M) * (1 + number),
                truth=nothing,
            )
            for number in range(2)
        ]
    )


BUSY_STEPS = np.union1d(np.arange(0, 320, 10), np.arange(5, 320, 40))


def busy_episodes(templates: str = "S1 S2 S1 S2 S7 S7", frames: int = len(BUSY_STEPS)) -> tuple[Frames, FoundBoxes]:
    """Episodes of a busy record, seen by the first EMV or by the second one, and detections.

    The detector misses some boxes, moves and turns others, makes some up, and says what most are; a box that it finds
    twice is one. All errors follow from the number of the row.
    """
    record, episodes, boxes = busy_record(), [], []
    for number, template in enumerate(templates.split()):
        eye, steps = record.track((FIRST, BEHIND)[number % 2]), BUSY_STEPS[number % 3 : frames]
        at = eye.select(np.isin(eye.step, steps))
        cos, sin = np.cos(at.yaw_rad), np.sin(at.yaw_rad)
        pose = np.tile(np.eye(4), (len(steps), 1, 1))
        pose[:, :2, :2] = np.moveaxis(np.array(((cos, -sin), (sin, cos))), -1, 0)
        pose[:, :3, 3] = np.column_stack((at.xy_m, np.full(len(steps), 2.0)))
        truth = _labels_of(record, int(eye.actor_id[0]), steps)
        about = {"template": template, "episode_id": f"busy{number}", "seed": number, "map_name": f"map{number % 3}"}
        about |= {"look": ("rain", "day")[number % 2], "suite": ("lidar", "full")[number // 3], "bag": f"bag{number}"}
        columns = {
            "map_from_lidar": pose,
            "vehicle_m": at.xy_m,
            "pictured": steps % 4 == 0,
            "step": steps,
            "truth": truth,
        }
        episodes.append(replace(made_frames().episodes[number % 2], **about, **columns))
        boxes.append(_found_of(truth, number, sum(map(len, episodes[:-1]))))
    return frames_of(episodes), joined(boxes)


def _labels_of(record: EpisodeRecord, eye_id: int, steps: np.ndarray) -> TruthBoxes:
    rows = record.rows
    rows = rows.select(np.isin(rows.step, steps) & (rows.actor_id != eye_id))
    rows = rows.select(np.lexsort((rows.actor_id, rows.step)))
    actors = [record.actors[key] for key in rows.actor_id.tolist()]
    size = np.array([(actor.length_m, actor.width_m, actor.height_m) for actor in actors])
    velocity = np.stack((rows.vx_mps, rows.vy_mps), axis=-1)
    kind = np.array([actor.actor_class for actor in actors], dtype=np.uint8)
    return TruthBoxes(
        frame=np.searchsorted(steps, rows.step),
        centre_m=np.column_stack((rows.xy_m, 0.5 * size[:, 2])),
        size_m=size,
        yaw_rad=rows.yaw_rad,
        velocity_mps=velocity,
        attribute=attributes_of(velocity, kind),
        actor_id=rows.actor_id,
        actor_class=kind,
        lidar_points=((7 * np.arange(len(rows)) + rows.step) % 150).astype(np.uint32),
        visible=(0.37 * np.arange(len(rows))) % 1.0,
        mode=rows.mode,
    )


def _found_of(truth: TruthBoxes, number: int, first: int) -> FoundBoxes:
    kept = np.flatnonzero((np.arange(len(truth)) + number) % 5 > 0)
    kept = np.sort(np.concatenate((kept, kept[:: 9 + number])))
    wave = np.sin(1.7 * np.arange(len(kept)) + number)
    kinds = [ActorClass(kind) for kind in truth.actor_class[kept]]
    names = [kind.name.lower() if kind in EMERGENCY_CLASSES | PEOPLE_CLASSES else "car" for kind in kinds]
    made_up = np.arange(len(kept)) % 11 == 3
    return FoundBoxes(
        frame=truth.frame[kept] + first,
        centre_m=truth.centre_m[kept] + 0.6 * wave[:, None] * np.array([1.0, 0.7, 0.1]) + 9.0 * made_up[:, None],
        size_m=truth.size_m[kept] * (1.0 + 0.1 * wave[:, None]),
        yaw_rad=truth.yaw_rad[kept] + 0.2 * wave + np.pi * (np.arange(len(kept)) % 13 == 5),
        velocity_mps=truth.velocity_mps[kept] + wave[:, None],
        attribute=attributes_of(truth.velocity_mps[kept] + wave[:, None]),
        score=np.round(0.5 + 0.45 * np.cos(0.9 * np.arange(len(kept)) + number), 3),
        label=np.where(np.arange(len(kept)) % 7 > 0, names, "car"),
    )


def devkit_score_of(mean_ap: float, labels: int = 10) -> DevkitScore:
    """AP rises by 0.1 from distance to distance around the mean; precision falls from 1 to 0 with the recall."""
    by_distance = {one: mean_ap + 0.1 * (place - 1.5) for place, one in enumerate(DISTANCES_M)}
    errors = {name: mean_ap + place for place, name in enumerate(ERRORS)}
    precision = np.array([np.linspace(1.0, 0.1 * place, 101) for place in range(len(DISTANCES_M))])
    return DevkitScore(labels, 2 * labels, by_distance, errors, mean_ap, mean_ap / 2.0, precision)


def detector_scores(name: str, mean_ap: Mapping[str, float], *, bounded: bool = True) -> DetectorScores:
    """A detector with a mean AP for each template; intervals are 0.05 wide to each side, of six episodes."""

    def interval(value: float) -> Interval:
        return Interval(value, value - 0.05, value + 0.05, 6) if bounded else Interval(value, value, value, 1)

    truth, found = made_boxes([5.0, 15.0], [5.0, 40.0], [0.9, 0.5])
    mean = float(np.mean(list(mean_ap.values())))

    def row(kind: str, group: str, metric: str, value: Interval, labels: int = 10) -> Score:
        return Score(name, kind, group, metric, value, labels)

    values = {("all", "all"): mean} | {("template", template): value for template, value in mean_ap.items()}
    rows = [row(*group, "mAP", interval(value)) for group, value in values.items()]
    rows += [row(*group, "NDS", single(value / 2.0)) for group, value in values.items()]
    rows += [
        row(*group, error, single(value + place))
        for group, value in values.items()
        for place, error in enumerate(ERRORS)
    ]
    order = {"clearance < stop sign": 0.75, "all": 0.25} if bounded else {}
    return DetectorScores(
        name=name,
        format="nuScenes",
        has_velocity=True,
        frames=dict.fromkeys(mean_ap, 40),
        templates={template: devkit_score_of(value) for template, value in mean_ap.items()},
        people={},
        rows=(
            *rows,
            row("family", "clearance", "mAP", interval(mean)),
            row("family", "red light", "mAP", NOTHING),
            *(row("order", step, "share", single(share)) for step, share in order.items()),
            row("behaviour", "held", "mAP", interval(0.25), 7),
            row("behaviour", "yielding", "mAP", NOTHING, 0),
            row("distance", "0-15 m", "mAP", interval(1.0), 8 if bounded else 9),
        ),
        order=order,
        truth=truth,
        found=found,
        matches=match(truth, found),
    )
