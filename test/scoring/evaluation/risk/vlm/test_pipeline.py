"""Questions about the videos of a set, answers through the cache, and runs that are interrupted."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.made_video_sets import small_video_set

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import RiskClass
from siren_ros.scoring.evaluation.risk.video_set import VideoSet, batches, key_frames
from siren_ros.scoring.evaluation.risk.vlm.model import ModelUnavailableError, Question, Reply, ReplyCache
from siren_ros.scoring.evaluation.risk.vlm.pipeline import (
    VideoAnswer,
    account,
    ask_about_all,
    questions_about,
    write_answers,
)
from siren_ros.scoring.evaluation.risk.vlm.question import (
    as_jpeg,
    masks_of,
    numbers_of,
    outlined,
    question,
    video_frames,
)
from siren_ros.scoring.pictures.video import write_video


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Twenty frames that become brighter."""
    path = tmp_path / "v.mp4"
    write_video(path, (np.full((64, 96, 3), 10 * number, np.uint8) for number in range(20)))
    return path


def test_the_wanted_frames_in_their_order(video: Path) -> None:
    first, last = video_frames(video, (3, 19), 20)
    assert first.shape == (64, 96, 3)
    assert first.mean() == pytest.approx(30.0, abs=3.0)
    assert last.mean() == pytest.approx(190.0, abs=3.0)


def test_another_length_or_no_video_is_refused(video: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="20 frames"):
        video_frames(video, (3,), 21)
    with pytest.raises(InputError, match=r"none\.mp4"):
        video_frames(tmp_path / "none.mp4", (3,), 20)
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"no video")
    with pytest.raises(InputError, match=r"broken\.mp4"):
        video_frames(broken, (3,), 20)


def test_numbers_by_size_without_specks() -> None:
    mask = np.zeros((50, 60), np.uint32)
    mask[5:25, 5:25], mask[30:45, 30:50], mask[0, 0] = 17, 12, 9
    assert numbers_of([mask, mask]) == {17: 1, 12: 2}


def test_contours_are_drawn_around_vehicles_alone() -> None:
    mask = np.zeros((80, 100), np.uint32)
    mask[30:70, 20:60] = 7
    picture = np.full((80, 100, 3), 128, np.uint8)
    drawn = outlined(picture, mask, {7: 1})
    changed = (drawn != picture).any(axis=2)
    assert changed[30:70, 20:22].all()
    assert changed[68:70, 20:60].all()
    assert not changed[35:65, 25:55].any()
    assert not changed[:, 70:].any()
    assert not (outlined(picture, mask, {}) != picture).any()
    assert as_jpeg(drawn) == as_jpeg(drawn)


def test_masks_are_read_back(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    mask = np.arange(12, dtype=np.uint32).reshape(3, 4)
    np.savez_compressed(path, frame_007=mask)
    assert (masks_of(path, (7,))[0] == mask).all()
    for wanted, file in (((8,), path), ((7,), tmp_path / "none.npz")):
        with pytest.raises(InputError, match="masks"):
            masks_of(file, wanted)


def test_each_number_has_its_colour_and_the_seventh_that_of_the_first() -> None:
    mask = np.zeros((80, 320), np.uint32)
    for number in range(8):
        mask[40:70, 40 * number : 40 * number + 30] = 11 + number
    drawn = outlined(np.full((80, 320, 3), 128, np.uint8), mask, {11 + number: number + 1 for number in range(8)})
    edges = [tuple(drawn[68, 40 * number + 10].tolist()) for number in range(8)]
    assert edges[0] == (230, 60, 40), "red"
    assert len(set(edges[:6])) == 6
    assert edges[6:] == edges[:2]


def test_the_number_stands_above_the_vehicle() -> None:
    """In a box of the contour's colour, around the middle of the columns; at the picture's edge it stays inside."""
    for top, place in ((50, slice(30, 50)), (0, slice(0, 18))):
        mask = np.zeros((100, 100), np.uint32)
        mask[top : top + 40, 30:71] = 5
        drawn = outlined(np.full((100, 100, 3), 128, np.uint8), mask, {5: 1})
        assert (drawn[place, 45:56] == (255, 255, 255)).all(axis=2).any(), "the number is white"
        assert (drawn[place, 40:60] == (230, 60, 40)).all(axis=2).any()


def test_specks_have_no_contour() -> None:
    mask = np.zeros((20, 20), np.uint32)
    mask[5:11, 5:11] = 4
    picture = np.full((20, 20, 3), 128, np.uint8)
    assert (outlined(picture, mask, {4: 1}) == picture).all(), "36 pixels"
    mask[5:11, 11] = 4
    assert (outlined(picture, mask, {4: 1}) != picture).any(), "42 pixels"


def test_times_are_tenths_of_the_frames_numbers() -> None:
    first, last = batches(key_frames(190))
    asked = question(first, marked=False)
    assert asked.startswith("8 pictures, taken at 0.0, 2.3, 4.7, 7.0, 9.4, 11.8, 14.1, 16.5 s of the same drive")
    assert question(last, marked=False).startswith("One picture, taken at 18.9 s of the same drive")


def test_outlines_are_explained_where_there_are_some() -> None:
    assert "outlined" in question((0, 10), marked=True)
    assert "outlined" not in question((0, 10), marked=False)


FRAMES = 20


@dataclass
class Scripted:
    """Answers by the number of pictures; fails at some questions."""

    of_eight: str = '{"class": "Normal"}'
    of_one: str = '{"class": "Near-Miss"}'
    fails_from: int = 1_000
    asked: list[Question] = field(default_factory=list)
    name: str = "scripted"

    def answer(self, question: Question) -> Reply:
        self.asked.append(question)
        if len(self.asked) > self.fails_from:
            raise ModelUnavailableError("no more")
        return Reply(self.of_eight if len(question.pictures) > 1 else self.of_one, 10, 2)


@pytest.fixture
def videos(tmp_path: Path) -> VideoSet:
    """Two short videos with masks."""
    small = small_video_set(tmp_path)
    kept = {key: replace(small.videos[key], frames=FRAMES) for key in ("S4_000", "S6_005")}
    tmp_path.joinpath("masks").mkdir()
    for place, (key, video) in enumerate(kept.items()):
        shades = (np.full((48, 64, 3), 5 * number + 60 * place, np.uint8) for number in range(FRAMES))
        write_video(tmp_path / video.file, shades)
        mask = np.zeros((48, 64), np.uint32)
        mask[10:30, 10:40] = 3
        frames = [19 * number // 8 for number in range(9)]
        np.savez_compressed(tmp_path / "masks" / f"{key}.npz", **{f"frame_{one:03d}": mask for one in frames})
    return replace(small, videos=kept)


def ask(
    videos: VideoSet, model: Scripted, folder: Path, *, marked: bool = True
) -> dict[str, tuple[RiskClass | None, int]]:
    answers = ask_about_all(videos, model, ReplyCache(folder), marked=marked, concurrency=1)
    return {key: (answer.final, answer.cached) for key, answer in answers.items()}


def test_eight_pictures_and_one(videos: VideoSet) -> None:
    video = videos.videos["S4_000"]
    first, last = questions_about(videos.folder, video, marked=True)
    assert (len(first.pictures), len(last.pictures)) == (8, 1)
    assert "0.0, 0.2, 0.4" in first.text
    assert "outlined" in first.text
    plain, _ = questions_about(videos.folder, video, marked=False)
    assert "outlined" not in plain.text
    assert plain.pictures != first.pictures
    assert questions_about(videos.folder, video, marked=True)[0] == first


def test_the_more_severe_of_two_and_nothing_is_asked_twice(videos: VideoSet, tmp_path: Path) -> None:
    model, cache = Scripted(), tmp_path / "replies"
    assert ask(videos, model, cache) == dict.fromkeys(videos.videos, (RiskClass.NEAR_MISS, 0))
    assert ask(videos, model, cache) == dict.fromkeys(videos.videos, (RiskClass.NEAR_MISS, 2))
    assert len(model.asked) == 4
    ask(videos, model, cache, marked=False)
    ask(videos, replace(model, name="another", asked=model.asked), cache)
    assert len(model.asked) == 12


def test_answers_that_cannot_be_read_are_counted(videos: VideoSet, tmp_path: Path) -> None:
    half = ask(videos, Scripted(of_one="well"), tmp_path / "a")
    assert {final for final, _ in half.values()} == {RiskClass.NORMAL}
    answers = ask_about_all(videos, Scripted("a", "b"), ReplyCache(tmp_path / "b"), marked=True, concurrency=2)
    write_answers(tmp_path / "answers.json", answers)
    assert json.loads(tmp_path.joinpath("answers.json").read_text()) == dict.fromkeys(videos.videos, "unreadable")


def test_an_interrupted_run_keeps_what_was_answered(videos: VideoSet, tmp_path: Path) -> None:
    cache = tmp_path / "replies"
    with pytest.raises(ModelUnavailableError):
        ask(videos, Scripted(fails_from=3), cache)
    later = Scripted()
    assert {key: cached for key, (_, cached) in ask(videos, later, cache).items()} == {"S4_000": 2, "S6_005": 1}
    assert len(later.asked) == 1


def test_a_damaged_reply_is_asked_again(videos: VideoSet, tmp_path: Path) -> None:
    model, cache = Scripted(), tmp_path / "replies"
    ask(videos, model, cache)
    next(cache.iterdir()).write_text('{"text": ')
    ask(videos, model, cache)
    assert len(model.asked) == 5


def test_a_video_of_another_length_is_named(videos: VideoSet, tmp_path: Path) -> None:
    wrong = replace(videos, videos={"S4_000": replace(videos.videos["S4_000"], frames=30)})
    with pytest.raises(InputError, match=r"S4_000\.mp4: 20 frames"):
        ask(wrong, Scripted(), tmp_path / "replies")


ANSWERS = [
    VideoAnswer("a", (RiskClass.NORMAL, None), (Reply("x", 1000, 10, 1.0), Reply("y", 500, 20, 3.0)), 1),
    VideoAnswer("b", (RiskClass.NORMAL,), (Reply("z", 1500, 30, 2.0),), 0),
]


def test_questions_tokens_time_and_cost_are_summed() -> None:
    (line,) = account("m", ANSWERS, (400.0, 10_000.0))
    assert line == (
        "m: 3 questions, 1 of them answered before, 1 answers unreadable; 3000 tokens in, 60 out, cost 1.80; "
        "2.00 s for an answer (median), 2.90 s at the 95th percentile"
    )


def test_nothing_is_said_of_times_and_prices_that_are_not_known() -> None:
    (line,) = account("m", [VideoAnswer("a", (RiskClass.NORMAL,), (Reply("x"),), 0)], None)
    assert line == "m: 1 questions, 0 of them answered before, 0 answers unreadable; 0 tokens in, 0 out"
