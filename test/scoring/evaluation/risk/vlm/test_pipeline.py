"""Questions to a model of the test about a set, replies that are kept, and classes in what a model says."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.made_video_sets import small_video_set
from hypothesis import example, given, settings
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import RiskClass, risk_class
from siren_ros.scoring.evaluation.risk.video_set import VideoSet
from siren_ros.scoring.evaluation.risk.vlm.pipeline import (
    DEEPEST,
    MOST_REPLY_BYTES,
    ModelUnavailableError,
    Question,
    Reply,
    ReplyCache,
    VideoAnswer,
    account,
    as_jpeg,
    ask_about_all,
    class_in,
    final_class,
    masks_of,
    numbers_of,
    outlined,
    questions_about,
    video_frames,
    write_answers,
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


def test_numbers_by_size_without_specks() -> None:
    mask = np.zeros((50, 60), np.uint32)
    mask[5:25, 5:25], mask[30:45, 30:50], mask[0, 0] = 17, 12, 9
    assert numbers_of([mask, mask]) == {17: 1, 12: 2}


def test_contours_are_drawn_around_vehicles_alone_in_the_colour_of_their_number() -> None:
    """The seventh number has the colour of the first."""
    mask = np.zeros((80, 320), np.uint32)
    for number in range(8):
        mask[40:70, 40 * number : 40 * number + 30] = 11 + number
    picture = np.full((80, 320, 3), 128, np.uint8)
    drawn = outlined(picture, mask, {11 + number: number + 1 for number in range(8)})
    edges = [tuple(drawn[68, 40 * number + 10].tolist()) for number in range(8)]
    assert edges[0] == (230, 60, 40), "red"
    assert len(set(edges[:6])) == 6
    assert edges[6:] == edges[:2]
    changed = (drawn != picture).any(axis=2)
    assert changed[40:70, 0:2].all()
    assert not changed[45:65, 5:25].any()
    assert not changed[45:80, 33:38].any()
    assert (outlined(picture, mask, {}) == picture).all()
    assert as_jpeg(drawn) == as_jpeg(drawn)


def test_masks_are_read_back(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    mask = np.arange(12, dtype=np.uint32).reshape(3, 4)
    np.savez_compressed(path, frame_007=mask)
    assert (masks_of(path, (7,))[0] == mask).all()
    for wanted, file in (((8,), path), ((7,), tmp_path / "none.npz")):
        with pytest.raises(InputError, match="masks"):
            masks_of(file, wanted)


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
    assert first.text.startswith("8 pictures, taken at 0.0, 0.2, 0.4")
    assert last.text.startswith("One picture, taken at 1.9 s of the same drive")
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


def test_a_video_of_another_length_is_named(videos: VideoSet, tmp_path: Path) -> None:
    wrong = replace(videos, videos={"S4_000": replace(videos.videos["S4_000"], frames=30)})
    with pytest.raises(InputError, match=r"S4_000\.mp4: 20 frames"):
        ask(wrong, Scripted(), tmp_path / "replies")


def test_questions_tokens_time_and_cost_are_summed() -> None:
    """Nothing is said of times and prices that are not known."""
    replies = Reply("x", 1000, 10, 1.0), Reply("y", 500, 20, 3.0)
    answers = [
        VideoAnswer("a", (RiskClass.NORMAL, None), replies, 1),
        VideoAnswer("b", (RiskClass.NORMAL,), (Reply("z", 1500, 30, 2.0),), 0),
    ]
    (line,) = account("m", answers, (400.0, 10_000.0))
    assert line == (
        "m: 3 questions, 1 of them answered before, 1 answers unreadable; 3000 tokens in, 60 out, cost 1.80; "
        "2.00 s for an answer (median), 2.90 s at the 95th percentile"
    )
    (line,) = account("m", [VideoAnswer("a", (RiskClass.NORMAL,), (Reply("x"),), 0)], None)
    assert line.endswith("; 0 tokens in, 0 out")


ASKED = Question("system", "text", (b"first", b"second"))
REPLY = Reply("Normal", 3, 5, 0.5)


def test_a_reply_comes_back_for_the_same_question(tmp_path: Path) -> None:
    ReplyCache(tmp_path / "deep" / "cache").put("model", ASKED, REPLY)
    assert ReplyCache(tmp_path / "deep" / "cache").get("model", ASKED) == REPLY


def test_other_models_words_and_pictures_are_other_questions(tmp_path: Path) -> None:
    cache = ReplyCache(tmp_path)
    cache.put("model", ASKED, REPLY)
    others = [
        ("model2", ASKED),
        ("model", replace(ASKED, system="system2")),
        ("model", replace(ASKED, text="text2")),
        ("model", replace(ASKED, system="systemt", text="ext")),
        ("model", replace(ASKED, pictures=(b"first",))),
        ("model", replace(ASKED, pictures=(b"second", b"first"))),
        ("model", replace(ASKED, pictures=(b"firsts", b"econd"))),
    ]
    assert [cache.get(*other) for other in others] == [None] * len(others)


SIZE = 100_000
KEPT = '{"text": "Normal", "prompt_tokens": 3, "completion_tokens": 5, "seconds": 0.5}'
DAMAGED = [
    *("", "{", "[]", '{"text": "a", "unknown": 1}', "[" * 200_000, "null", '"Normal"'),
    KEPT.replace('"Normal"', '[{"type": "text", "text": "Normal"}]'),
    KEPT.replace("3", '"3"'),
    KEPT.replace("3", "-3"),
    KEPT.replace("5,", "1e400,"),
    KEPT.replace("0.5", "NaN"),
    KEPT.replace("0.5", '"0.5"'),
    KEPT.replace("0.5", "1e400"),
    '{"text": "Normal"}',
]


def test_a_damaged_reply_is_none_and_is_replaced(tmp_path: Path) -> None:
    cache = ReplyCache(tmp_path)
    cache.put("model", ASKED, REPLY)
    (file,) = tmp_path.iterdir()
    for text in DAMAGED:
        file.write_text(text, encoding="utf-8")
        assert cache.get("model", ASKED) is None
    cache.put("model", ASKED, REPLY)
    assert cache.get("model", ASKED) == REPLY
    assert json.loads(file.read_text(encoding="utf-8")) == json.loads(KEPT)


def test_the_longest_reply_and_half_characters_come_back(tmp_path: Path) -> None:
    cache = ReplyCache(tmp_path)
    for text in ("\x00" * MOST_REPLY_BYTES, "a\ud800b\udfff\u2028"):
        cache.put("model", ASKED, replace(REPLY, text=text))
        assert cache.get("model", ASKED) == replace(REPLY, text=text)


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cache: "):
        ReplyCache(tmp_path / "file" / "replies").put("model", ASKED, REPLY)


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("text", "risk"),
    [
        ('{"class": "Near-Miss", "reason": "hard braking"}', RiskClass.NEAR_MISS),
        ('```json\n{"class": "normal"}\n```', RiskClass.NORMAL),
        ('{might} {"class": "Normal"}, but no: {"reason": "they touch", "class": "Collision"}.', RiskClass.COLLISION),
        ('{"class": "Normal", "more": {"class": "Collision"}}', RiskClass.NORMAL),
        ("{" * SIZE + '{"class": "Normal", "length": ' + "9" * SIZE + "}", RiskClass.NORMAL),
        *((text, None) for text in ("", "Normal", "The class is Collision.", "[1]", '{"class": "Nor')),
        *((text, None) for text in ('{"class": "Normal or Near-Miss"}', '{"class": 2}', "{" * 3_000_000)),
        # Each place of these is looked at a few times alone: to look at the rest from every place takes hours.
        *(
            (text, None)
            for text in ('{"' * SIZE, '{"a":"' * SIZE, '{"class":' * SIZE, ('{"a":' * DEEPEST + "x") * 1_000)
        ),
        ('{"a":' * (DEEPEST - 1) + '{"a":[' + "0," * SIZE, None),
    ],
    ids=lambda value: str(value)[:12],
)
def test_the_last_object_with_a_class_counts_and_nothing_is_guessed(text: str, risk: RiskClass | None) -> None:
    assert class_in(text) is risk


def test_the_more_severe_prediction_is_the_videos() -> None:
    assert final_class([RiskClass.NORMAL, RiskClass.NEAR_MISS]) is RiskClass.NEAR_MISS
    assert final_class([None, RiskClass.NORMAL]) is RiskClass.NORMAL
    assert final_class([None, None]) is None


def class_by_trying(text: str) -> RiskClass | None:
    """The same by trying Python's own reader at each brace: exact, and slow in long texts."""
    found, place = None, text.find("{")
    while place >= 0:
        try:
            content, end = json.JSONDecoder().raw_decode(text, place)
        except ValueError:
            end = place + 1
        else:
            found = content["class"] if isinstance(content.get("class"), str) else found
        place = text.find("{", end)
    try:
        return None if found is None else risk_class(found)
    except InputError:
        return None


PIECES = [
    '"class"',
    '"Normal"',
    '"Collision"',
    *'{}[],: \t\n"\\',
    "1",
    "-0.5e+3",
    "01",
    "null",
    "NaN",
    '"\\u0041"',
    "x",
]
objects = st.recursive(
    st.sampled_from(["Normal", "Near-Miss", 1, None, 'a "quoted" {', float("inf")]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["class", "a", "{"]), inner, max_size=3)
    ),
    max_leaves=8,
).map(json.dumps)


@settings(max_examples=100, deadline=None)
@given(text=st.lists(st.one_of(st.sampled_from(PIECES), objects), max_size=12).map("".join))
@example('{"a" {"class": "Normal"} "}')
@example('{"a": {"class": "Normal"}, b')
@example('{"a": [{"class": "Normal"}, {"class": "Collision"} {')
@example('{x {"a{": {"class": "Normal"}}')
def test_any_text_is_read_as_python_reads_it(text: str) -> None:
    assert class_in(text) is class_by_trying(text)


def test_objects_lie_no_deeper_in_each_other_than_allowed() -> None:
    deepest = '{"a":' * (DEEPEST - 1) + "{}" + "}" * (DEEPEST - 1)
    answer = '{"class": "Normal"}'
    assert class_in(answer + deepest) is RiskClass.NORMAL
    assert class_in(answer + '{"a":' + deepest + "}") is None
