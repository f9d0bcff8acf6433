"""A reply is known again for the same model, words and pictures, and for no others."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.vlm.model import MOST_REPLY_BYTES, Question, Reply, ReplyCache

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
