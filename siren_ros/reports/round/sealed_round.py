"""The folder of a round: what its parts are called, its plan, and the requests of its sealed episodes.

The folder has two parts. ``public`` goes to the participants: questions, maps, the hashes of the bags, and
the commitment, a hash of salt and plan. ``private`` stays with the organiser until the round ends: salt, plan, bags.
"""

import hashlib
import json
import re
import shlex
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Rows
from siren_ros.base.params import plain_files
from siren_ros.errors import InputError, write_text, writing
from siren_ros.scoring.evaluation.prediction.questions import Content
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.sealing import commitment, read_salt

PUBLIC: Final = "public"
PRIVATE: Final = "private"
ROUND_FILE: Final = "round.json"
PLAN_FILE: Final = "plan.json"
SALT_FILE: Final = "salt"
QUESTIONS: Final = "questions"
MAPS: Final = "maps"
BAGS: Final = "bags"
COMMAND_FILE: Final = "command"
"""File of a submission's folder with the command line of its program."""
_NAME: Final = re.compile(r"episode\d{3,9}")
"""Name of an episode, which is also that of files."""
SOURCES: Final = "sources"
"""Folder next to the plan with the files of users that its requests name."""
_FILES: Final = ("template", "map", "preset", "look", "demand")
"""Fields of a request that may name such a file."""


def kept_request(request: EpisodeRequest, private: Path) -> EpisodeRequest:
    """The request with the files of users that it names in the folder of the plan; InputError if that fails."""
    kept: dict[str, Any] = {}
    for name in _FILES:
        file = Path(getattr(request, name))
        if getattr(request, name) and file.is_file():
            kept[name] = f"{SOURCES}/{hashlib.sha256(file.read_bytes()).hexdigest()[:8]}/{file.name}"
            with writing(private, "folder"):
                (private / kept[name]).parent.mkdir(exist_ok=True)
                shutil.copyfile(file, private / kept[name])
    return replace(request, **kept)


def request_in(episode: Content, folder: Path) -> EpisodeRequest:
    """The request of an episode of a plan, whose salt and files lie in a folder.

    Raises:
        InputError: It is none.
    """
    try:
        request = EpisodeRequest(**episode["request"])
    except TypeError as error:
        raise InputError("plan", repr(error), "the requests of a round") from error
    files = {name: str(getattr(request, name)) for name in _FILES}
    kept = {name: value for name, value in files.items() if value.startswith(f"{SOURCES}/")}
    own: dict[str, Any] = {name: str(folder / value) for name, value in kept.items()}
    return replace(request, **own, salt=str(folder / SALT_FILE))


def question_file(public: Path, name: str) -> Path:
    """The file of an episode's question."""
    return public / QUESTIONS / f"{name}.json"


def public_of(folder: Path) -> Path:
    """The public part of the round whose salt and plan lie in a folder: of one that is held, or that was published."""
    return folder.parent / PUBLIC if folder.name == PRIVATE else folder


def command_in(program: Path) -> list[str]:
    """The words of the command line in a program's folder; InputError if there is none."""
    try:
        return shlex.split((program / COMMAND_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError("program", program.name, f"a command line in {COMMAND_FILE} ({error})") from error


def strata_of(plan: Content) -> Rows:
    """Number of the template of each episode, shape ``(E,)``: intervals take the templates as given."""
    templates = [str(one["request"]["template"]) for one in plan["episodes"]]
    return np.unique(templates, return_inverse=True)[1].astype(np.intp)


def read_content(file: Path, *keys: str) -> Content:
    """The content of a file of a round; InputError if it cannot be read, or lacks a key."""
    try:
        content = plain_files.read_json(file)
        lacking = [key for key in keys if key not in content]
    except (OSError, ValueError, TypeError) as error:
        raise InputError("round", str(file), f"a file of a round ({error})") from error
    if lacking or not isinstance(content, Mapping):
        raise InputError("round", str(file), f"a file of a round with {', '.join(keys)}")
    return content


def read_plan(folder: Path) -> Content:
    """The plan in a folder, once the salt there fits the commitment.

    Raises:
        InputError: There is none, or salt or plan are others than those to which the round committed.
    """
    plan = read_content(folder / PLAN_FILE, "episodes", "versions")
    names = [one.get("name") if isinstance(one, Mapping) else None for one in plan["episodes"]]
    if not names or not all(isinstance(name, str) and _NAME.fullmatch(name) for name in names):
        raise InputError("round", str(folder / PLAN_FILE), "a plan with names as episode001")
    committed = read_content(public_of(folder) / ROUND_FILE, "commitment", "episodes")["commitment"]
    if commitment(read_salt(folder / SALT_FILE), plan) != committed:
        raise InputError("round", str(folder), "the salt and the plan to which the round committed")
    return plan


def write_json(file: Path, content: object) -> None:
    """Write a file of a round; InputError where it cannot be written."""
    write_text(file, json.dumps(content, indent=1) + "\n")
