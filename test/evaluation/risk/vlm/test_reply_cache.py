"""A reply is known again for the same model, words and pictures, and for no others."""

from dataclasses import replace
from pathlib import Path

from siren_ros.evaluation.risk.vlm.model import Question, Reply
from siren_ros.evaluation.risk.vlm.reply_cache import ReplyCache

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


def test_a_damaged_reply_is_none_and_is_replaced(tmp_path: Path) -> None:
    cache = ReplyCache(tmp_path)
    cache.put("model", ASKED, REPLY)
    (file,) = tmp_path.iterdir()
    for text in ("", "{", "[]", '{"text": "a", "unknown": 1}'):
        file.write_text(text, encoding="utf-8")
        assert cache.get("model", ASKED) is None
    cache.put("model", ASKED, REPLY)
    assert cache.get("model", ASKED) == REPLY
