"""A round of 3-D detection from its making to its verification: public sensors without labels, and four submissions."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from recorded_episode import quick_template

from siren_ros.cli.main import main
from siren_ros.data.episode_source import open_source
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.boxes import from_ground_truth
from siren_ros.data.interfaces.measurements import from_point_cloud
from siren_ros.reports.round.board import publish_round, verify_round
from siren_ros.reports.round.detection import labelled_frames
from siren_ros.scoring.evaluation.detection.result_files import labels_as_detections, read_detections, write_nuscenes
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES, mean_ap_of_episodes

MADE = ["--seeds", "0", "--duration-s", "0.6", "--sensors", "lidar", "--workers", "1"]


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A round of one short episode, with a salt that is the same in each run."""
    folder = tmp_path_factory.mktemp("round") / "round"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("secrets.token_bytes", lambda count: bytes(range(count)))
        words = ["round", "make", str(folder), "--task", "detection", "--templates", quick_template("S2"), *MADE]
        assert main(words) == 0
    return folder


def test_participants_get_the_sensors_and_no_label(held: Path) -> None:
    public, private = held / "public", held / "private"
    words = [path.relative_to(public).as_posix() for path in public.rglob("*")]
    assert not [word for word in words if "S2" in word or "town" in word]
    with (
        open_source(public / "bags" / "episode001") as told,
        open_source(private / "bags" / "episode001") as whole,
    ):
        lidar = told.lidar
        assert lidar is not None
        assert not [name for name in told.bag.type_names if "boxes" in name or name.startswith("/siren/a")]
        assert {topics.ACTORS.name, topics.TRAFFIC.name, topics.OUTCOME.name}.isdisjoint(told.bag.type_names)
        asked = {lidar.topic, topics.GROUND_TRUTH.name}
        labels = 0
        for (step, seen), (same, known) in zip(
            told.messages_by_step(asked), whole.messages_by_step(asked), strict=True
        ):
            points, all_points = (from_point_cloud(held[lidar.topic].read()) for held in (seen, known))
            assert step == same
            assert (points["x"] == all_points["x"]).all()
            assert not points["instance"].any()
            assert all_points["instance"].any()
            if topics.GROUND_TRUTH.name in known:
                assert not len(from_ground_truth(seen[topics.GROUND_TRUTH.name].read()))
                labels += len(from_ground_truth(known[topics.GROUND_TRUTH.name].read()))
        assert labels


def test_a_round_ranks_detectors_refuses_what_is_broken_and_flags_who_knows(held: Path, tmp_path: Path) -> None:
    submissions = tmp_path / "submissions"
    submissions.mkdir()
    pillars = submissions / "pillars.json"
    assert main(["round", "answer", str(held / "public"), "--model", "pillars", "--out", str(pillars)]) == 0
    frames = labelled_frames(held / "public", held / "private" / "bags")
    labels = labels_as_detections(frames)
    write_nuscenes(submissions / "knows.json", labels, frames)
    write_nuscenes(submissions / "near.json", replace(labels, centre_m=labels.centre_m + 0.3), frames)
    content = json.loads(pillars.read_text())
    content["results"].popitem()
    (submissions / "broken.json").write_text(json.dumps(content))
    content["results"] = {**json.loads(pillars.read_text())["results"], "another": []}
    (submissions / "elsewhere.json").write_text(json.dumps(content))
    assert main(["round", "score", str(held), str(submissions), "--workers", "1"]) == 1
    board = json.loads((held / "scores" / "board.json").read_text())
    values = {row["model"]: row["value"] for row in board["rows"]}
    found = {name: read_detections(name, str(submissions / f"{name}.json"), frames) for name in ("pillars", "near")}
    assert values == {name: mean_ap_of_episodes(frames, one, VEHICLE_NAMES)[0] for name, one in found.items()}
    assert list(values.values()) == sorted(values.values(), reverse=True)
    assert "nearer than a LiDAR" in board["flagged"]["knows"]
    assert set(board["refused"]) == {"broken", "elsewhere"}
    published = tmp_path / "published"
    publish_round(held, published)
    kept = held / "public" / "round.json"
    assert verify_round(published, kept) == ()
    forged = json.loads((published / "answers" / "pillars.json").read_text())
    forged["results"] = {token: [] for token in forged["results"]}
    (published / "answers" / "pillars.json").write_text(json.dumps(forged))
    bag = next((published / "bags" / "episode001").glob("*.mcap"))
    bag.write_bytes(next((held / "private" / "bags" / "episode001").glob("*.mcap")).read_bytes())
    wrong = verify_round(published, kept)
    assert "episode001: the published bag is another one" in wrong
    assert "answers of board.json do not follow from the answers" in wrong
