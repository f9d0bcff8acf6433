"""The table of clients: each way to reach vision-language models, with its settings.

A new client is a file with a class of the protocol ``VisionLanguageModel`` and an entry here. The command line takes
its options from the entries.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.vlm.local_model import LocalModel
from siren_ros.scoring.evaluation.risk.vlm.model import MOST_TOKENS, VisionLanguageModel
from siren_ros.scoring.evaluation.risk.vlm.openai_server import OpenAiServer, key_from


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
