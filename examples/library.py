"""The library from Python: makes an episode, then reads, judges, scores and exports it (docs/library.md)."""

from pathlib import Path

import siren_ros
from siren_ros import EpisodeRequest, export, iterate_frames, iterate_samples, judge, make_episode, read_record, verify


def main() -> None:
    """Make an episode, then read, judge, score and export it."""
    bag = Path("bag")
    made = make_episode(EpisodeRequest(template="S2", seed=3, sensors="lidar", duration_s=12.0), bag)
    record = read_record(bag)
    print(made.outcome.end, record.steps, judge(record).text)
    print(sum(part.holds for part in verify(record).checks), "checks hold")
    print(
        sum(1 for _ in iterate_frames(bag)),
        "frames,",
        sum(len(samples) for samples in iterate_samples([bag])),
        "samples",
    )
    table = siren_ros.score_predictions([bag], ["cv", "idm", "siren"])
    print({model: table.value(model, "S2", "ade_m") for model in table.models})
    print(export("kitti", [bag], Path("kitti_from_python"), {"layout": "paper"}, processes=1).card["counts"])


if __name__ == "__main__":
    main()
