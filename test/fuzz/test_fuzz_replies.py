"""Replies of servers from strangers: any JSON gives an answer or one line, and leaves nothing that breaks the set."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.scoring.evaluation.risk.vlm.clients import reply_in
from siren_ros.scoring.evaluation.risk.vlm.pipeline import Question, Reply, ReplyCache, class_in

ASKED = Question("You judge.", "Which class?", (b"picture",))
GOOD = {
    "id": "1",
    "choices": [{"index": 0, "message": {"role": "assistant", "content": '{"class": "Normal"}'}}],
    "usage": {"prompt_tokens": 10, "completion_tokens": 2},
}
NAMES = ("choices", "message", "content", "usage", "prompt_tokens", "completion_tokens", "type", "text", "class")
texts = st.one_of(st.text(max_size=8), st.sampled_from(["text", '{"class": "Collision"}', '{"class":' * 30, "\ud800"]))
leaves = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), texts)
anything = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(NAMES), inner, max_size=4),
    max_leaves=10,
)


@st.composite
def changed(draw, content=GOOD):
    """The good reply with something else at one place inside."""
    if not isinstance(content, dict | list) or not content or not draw(st.integers(0, 4)):
        return draw(anything)
    if isinstance(content, list):
        return [draw(changed(content[0])), *content[1:]]
    name = draw(st.sampled_from(sorted(content)))
    return {**content, name: draw(changed(content[name]))}


bodies = st.one_of(anything, changed()).map(lambda content: json.dumps(content).encode()) | st.binary(max_size=60)


@settings(max_examples=80, deadline=None)
@given(body=bodies)
def test_any_reply_can_be_kept_or_is_refused_in_one_line(body):
    try:
        reply = reply_in(body, 0.5)
    except ValueError as error:
        assert "\n" not in str(error)  # noqa: PT017 - a result and an error are both allowed
        return
    class_in(reply.text)
    with TemporaryDirectory() as folder:
        ReplyCache(Path(folder)).put("m", ASKED, reply)
        assert ReplyCache(Path(folder)).get("m", ASKED) == reply


@settings(max_examples=80, deadline=None)
@given(content=anything | st.fixed_dictionaries(dict.fromkeys(Reply.__dataclass_fields__, leaves)))
def test_any_file_of_the_cache_is_a_reply_or_asked_again(content):
    with TemporaryDirectory() as folder:
        cache = ReplyCache(Path(folder))
        cache.put("m", ASKED, Reply("Normal"))
        next(Path(folder).iterdir()).write_text(json.dumps(content), encoding="utf-8")
        reply = cache.get("m", ASKED)
        if reply is not None:
            assert isinstance(reply.text, str)
            assert reply.prompt_tokens + reply.completion_tokens >= 0
            assert reply.seconds >= 0.0
