"""The front camera's view of a candidate, as MP4, and the instance masks of its key frames."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.evaluation.risk.key_frames import key_frames
from siren_ros.evaluation.risk.video_set import VIDEO_FRAMES
from siren_ros.pictures.video import write_video
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.sensors.rig.rig import SensorRig
from siren_ros.sensors.suite.look_file import load_look
from siren_ros.sensors.suite.suite import SensorSuite
from siren_ros.studies.risk_set.candidate import FRAME_STEPS, Candidate, front_camera

SEEN_PIXELS: Final = 60
"""From this many pixels on a vehicle is seen: about 10 by 6."""


@dataclass(frozen=True)
class Rendered:
    """What a video shows."""

    frames: int
    most_pixels: int
    """Of the vehicle that decided the label, in any frame up to the moment; 0 where there is none."""


def render_candidate(candidate: Candidate, record: EpisodeRecord, video: Path, masks: Path) -> Rendered:
    """Draws the window of a candidate.

    Args:
        candidate: What to draw.
        record: Its episode.
        video: MP4 file to write.
        masks: Compressed numpy file to write: for each key frame the actor of each pixel, 0 off vehicles, in an array
            ``frame_000`` of shape ``(height, width)``.
    """
    most, kept = [0], dict[str, npt.NDArray[np.uint32]]()
    wanted = set(key_frames(VIDEO_FRAMES))

    def frames() -> Iterator[npt.NDArray[np.uint8]]:
        for number, (rgb, actors, step) in enumerate(_pictures(candidate, record)):
            if candidate.label.actor_id and step <= candidate.label.step:
                most[0] = max(most[0], int(np.count_nonzero(actors == candidate.label.actor_id)))
            if number in wanted:
                kept[f"frame_{number:03d}"] = actors
            yield rgb

    count = write_video(video, frames())
    masks.parent.mkdir(parents=True, exist_ok=True)
    with masks.open("wb") as file:
        np.savez_compressed(file, **kept)
    return Rendered(count, most[0])


def _pictures(
    candidate: Candidate, record: EpisodeRecord
) -> Iterator[tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint32], int]]:
    """Colours, actors and step of each frame."""
    camera = replace(front_camera(), instance=True, rate_hz=10.0)
    suite = SensorSuite("risk", cameras=(camera,))
    rig = SensorRig(suite, record.network, record.description.seed, look=load_look(candidate.request.look))
    for row in range(candidate.first_step, candidate.first_step + VIDEO_FRAMES * FRAME_STEPS, FRAME_STEPS):
        seen = rig.observe(record.states[row], record.actors, record.traffic[row].signals, record.emv_ids[0])
        frame = seen.frames[0]
        actors = frame.image.instance
        if actors is None:
            raise AssertionError("a camera with instance labels made none")
        yield frame.rgb, actors.copy(), record.states[row].step
