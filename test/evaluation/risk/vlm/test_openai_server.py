"""The client against a real HTTP server that answers, refuses, hangs up and talks nonsense."""

from base64 import b64decode

import pytest
from evaluation.risk.vlm.chat_server import Behaviour, chat_server

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.vlm.model import ModelUnavailableError, Question
from siren_ros.evaluation.risk.vlm.openai_server import NO_KEY, OpenAiServer, key_from

pytest.importorskip("openai", reason="the extra vlm is not installed")
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


def test_a_server_that_is_too_slow() -> None:
    with (
        chat_server(lambda _, __: Behaviour(wait_s=0.6)) as server,
        pytest.raises(ModelUnavailableError, match="Timeout"),
    ):
        OpenAiServer(server.url, "m", KEY, 0.2, 1).answer(ASKED)
    assert len(server.requests) == 2


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (Behaviour(status=401), "401"),
        (Behaviour(status=404), "404"),
        (Behaviour(status=429), "429"),
        (Behaviour(body=b"<html>a proxy</html>"), "m: "),
        (Behaviour(body=b'{"choices": []}'), "not of the protocol"),
        (Behaviour(body=b'{"choices": [{"mess'), "m: "),
    ],
)
def test_faults_that_stay_are_told_without_the_key(fault: Behaviour, said: str) -> None:
    with chat_server(lambda _, __: fault) as server, pytest.raises(ModelUnavailableError, match=said) as caught:
        OpenAiServer(server.url, "m", KEY, 10.0, 1).answer(ASKED)
    assert KEY not in str(caught.value)


def test_nobody_listens() -> None:
    with chat_server(lambda _, __: Behaviour()) as server:
        url = server.url
    with pytest.raises(ModelUnavailableError, match="Connection"):
        OpenAiServer(url, "m", KEY, 2.0, 0).answer(ASKED)


def test_the_key_comes_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOME_KEY", KEY)
    assert key_from("SOME_KEY") == KEY
    assert key_from("") == NO_KEY
    with pytest.raises(InputError, match="NOT_SET"):
        key_from("NOT_SET")
