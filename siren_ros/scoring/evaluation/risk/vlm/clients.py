"""The table of clients: each way to reach vision-language models, with its settings.

Models run in this process with Hugging Face transformers, from a folder on this machine, or behind a server that speaks
OpenAI's chat protocol: vLLM, llama.cpp, Ollama, hosted services. A new client is a file with a class of the protocol
``VisionLanguageModel`` and an entry here. The command line takes its options from the entries.
"""

import asyncio
import json
import math
import os
import time
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from threading import Lock
from typing import Any, Final

from PIL import Image

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.vlm.pipeline import (
    MOST_REPLY_BYTES,
    MOST_TOKENS,
    ModelUnavailableError,
    Question,
    Reply,
    VisionLanguageModel,
    checked_reply,
)

_PARTS: Final = "a folder with a vision-language model that transformers knows, its processor and its chat template"


class LocalModel:
    """A model of transformers' image-text-to-text class; it answers one question at a time."""

    def __init__(self, folder: Path, device: str, most_tokens: int = MOST_TOKENS) -> None:
        """Load the model. It uses no network and runs no code from the folder.

        ``huggingface-cli download NAME --local-dir FOLDER`` makes such a folder; a device is ``cpu`` or ``cuda``.

        Raises:
            InputError: transformers is not installed, or the folder holds no such model.
        """
        try:
            import transformers  # noqa: PLC0415 - an extra
        except ImportError as error:
            runs = "./env --with vlm-local siren evaluate risk …"
            raise InputError("local-model", str(folder), f"the library: run `{runs}`") from error
        if not (folder / "config.json").is_file():
            raise InputError("local-model", str(folder), _PARTS)
        try:
            # Remote code is off: transformers refuses models that need it.
            self._processor: Any = transformers.AutoProcessor.from_pretrained(folder, local_files_only=True)
            model: Any = transformers.AutoModelForImageTextToText.from_pretrained(
                folder, local_files_only=True, dtype="auto"
            )
            self._model = model.to(device).eval()
        except (OSError, ValueError, KeyError, ImportError, RuntimeError) as error:
            raise InputError("local-model", str(folder), f"{_PARTS} ({_first_line(error)})") from error
        if not getattr(self._processor, "chat_template", None):
            raise InputError("local-model", str(folder), f"{_PARTS} (no chat template)")
        self._folder, self._most_tokens, self._lock = folder, most_tokens, Lock()

    @property
    def name(self) -> str:
        """Implements ``VisionLanguageModel.name``: the folder's name."""
        return self._folder.resolve().name

    def answer(self, question: Question) -> Reply:
        """Implements ``VisionLanguageModel.answer``; decoding is greedy, which equals temperature 0."""
        images = [Image.open(BytesIO(picture)).convert("RGB") for picture in question.pictures]
        pictures = [{"type": "image", "image": image} for image in images]
        messages = [
            {"role": "system", "content": [{"type": "text", "text": question.system}]},
            {"role": "user", "content": [*pictures, {"type": "text", "text": question.text}]},
        ]
        with self._lock:
            begin = time.monotonic()
            try:
                inputs = self._processor.apply_chat_template(
                    messages, add_generation_prompt=True, tokenize=True, return_dict=True, return_tensors="pt"
                ).to(self._model.device, dtype=self._model.dtype)
                output = self._model.generate(**inputs, do_sample=False, max_new_tokens=self._most_tokens)
            except (RuntimeError, ValueError, TypeError, IndexError) as error:
                raise ModelUnavailableError(f"{self.name}: {type(error).__name__}: {_first_line(error)}") from error
            seconds = time.monotonic() - begin
        prompt = int(inputs["input_ids"].shape[1])
        answer = output[0, prompt:]
        text = self._processor.decode(answer, skip_special_tokens=True)
        return Reply(str(text), prompt, len(answer), seconds)


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [""])[0]


NO_KEY: Final = "none"
"""Key that is sent to servers that need none, because clients must send one."""


class OpenAiServer:
    """One model of one server."""

    def __init__(self, base_url: str, model: str, key: str, timeout_s: float, retries: int) -> None:
        """Prepare the client; nothing is sent yet.

        Args:
            base_url: Such as ``http://localhost:8000/v1``.
            model: The server's name for it.
            key: API key of the user; it is sent to the server and shown nowhere.
            timeout_s: Longest time of one request, from its first byte to the last byte of the reply.
            retries: Further attempts after 408, 409, 429, 5xx, time-outs and broken connections, with back-off.

        Raises:
            InputError: The client is not installed, or an argument cannot be sent.
        """
        try:
            import openai  # noqa: PLC0415 - an extra

            from siren_ros.scoring.evaluation.risk.vlm.bounded_client import BoundedClients  # noqa: PLC0415 - the same
        except ImportError as error:
            raise InputError("model", model, "the client: run `./env --with vlm siren evaluate risk …`") from error
        if not 0.0 < timeout_s < math.inf:
            raise InputError("timeout-s", timeout_s, "a number of seconds above 0")
        # Lone surrogates come from bytes that are not UTF-8.
        if any("\ud800" <= letter <= "\udfff" for letter in model):
            raise InputError("model", model, "a name in UTF-8")
        if not (key.isascii() and key.isprintable()):
            raise InputError("api-key-env", "its key", "ASCII characters in one line, as a header can carry them")
        self._openai = openai
        self._model = model
        self._clients = BoundedClients(base_url, timeout_s)
        self._settings: dict[str, Any] = {"api_key": key, "base_url": base_url, "max_retries": retries}

    @property
    def name(self) -> str:
        """Implements ``VisionLanguageModel.name``."""
        return self._model

    def answer(self, question: Question) -> Reply:
        """Implements ``VisionLanguageModel.answer``."""
        content: list[Any] = [{"type": "text", "text": question.text}]
        for picture in question.pictures:
            url = f"data:image/jpeg;base64,{b64encode(picture).decode()}"
            content.append({"type": "image_url", "image_url": {"url": url}})
        messages: list[Any] = [{"role": "system", "content": question.system}, {"role": "user", "content": content}]
        begin = time.monotonic()
        try:
            body = asyncio.run(self._body(messages))
        except self._openai.APIStatusError as error:
            raise ModelUnavailableError(f"{self._model}: the server answers {error.status_code}") from error
        except self._openai.OpenAIError as error:
            raise ModelUnavailableError(f"{self._model}: {type(error).__name__}: {error}") from error
        try:
            return reply_in(body, time.monotonic() - begin)
        except ValueError as error:
            problem = f"{self._model}: the server's answer is not of the protocol: {error}"
            raise ModelUnavailableError(problem) from error

    async def _body(self, messages: list[Any]) -> bytes:
        """Send a request, with further attempts, and return the bytes of the answer."""
        async with (
            self._clients.client() as http,
            self._openai.AsyncOpenAI(**self._settings, timeout=http.timeout, http_client=http) as client,
        ):
            reply = await client.chat.completions.with_raw_response.create(
                model=self._model, messages=messages, temperature=0.0, max_tokens=MOST_TOKENS
            )
            return bytes(reply.content)


def reply_in(body: bytes, seconds: float) -> Reply:
    """Read the reply from the body of a server's answer.

    ``content`` may be text, null (no words), or a list of parts, of which those of the type ``text`` count. Tokens that
    the server does not tell are 0. The body has at most one byte more than a reply may have.

    Raises:
        ValueError: It is not of the protocol; the message names the fault in one line.
    """
    if len(body) > MOST_REPLY_BYTES:
        raise ValueError(f"more than {MOST_REPLY_BYTES} bytes")
    try:
        content: object = json.loads(body)
    except (ValueError, RecursionError):
        raise ValueError("no JSON that can be read") from None
    choices = _member(content, "choices")
    if not isinstance(choices, list) or not choices:
        raise ValueError("no choices")
    text = _text_of(_member(_member(choices[0], "message"), "content"))
    usage = _member(content, "usage")
    counts = [None if usage is None else _member(usage, name) for name in ("prompt_tokens", "completion_tokens")]
    asked, answered = (0 if count is None else count for count in counts)
    return checked_reply(text, asked, answered, seconds)


def _member(of: object, name: str) -> object:
    """A member of a JSON object; None if it is missing."""
    if not isinstance(of, dict):
        raise ValueError(f"no object around {name}")  # noqa: TRY004 - what a server sends, not a call
    return of.get(name)


def _text_of(content: object) -> object:
    """Text of a message: its content, or its parts of the type ``text``."""
    if not isinstance(content, list):
        return "" if content is None else content
    texts = [_member(part, "text") for part in content if _member(part, "type") == "text"]
    if not all(isinstance(text, str) for text in texts):
        raise ValueError("a part without text")
    return "".join(str(text) for text in texts)


def key_from(variable: str) -> str:
    """Read the key from an environment variable; ``NO_KEY`` if no variable is named.

    Raises:
        InputError: The variable is not set.
    """
    if not variable:
        return NO_KEY
    key = os.environ.get(variable, "")
    if not key:
        raise InputError("api-key-env", variable, "the name of an environment variable that holds the key")
    return key


@dataclass(frozen=True)
class Setting:
    """A setting of a client; it is an option of ``siren evaluate risk``."""

    help: str
    metavar: str | None = None
    default: Any = None
    kind: Callable[[str], Any] = str
    """Converts the text from the command line."""
    repeated: bool = False
    """Whether the option may be given several times; its value is then a list."""
    limits: tuple[float, float] | None = None
    """Smallest and largest allowed number."""


@dataclass(frozen=True)
class Client:
    """One way to reach models."""

    title: str
    """Title of its options in the help text."""
    settings: Mapping[str, Setting]
    """Settings by name; ``base_url`` is the option ``--base-url``."""
    models: Callable[[Mapping[str, Any]], Iterator[VisionLanguageModel]]
    """Yields the models for some settings, so that each is loaded when it is used."""


def _served(settings: Mapping[str, Any]) -> Iterator[VisionLanguageModel]:
    for model in settings["model"]:
        if settings["base_url"] is None:
            raise InputError("base-url", "", "the address of a server, such as http://localhost:8000/v1")
        key = key_from(settings["api_key_env"])
        yield OpenAiServer(settings["base_url"], model, key, settings["timeout_s"], settings["retries"])


def _local(settings: Mapping[str, Any]) -> Iterator[VisionLanguageModel]:
    for folder in settings["local_model"]:
        yield LocalModel(folder, settings["device"], settings["most_tokens"])


CLIENTS: Final = (
    Client(
        "asking a model behind a server that speaks OpenAI's protocol",
        {
            "base_url": Setting("address of the server, such as http://localhost:8000/v1", "URL"),
            "model": Setting("name of the model on the server; may be repeated", "NAME", repeated=True),
            "api_key_env": Setting("environment variable with the key (or none)", "VAR", ""),
            "retries": Setting("tries of a failed request (default %(default)s)", "N", 5, int, limits=(0, 1000)),
            "timeout_s": Setting("for a whole reply (default %(default)g)", "S", 120.0, float, limits=(0.001, 1e6)),
        },
        _served,
    ),
    Client(
        "asking a model in this process: ./env --with vlm-local siren evaluate risk …",
        {
            "local_model": Setting(
                "folder of a model in Hugging Face's format, which also names it; may be repeated",
                "DIR",
                kind=Path,
                repeated=True,
            ),
            "device": Setting("cpu (default) or cuda", default="cpu"),
            "most_tokens": Setting("tokens of an answer (default %(default)s)", "N", MOST_TOKENS, int, limits=(1, 1e6)),
        },
        _local,
    ),
)
