"""Makes a round: sealed episodes of a study with a question each, and what anybody needs to make them again.

The folder of a round has two parts. ``public`` goes to the participants: questions, maps, the hashes of the bags, and
the commitment, a hash of salt and plan. ``private`` stays with the organiser until the round ends: salt, plan, bags.
"""

import hashlib
import json
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.params import plain_files
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.data.episode_source import bag_sha256
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EpisodeError, InputError, write_text, writing
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import present_versions, set_up_episode
from siren_ros.running.studies.matrix import Study, plan_study
from siren_ros.scoring.evaluation.prediction.questions import Content, content_of, question_of
from siren_ros.scoring.evaluation.prediction.samples import ScoredSamples
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeRequest
from siren_ros.simulation.scenario.sealing import commitment, read_salt, seed_of, write_salt

PUBLIC: Final = "public"
PRIVATE: Final = "private"
ROUND_FILE: Final = "round.json"
PLAN_FILE: Final = "plan.json"
SALT_FILE: Final = "salt"
QUESTIONS: Final = "questions"
MAPS: Final = "maps"
BAGS: Final = "bags"
_NAME: Final = re.compile(r"episode\d{3,9}")
"""Name of an episode, which is also that of files."""
_SOURCES: Final = "sources"
"""Folder next to the plan with the files of users that its requests name."""
_FILES: Final = ("template", "map", "preset", "look", "demand")
"""Fields of a request that may name such a file."""


def make_round(study: Study, out: Path, processes: int = 1, on_episode: Callable[[], None] = lambda: None) -> Content:
    """Make a round for trajectory prediction.

    Args:
        study: The episodes. Their order and their names in the round say nothing.
        out: Folder of the round; it must not exist.
        processes: How many episodes are made at once.
        on_episode: Called after each.

    Returns:
        The content of the public ``round.json``.

    Raises:
        InputError: The study or the folder cannot be used.
        BagError: In an episode nobody stays around the EMV for 8 s.
        EpisodeError: An episode fails.
    """
    planned = [episode.request for episode in plan_study(study)]
    public, private = out / PUBLIC, out / PRIVATE
    with writing(out, "new folder"):
        out.mkdir(parents=True)
        for folder in (public / QUESTIONS, public / MAPS, private / BAGS, private / _SOURCES):
            folder.mkdir(parents=True)
        private.chmod(0o700)
    salt = write_salt(private / SALT_FILE)
    order = random_stream(int.from_bytes(salt), "round/order").permutation(len(planned)).tolist()
    plan = {
        "episodes": [
            {"name": f"episode{number:03d}", "request": _kept(planned[place], private).to_json()}
            for number, place in enumerate(order, 1)
        ],
        "versions": dict(present_versions()),
    }
    _write_json(private / PLAN_FILE, plan)
    told = []
    with ProcessPool(min(processes, len(order))) as pool:
        calls = [(episode, private, private / BAGS) for episode in plan["episodes"]]
        for made in pool.map(made_episode, calls, on_episode):
            told.append({key: made[key] for key in ("name", "map_sha256", "bag_sha256", "question_sha256")})
            write_text(question_file(public, made["name"]), made["question"])
            write_text(public / MAPS / f"{made['map_sha256']}.net.xml", made["net"])
    content = {
        "task": "prediction",
        "commitment": commitment(salt, plan),
        "versions": plan["versions"],
        "episodes": told,
    }
    _write_json(public / ROUND_FILE, content)
    return content


def _kept(request: EpisodeRequest, private: Path) -> EpisodeRequest:
    """The request with the files of users that it names in the folder of the plan."""
    kept: dict[str, Any] = {}
    for name in _FILES:
        file = Path(getattr(request, name))
        if getattr(request, name) and file.is_file():
            kept[name] = f"{_SOURCES}/{hashlib.sha256(file.read_bytes()).hexdigest()[:8]}/{file.name}"
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
    kept = {name: value for name, value in files.items() if value.startswith(f"{_SOURCES}/")}
    own: dict[str, Any] = {name: str(folder / value) for name, value in kept.items()}
    return replace(request, **own, salt=str(folder / SALT_FILE))


def made_episode(episode: Content, folder: Path, bags: Path) -> Content:
    """Simulate an episode of a plan, and tell its question and the hashes of everything.

    Args:
        episode: Its part of the plan.
        folder: Folder with the salt.
        bags: Folder that gets its bag.

    Raises:
        EpisodeError: It fails.
    """
    request, bag = request_in(episode, folder), bags / episode["name"]
    outcome = record_episode(set_up_episode(request), bag).outcome
    if outcome.end is not EpisodeEnd.COMPLETE:
        raise EpisodeError(f"{episode['name']}: {outcome.reason}")
    record = read_episode(bag)
    question = json.dumps(content_of(episode["name"], record.description.map_sha256, _question(record, request).batch))
    return {
        "name": episode["name"],
        "map_sha256": record.description.map_sha256,
        "bag_sha256": bag_sha256(bag),
        "question_sha256": hashlib.sha256(question.encode()).hexdigest(),
        "question": question,
        "net": record.map_xml.decode(),
    }


def _question(record: EpisodeRecord, request: EpisodeRequest) -> ScoredSamples:
    return question_of(record, random_stream(seed_of(request), "round/question"))


def questions_with_truth(plan: Content, folder: Path, bags: Path) -> dict[str, ScoredSamples]:
    """The questions of a plan with their answers, from the bags.

    Raises:
        BagError: A bag cannot be read.
    """
    names = {one["name"]: request_in(one, folder) for one in plan["episodes"]}
    return {name: _question(read_episode(bags / name), request) for name, request in names.items()}


def question_file(public: Path, name: str) -> Path:
    """The file of an episode's question."""
    return public / QUESTIONS / f"{name}.json"


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
    public = folder.parent / PUBLIC if folder.name == PRIVATE else folder
    committed = read_content(public / ROUND_FILE, "commitment", "episodes")["commitment"]
    if commitment(read_salt(folder / SALT_FILE), plan) != committed:
        raise InputError("round", str(folder), "the salt and the plan to which the round committed")
    return plan


def _write_json(file: Path, content: object) -> None:
    write_text(file, json.dumps(content, indent=1) + "\n")
