"""The client against a real HTTP server that answers, refuses, hangs up and talks nonsense."""

import gzip
import json
from base64 import b64decode
from importlib.util import find_spec
from typing import Any

import pytest
from evaluation.risk.vlm.chat_server import Behaviour, chat_server, dripping

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.vlm.clients import NO_KEY, OpenAiServer, key_from, reply_in
from siren_ros.scoring.evaluation.risk.vlm.pipeline import MOST_REPLY_BYTES, ModelUnavailableError, Question

pytestmark = pytest.mark.skipif(find_spec("openai") is None, reason="the extra vlm is not installed")
ASKED = Question("You judge.", "Which class?", (b"first", b"second"))
KEY = "a-secret-key"


def test_what_is_sent_and_what_comes_back() -> None:
    with chat_server(lambda _, __: Behaviour("text")) as server:
        reply = OpenAiServer(server.url, "m", KEY, 10.0, 0).answer(ASKED)
    assert (reply.text, reply.prompt_tokens, reply.completion_tokens) == ("text", 1000, 20)
    (request,) = server.requests
    assert (request["model"], request["temperature"]) == ("m", 0.0)
    system, user = request["messages"]
    assert system == {"role": "system", "content": "You judge."}
    assert user["content"][0] == {"type": "text", "text": "Which class?"}
    urls = [part["image_url"]["url"] for part in user["content"][1:]]
    assert [b64decode(url.removeprefix("data:image/jpeg;base64,")) for url in urls] == [b"first", b"second"]
    assert server.keys == [f"Bearer {KEY}"]


@pytest.mark.parametrize(
    "fault", [Behaviour(status=429), Behaviour(status=500), Behaviour(status=503), Behaviour(hang_up=True)]
)
def test_faults_that_pass_are_tried_again(fault: Behaviour) -> None:
    with chat_server(lambda _, number: fault if number < 2 else Behaviour("there")) as server:
        assert OpenAiServer(server.url, "m", KEY, 10.0, 3).answer(ASKED).text == "there"
    assert len(server.requests) == 3


def unavailable(fault: Behaviour, said: str, timeout_s: float = 60.0, retries: int = 0) -> tuple[str, int]:
    """The message of a question that got no answer, and how often it was sent."""
    with chat_server(lambda _, __: fault) as server, pytest.raises(ModelUnavailableError, match=said) as caught:
        OpenAiServer(server.url, "m", KEY, timeout_s, retries).answer(ASKED)
    return str(caught.value), len(server.requests)


def test_a_server_that_is_too_slow_and_one_that_is_gone() -> None:
    assert unavailable(Behaviour(wait_s=0.6), "Timeout", 0.2, 1)[1] == 2
    with chat_server(lambda _, __: Behaviour()) as server:
        url = server.url
    with pytest.raises(ModelUnavailableError, match="Connection"):
        OpenAiServer(url, "m", KEY, 2.0, 0).answer(ASKED)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (Behaviour(status=401), "401"),
        (Behaviour(status=429), "429"),
        (Behaviour(body=b"<html>a proxy</html>"), "m: "),
        (Behaviour(body=b'{"choices": []}'), "not of the protocol"),
        (Behaviour(body=b'{"choices": [{"mess'), "m: "),
    ],
)
def test_faults_that_stay_are_told_without_the_key(fault: Behaviour, said: str) -> None:
    assert KEY not in unavailable(fault, said, 10.0, 1)[0]


def body_of(content: Any = "text", usage: Any = None) -> bytes:
    return json.dumps({"choices": [{"message": {"content": content}}], "usage": usage}).encode()


@pytest.mark.parametrize(
    ("content", "usage", "told"),
    [
        ("text", None, ("text", 0, 0)),
        (None, {}, ("", 0, 0)),
        ([], {"prompt_tokens": None, "completion_tokens": 3}, ("", 0, 3)),
        ([{"type": "text", "text": "a"}, {"type": "thinking"}, {"type": "text", "text": "b"}], None, ("ab", 0, 0)),
        ("half a character \ud800", {"prompt_tokens": 5, "more": "x"}, ("half a character \ud800", 5, 0)),
    ],
)
def test_the_words_of_a_message_and_its_tokens(content: Any, usage: Any, told: tuple[str, int, int]) -> None:
    """Tokens that are not told are none."""
    reply = reply_in(body_of(content, usage), 1.0)
    assert (reply.text, reply.prompt_tokens, reply.completion_tokens) == told


BAD_BODIES = {
    "no choices": b'{"choices": null}',
    "a choice of null": b'{"choices": [null]}',
    "no message": b'{"choices": [{}]}',
    "content of numbers": body_of(5),
    "a part of text": body_of(["text"]),
    "tokens of text": body_of(usage={"prompt_tokens": "12"}),
    "tokens below 0": body_of(usage={"completion_tokens": -1}),
    "tokens of truth": body_of(usage={"prompt_tokens": True}),
    "NaN tokens": body_of(usage={"prompt_tokens": float("nan")}),
    "tokens of 5000 digits": body_of(usage={"prompt_tokens": 7}).replace(b": 7", b": " + b"7" * 5000),
    "a list": b"[]",
    "nothing": b"",
    "deep": b'{"choices":' * 200_000,
    "packed": gzip.compress(body_of()),
    "long": body_of("x" * MOST_REPLY_BYTES),
}


@pytest.mark.parametrize("body", BAD_BODIES.values(), ids=BAD_BODIES)
def test_what_is_not_of_the_protocol_is_no_answer(body: bytes) -> None:
    message, _ = unavailable(Behaviour(body=body), "m: the server's answer is not of the protocol: ")
    assert "\n" not in message
    assert len(message) < 150


HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"


@pytest.mark.parametrize(
    "slow",
    [
        dripping(HEAD + b"Content-Length: 100000\r\n\r\n", b" "),
        dripping(HEAD + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\n \r\n"),
        dripping(HEAD + b"X-Long: ", b"x"),
        dripping(b"", b"HTTP/1.1 100 Continue\r\n\r\n"),
    ],
    ids=["body", "chunks", "head", "continue"],
)
def test_the_whole_reply_has_a_deadline(slow: Behaviour) -> None:
    unavailable(slow, "Timeout", 0.5)


def test_a_reply_without_end_is_not_read_to_its_end() -> None:
    endless = dripping(HEAD + b"Transfer-Encoding: chunked\r\n\r\n", b"10000\r\n" + b" " * 65536 + b"\r\n", 0.0)
    unavailable(endless, f"more than {MOST_REPLY_BYTES} bytes")


def test_what_cannot_be_sent_is_refused() -> None:
    for url in ("localhost:8000", "", "http://", "http://[::1", "ftp://a/v1", "http://a\nb"):
        with pytest.raises(InputError, match="base-url"):
            OpenAiServer(url, "m", KEY, 2.0, 0)
    for timeout_s in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="timeout-s"):
            OpenAiServer("http://localhost/v1", "m", KEY, timeout_s, 0)
    with pytest.raises(InputError, match="model"):
        OpenAiServer("http://localhost/v1", "m\udcff", KEY, 1.0, 0)
    for key in ("a-secret\n", "a-secret-\u00e4"):
        with pytest.raises(InputError, match="api-key-env") as caught:
            OpenAiServer("http://localhost/v1", "m", key, 1.0, 0)
        assert "a-secret" not in str(caught.value)


def test_the_key_comes_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOME_KEY", KEY)
    assert key_from("SOME_KEY") == KEY
    assert key_from("") == NO_KEY
    with pytest.raises(InputError, match="NOT_SET"):
        key_from("NOT_SET")
