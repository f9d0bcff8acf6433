"""A local server that speaks OpenAI's chat protocol, and fails in the ways that servers fail."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, BinaryIO

Answer = Callable[[dict[str, Any], int], "Behaviour"]


@dataclass(frozen=True)
class Behaviour:
    """How one request is answered."""

    text: str = '{"class": "Normal"}'
    status: int = 200
    body: bytes | None = None
    """In place of a well-formed answer."""
    wait_s: float = 0.0
    hang_up: bool = False
    raw: Callable[[BinaryIO], object] | None = None
    """Writes the answer itself, headers included, until the client has gone."""


def dripping(first: bytes, piece: bytes, every_s: float = 0.02) -> Behaviour:
    """Some bytes at once, then a piece now and then, for ever."""

    def write(to: BinaryIO) -> None:
        to.write(first)
        while True:
            to.write(piece)
            time.sleep(every_s)

    return Behaviour(raw=write)


@dataclass
class ChatServer:
    """What the server was asked."""

    url: str
    requests: list[dict[str, Any]] = field(default_factory=list)
    keys: list[str] = field(default_factory=list)


@contextmanager
def chat_server(answer: Answer) -> Iterator[ChatServer]:
    """A server for the length of a test; ``answer`` gets the request and the number of requests before it."""
    lock = threading.Lock()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            content = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            with lock:
                number = len(seen.requests)
                seen.requests.append(content)
                seen.keys.append(self.headers.get("Authorization", ""))
            behaviour = answer(content, number)
            time.sleep(behaviour.wait_s)
            if behaviour.hang_up:
                self.close_connection = True
                return
            if behaviour.raw is not None:
                self.close_connection = True
                with suppress(OSError):
                    behaviour.raw(self.wfile)
                return
            body = behaviour.body
            if body is None:
                message = {"role": "assistant", "content": behaviour.text}
                choice = {"index": 0, "message": message, "finish_reason": "stop"}
                usage = {"prompt_tokens": 1000, "completion_tokens": 20, "total_tokens": 1020}
                reply = {"id": "1", "object": "chat.completion", "created": 1, "model": content["model"]}
                body = json.dumps({**reply, "choices": [choice], "usage": usage}).encode()
            self.send_response(behaviour.status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(body)))
            self.send_header("retry-after-ms", "10")
            self.end_headers()
            with suppress(OSError):  # a client that has heard enough
                self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Not into the test's output."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    seen = ChatServer(f"http://127.0.0.1:{server.server_address[1]}/v1")
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield seen
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
