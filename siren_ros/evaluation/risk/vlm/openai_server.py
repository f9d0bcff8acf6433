"""Models behind a server that speaks OpenAI's chat protocol: vLLM, llama.cpp, Ollama, hosted services."""

import os
import time
from base64 import b64encode
from typing import Any, Final

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.vlm.model import MOST_TOKENS, ModelUnavailableError, Question, Reply

NO_KEY: Final = "none"
"""Sent to servers that ask for no key; their clients have to send something."""


class OpenAiServer:
    """One model of one server."""

    def __init__(self, base_url: str, model: str, key: str, timeout_s: float, retries: int) -> None:
        """Prepare the client; nothing is sent yet.

        Args:
            base_url: Such as ``http://localhost:8000/v1``.
            model: The server's name for it.
            key: Of the user; it is sent to the server and shown nowhere.
            timeout_s: Of one request.
            retries: Further attempts after 408, 409, 429, 5xx, time-outs and broken connections, with back-off.

        Raises:
            InputError: The client is not installed.
        """
        try:
            import openai  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise InputError("model", model, "the client: run `./env --with vlm siren evaluate risk …`") from error
        self._openai = openai
        self._model = model
        self._client = openai.OpenAI(base_url=base_url, api_key=key, timeout=timeout_s, max_retries=retries)

    @property
    def name(self) -> str:
        """As ``VisionLanguageModel``."""
        return self._model

    def answer(self, question: Question) -> Reply:
        """As ``VisionLanguageModel``."""
        content: list[Any] = [{"type": "text", "text": question.text}]
        for picture in question.pictures:
            url = f"data:image/jpeg;base64,{b64encode(picture).decode()}"
            content.append({"type": "image_url", "image_url": {"url": url}})
        messages: list[Any] = [{"role": "system", "content": question.system}, {"role": "user", "content": content}]
        begin = time.monotonic()
        try:
            reply = self._client.chat.completions.create(
                model=self._model, messages=messages, temperature=0.0, max_tokens=MOST_TOKENS
            )
            text = reply.choices[0].message.content or ""
        except self._openai.APIStatusError as error:
            raise ModelUnavailableError(f"{self._model}: the server answers {error.status_code}") from error
        except self._openai.OpenAIError as error:
            raise ModelUnavailableError(f"{self._model}: {type(error).__name__}: {error}") from error
        except (AttributeError, IndexError, TypeError, ValueError) as error:
            raise ModelUnavailableError(f"{self._model}: the server's answer is not of the protocol") from error
        seconds, usage = time.monotonic() - begin, reply.usage
        if usage is None:
            return Reply(text, seconds=seconds)
        return Reply(text, usage.prompt_tokens, usage.completion_tokens, seconds)


def key_from(variable: str) -> str:
    """The key in an environment variable; ``NO_KEY`` where no variable is named.

    Raises:
        InputError: The variable is not set.
    """
    if not variable:
        return NO_KEY
    key = os.environ.get(variable, "")
    if not key:
        raise InputError("api-key-env", variable, "the name of an environment variable that holds the key")
    return key
