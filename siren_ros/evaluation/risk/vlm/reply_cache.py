"""Replies on disk, so that nothing is asked twice and an interrupted run goes on."""

import json
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path

from siren_ros.evaluation.risk.vlm.model import Question, Reply


class ReplyCache:
    """One file for each reply, by model, words and pictures."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, model: str, question: Question) -> Reply | None:
        """The reply that is kept; None where there is none, or a damaged one."""
        try:
            return Reply(**json.loads(self._path(model, question).read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError):
            return None

    def put(self, model: str, question: Question, reply: Reply) -> None:
        """Keeps a reply; readers see the whole file or none."""
        path = self._path(model, question)
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        partial.write_text(json.dumps(asdict(reply)) + "\n", encoding="utf-8")
        partial.replace(path)

    def _path(self, model: str, question: Question) -> Path:
        digest = sha256()
        for part in (model, question.system, question.text):
            digest.update(len(part.encode()).to_bytes(8, "big") + part.encode())
        for picture in question.pictures:
            digest.update(sha256(picture).digest())
        return self._folder / f"{digest.hexdigest()}.json"
