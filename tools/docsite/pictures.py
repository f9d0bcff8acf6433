"""Pictures and films of the documents, from a study with episodes of every template.

``tools/site_pictures.sh`` makes the episodes and calls this.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from PIL import Image

from docsite.sensor_pictures import draw_sensors
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.evaluation.yielding.encounters import EmvLine, YieldThresholds
from siren_ros.scoring.evaluation.yielding.metrics import site_time_s
from siren_ros.scoring.judging.outcome import evaluate_predicate
from siren_ros.scoring.pictures.birdseye import save_episode_picture
from siren_ros.scoring.pictures.video import FRAME_RATE_HZ, Coding, View, save_video

WIDTH_PX: Final = 1300
QUALITY: Final = 72
"""WebP's; text stays sharp."""
FILM: Final = Coding(width_px=800, crf=33)
FILM_S: Final = 26.0
AFTER_SITE_S: Final = 7.0
"""How long a film goes on after the EMV is at the middle of its site."""


def film_start_s(site_time: float | None, duration_s: float) -> float:
    """When a film begins, so that it shows the EMV's way to its site and what comes after, whole seconds.

    Args:
        site_time: When the EMV is at the middle of its site; None where it does not get there.
        duration_s: Of the episode.
    """
    end = duration_s if site_time is None else min(site_time + AFTER_SITE_S, duration_s)
    return float(max(0, round(end - FILM_S)))


def save_picture(record: EpisodeRecord, path: Path) -> None:
    """The picture of ``siren plot``, small enough for a page.

    Args:
        record: The episode.
        path: WebP file to write.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    drawn = path.with_suffix(".png")
    save_episode_picture(record, drawn)
    with Image.open(drawn) as picture:
        size = (WIDTH_PX, round(picture.height * WIDTH_PX / picture.width))
        small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    small.save(path, quality=QUALITY, method=6)
    drawn.unlink()


def save_film(bag: Path, record: EpisodeRecord, path: Path) -> None:
    """The film of an episode from above, on its way to the site and after it.

    Args:
        bag: Folder of the episode.
        record: Its content.
        path: MP4 file to write.
    """
    line = EmvLine.of(record)
    at_site = None if line is None else site_time_s(record, line, YieldThresholds())
    site_time = at_site.value if at_site is not None and at_site.valid else None
    start_s = film_start_s(site_time, record.description.duration_s)
    frames = round(min(FILM_S, record.description.duration_s - start_s) * FRAME_RATE_HZ)
    save_video(bag, View.BIRDSEYE, path, frames, start_s, FILM)


def main(argv: Sequence[str] | None = None) -> None:
    """Shows each template by its first episode whose predicate holds; with S1 and S2 also what sensors see in them."""
    line = argparse.ArgumentParser(description=__doc__)
    line.add_argument("study", type=Path, help="folder that siren generate made")
    line.add_argument("docs", type=Path, help="folder of the documents")
    arguments = line.parse_args(argv)
    shown: dict[str, Path] = {}
    for metadata in sorted(arguments.study.glob("episodes/*/*/metadata.yaml")):
        record = read_episode(metadata.parent)
        name = record.description.template
        if name in shown or not evaluate_predicate(record).holds:
            continue
        shown[name] = metadata.parent
        save_picture(record, arguments.docs / "templates" / "pictures" / f"{name}.webp")
        save_film(metadata.parent, record, arguments.docs / "templates" / "films" / f"{name}.mp4")
    if {"S1", "S2"} <= set(shown):
        draw_sensors(shown["S1"], shown["S2"], arguments.docs / "images")


if __name__ == "__main__":
    main()
