"""Replies on disk, so that nothing is asked twice and an interrupted run goes on."""

import json
import os
import threading
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Final

from siren_ros.errors import writing
from siren_ros.evaluation.risk.vlm.model import MOST_REPLY_BYTES, Question, Reply, checked_reply

_MOST_BYTES: Final = 6 * MOST_REPLY_BYTES + 1_000
"""Of a file: each byte of a text that is not ASCII takes up to six (``\\uXXXX``)."""


class ReplyCache:
    """One file for each reply, by model, words and pictures."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, model: str, question: Question) -> Reply | None:
        """The reply that is kept; None where there is none, or a damaged one."""
        try:
            with self._path(model, question).open("rb") as file:
                kept = json.loads(file.read(_MOST_BYTES))
            return checked_reply(**kept)
        except (OSError, ValueError, TypeError, RecursionError):
            return None

    def put(self, model: str, question: Question, reply: Reply) -> None:
        """Keeps a reply; readers see the whole file or none.

        Raises:
            InputError: The folder cannot be written.
        """
        path = self._path(model, question)
        with writing(self._folder, "folder", "cache"):
            path.parent.mkdir(parents=True, exist_ok=True)
            # A name of its own: the same question may be asked twice at the same time.
            partial = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}.partial")
            partial.write_text(json.dumps(asdict(reply)) + "\n", encoding="utf-8")
            partial.replace(path)

    def _path(self, model: str, question: Question) -> Path:
        digest = sha256()
        for part in (model, question.system, question.text):
            digest.update(len(part.encode()).to_bytes(8, "big") + part.encode())
        for picture in question.pictures:
            digest.update(sha256(picture).digest())
        return self._folder / f"{digest.hexdigest()}.json"
