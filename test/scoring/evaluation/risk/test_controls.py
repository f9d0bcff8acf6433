from dataclasses import dataclass, field

import numpy as np

from siren_ros.scoring.evaluation.risk import controls as controls_module
from siren_ros.scoring.evaluation.risk.controls import CHANGES, Control, sequence_answers
from siren_ros.scoring.evaluation.risk.sequence_model import load_sequence_model
from siren_ros.scoring.evaluation.risk.vlm.pipeline import questions_about

PICTURES = [np.full((4, 6, 3), value, dtype=np.uint8) for value in range(9)]


def shown(control, key="S4_000"):
    return [int(picture[0, 0, 0]) for picture in CHANGES[control](PICTURES, key)]


def test_what_is_taken_away():
    assert shown(Control.BLANK) == [128] * 9
    assert shown(Control.ONE_FRAME) == [4] * 9
    assert sorted(shown(Control.SHUFFLED)) == list(range(9)) != shown(Control.SHUFFLED)
    assert shown(Control.SHUFFLED) == shown(Control.SHUFFLED)
    assert shown(Control.SHUFFLED) != shown(Control.SHUFFLED, "S4_001")
    assert Control.TEXT_ONLY not in CHANGES


def test_questions_keep_their_text(drawn):
    video = drawn.videos["S4_002"]

    def asked(control):
        return questions_about(drawn.folder, video, marked=False, control=control)

    plain = asked(None)
    for control in (Control.BLANK, Control.SHUFFLED):
        changed = asked(control)
        assert [one.text for one in changed] == [one.text for one in plain]
        assert [len(one.pictures) for one in changed] == [8, 1]
    assert asked(Control.BLANK)[0].pictures != plain[0].pictures
    (single,) = asked(Control.ONE_FRAME)
    assert single.pictures == (plain[0].pictures[4],)
    assert "9.4 s" in single.text
    assert [(one.text, one.pictures) for one in asked(Control.TEXT_ONLY)] == [(one.text, ()) for one in plain]


@dataclass
class _Brightest:
    """Answers by the mean of all pictures, and notes the order of what it saw."""

    seen: list = field(default_factory=list)

    def answer(self, frames):
        self.seen.append(frames.copy())
        return int(frames.mean() > 100)


def test_the_sequence_model_sees_the_changed_film(drawn):
    model = _Brightest()
    answers = sequence_answers(drawn, model, [Control.BLANK])[Control.BLANK]
    assert set(answers) == set(drawn.videos)
    assert {int(film.min()) for film in model.seen} == {int(film.max()) for film in model.seen} == {128}
    assert {film.shape for film in model.seen} == {(95, 60, 160)}


def test_a_film_is_read_once_for_all_controls(drawn, monkeypatch):
    read, opened = controls_module.read_small_frames, []
    monkeypatch.setattr(
        controls_module, "read_small_frames", lambda path, *rest: opened.append(path) or read(path, *rest)
    )
    model = _Brightest()
    answers = sequence_answers(drawn, model, [Control.BLANK, Control.ONE_FRAME])
    assert {control: set(given) for control, given in answers.items()} == {key: set(drawn.videos) for key in answers}
    assert len(opened) == len(set(opened)) == len(drawn.videos)
    assert all((film == film[0]).all() for film in model.seen)
    assert sequence_answers(drawn, model, []) == {}


def test_the_shipped_model_answers_blank_films_all_alike(drawn):
    answers = sequence_answers(drawn, load_sequence_model(), [Control.BLANK])[Control.BLANK]
    assert len(set(answers.values())) == 1
