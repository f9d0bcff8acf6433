"""Rounds of the exam: drivers in the place of the AV of sealed episodes, graded by a rulebook.

A driver is a network with its card, the name of one of the library, or a ROS program within limits. Its answers are the
bags of its episodes, which follow from the salt and from its controls.
"""

import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

import siren_ros
from siren_ros.base.processes.asked_program import limited
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.data.episode_source import bag_sha256
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EpisodeError, InputError, SirenError, writing
from siren_ros.reports.exam.grading import Rulebook, load_rulebook
from siren_ros.reports.exam.sitting import MadeEpisode, certificate_of, sit_in_made_episode
from siren_ros.reports.round.prediction import Limits
from siren_ros.reports.round.sealed_round import command_in, request_in, strata_of
from siren_ros.running.generation.closed_loop import LoopStep, record_episode
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.generation.replay_check import answers_in
from siren_ros.running.seat.drivers.drivers import DRIVERS
from siren_ros.running.studies.av_program import LIMIT_S
from siren_ros.running.studies.episode_row import Status
from siren_ros.running.studies.matrix import Seat
from siren_ros.running.studies.run_study import attempt_episode
from siren_ros.scoring.evaluation.prediction.questions import Content
from siren_ros.scoring.evaluation.statistics import BlockSums, block_sums
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.commands import Controls

NAME_SUFFIX: Final = ".txt"
"""Suffix of a submission that is the name of one of the library's drivers."""


def rules(rulebook: str) -> Content:
    """What a round tells of its rulebook; InputError for one that does not ship, which nobody else would have."""
    book = load_rulebook(rulebook)
    if " " in book.name:
        raise InputError("rulebook", rulebook, "one that ships: everybody grades by it again")
    return {"rulebook": book.name, "rulebook_sha256": book.sha256, "included_sha256": dict(book.included)}


def question(name: str, _request: EpisodeRequest, record: EpisodeRecord, _bag: Path, _public: Path) -> Content:
    """All that is told of an episode before: its map."""
    return {"episode": name, "map": record.description.map_sha256}


def answer(_public: Path, model: str, out: Path) -> int:
    """Write the submission of a driver of the library."""
    with writing(out):
        out.write_text(f"{model}\n", encoding="utf-8")
    return 1


def take(given: Path, out: Path, folder: Path, plan: Content, limits: Limits) -> Path:
    """The bags of a driver in all episodes.

    Raises:
        InputError: There is no such driver.
        EpisodeError: It comes to no end of an episode.
    """
    with writing(out, "folder"), ExitStack() as stack:
        out.mkdir()
        if given.is_dir():
            home = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="siren-driver-")))
            seat = Seat(program=shlex.join(_limited(given, home, folder, limits)))
        else:
            seat = Seat(str(given) if given.suffix != NAME_SUFFIX else _known(given))
        with ProcessPool(min(limits[3], len(plan["episodes"]))) as pool:
            pool.map(_drive, [(one, folder, out / one["name"], seat) for one in plan["episodes"]])
    return out


def _known(file: Path) -> str:
    try:
        name = file.read_text(encoding="utf-8").strip()
    except ValueError as error:
        raise InputError("driver", file.name, "a name") from error
    if name not in DRIVERS:
        raise InputError("driver", name, f"one of {', '.join(DRIVERS)}")
    return name


def _limited(given: Path, home: Path, folder: Path, limits: Limits) -> list[str]:
    """The command line of a ROS program that reads ROS and a copy of its own folder, and nothing of the round."""
    if limits[2]:
        raise InputError("container", limits[2], "none: a driver talks to the episode by ROS")
    words = command_in(given)
    places = [Path(sys.prefix), Path(sys.base_prefix), Path(siren_ros.__file__).parent]
    inside = [str(place) for place in places if folder.resolve().is_relative_to(place.resolve())]
    if inside:
        raise InputError("round", str(folder), f"a folder outside {inside[0]}, which drivers may read")
    shutil.copytree(given, home, dirs_exist_ok=True)
    own = [f"{name}={home}" for name in ("HOME", "TMPDIR", "ROS_LOG_DIR")]
    return limited(["/usr/bin/env", "-C", str(home), *own, *words], str(home), places, limits[1], LIMIT_S)


def _drive(one: Content, folder: Path, bag: Path, seat: Seat) -> None:
    row = attempt_episode(_driven(one, folder), bag, seat)
    if row["status"] is not Status.COMPLETE:
        raise EpisodeError(f"{one['name']}: {row['reason']}")


def _driven(one: Content, folder: Path) -> EpisodeRequest:
    return replace(request_in(one, folder), av="civilian")


def judge(plan: Content, _folder: Path, bags: Path) -> tuple[Callable[[Path], tuple[BlockSums, str, Content]], Content]:
    """The violated clauses of a driver in each episode, and what its certificate says."""
    book, stratum = _book(plan), strata_of(plan)
    names = [one["name"] for one in plan["episodes"]]

    def judged(driver: Path) -> tuple[BlockSums, str, Content]:
        sittings = [sit_in_made_episode(MadeEpisode(driver / name, bags / name, None), book) for name in names]
        certificate = certificate_of(driver.name, None, book, sittings)
        violated = np.array([len(one.violated) for one in sittings], dtype=np.float64)
        told = {
            "passed": "yes" if certificate.passed else "no",
            "grade": certificate.grade.value,
            "violations": int(violated.sum()),
            "lacks": "; ".join(certificate.lacks),
            **{f"covered: {group}": count for group, count in certificate.coverage().items()},
        }
        return block_sums(violated, np.arange(len(names)), stratum), "", told

    return judged, {}


def _book(plan: Content) -> Rulebook:
    told = plan["rules"]
    book = load_rulebook(str(told["rulebook"]))
    if rules(book.name) != told:
        raise InputError("rulebook", book.name, f"the one of the round, with SHA-256 {told['rulebook_sha256']}")
    return book


def forged(plan: Content, folder: Path, answers: Sequence[Path]) -> list[str]:
    """Bags that do not follow from the salt and from the controls that they hold."""
    wrong = []
    with tempfile.TemporaryDirectory(prefix="siren-driven-") as scratch:
        for driver in answers:
            for one in plan["episodes"]:
                bag, again = driver / one["name"], Path(scratch) / driver.name / one["name"]
                try:
                    controls = answers_in(read_episode(bag))
                    record_episode(set_up_episode(_driven(one, folder)), again, partial(_recorded, controls))
                    same = bag_sha256(again) == bag_sha256(bag)
                except SirenError:
                    same = False
                if not same:
                    wrong.append(f"{driver.name}: {one['name']} does not follow from the salt and its controls")
                shutil.rmtree(again, ignore_errors=True)
    return wrong


def _recorded(controls: Mapping[int, Controls], step: LoopStep) -> Controls:
    return controls.get(step.states.step, {})
