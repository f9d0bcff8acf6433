"""A round: made of sealed episodes; its submissions are scored, ranked and published, and anybody can verify all of it.

``KINDS`` says what a submission is: a file of answers, or a folder, such as one whose file ``command`` is the command
line of a program. One that cannot be scored is refused by its name; the others are ranked.
"""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping
from glob import escape
from pathlib import Path
from typing import Final

from siren_ros import __version__
from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.params.plain_files import sha256_of
from siren_ros.base.processes.asked_program import ANSWER_S, MEMORY_MB, isolation
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.base.tables import Row, Table, interval_of_json
from siren_ros.data.episode_source import bag_sha256
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import EpisodeError, InputError, SirenError, shown_text, write_text, writing
from siren_ros.reports.round.kinds import KINDS, PREDICTION, Kind
from siren_ros.reports.round.sealed_round import (
    BAGS,
    COMMAND_FILE,
    MAPS,
    PLAN_FILE,
    PRIVATE,
    PUBLIC,
    QUESTIONS,
    ROUND_FILE,
    SALT_FILE,
    SOURCES,
    kept_request,
    question_file,
    read_content,
    read_plan,
    request_in,
    write_json,
)
from siren_ros.reports.study_report.page import Page, Section, html_of
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import present_versions, set_up_episode
from siren_ros.running.studies.matrix import Study, plan_study
from siren_ros.scoring.evaluation.prediction.questions import Content
from siren_ros.scoring.evaluation.scores import Score, Scores, csv_of, leaderboard, standings
from siren_ros.scoring.evaluation.statistics import BlockSums
from siren_ros.simulation.scenario.episode import EpisodeEnd
from siren_ros.simulation.scenario.sealing import commitment, write_salt

BOARD_FILE: Final = "board.json"
ANSWERS: Final = "answers"
SCORES: Final = "scores"
_HASHED: Final = ("map", "bag", "question")


def make_round(
    study: Study,
    out: Path,
    processes: int = 1,
    on_episode: Callable[[], None] = lambda: None,
    *,
    task: str = PREDICTION,
    rules: Content | None = None,
) -> Content:
    """Make a round.

    Args:
        study: The episodes. Their order and their names in the round say nothing.
        out: Folder of the round; it must not exist.
        processes: How many episodes are made at once.
        on_episode: Called after each.
        task: Name of its kind in ``KINDS``.
        rules: What everybody is told of the rules (``Kind.rules``).

    Returns:
        The content of the public ``round.json``.

    Raises:
        InputError: The study or the folder cannot be used.
        BagError: In an episode nobody stays around the EMV for 8 s.
        EpisodeError: An episode fails.
    """
    planned = plan_study(study)
    public, private = out / PUBLIC, out / PRIVATE
    with writing(out, "new folder"):
        out.mkdir(parents=True)
        for folder in (public / QUESTIONS, public / MAPS, private / BAGS, private / SOURCES):
            folder.mkdir(parents=True)
        private.chmod(0o700)
    salt = write_salt(private / SALT_FILE)
    order = random_stream(int.from_bytes(salt), "round/order").permutation(len(planned)).tolist()
    requests = [kept_request(planned[place].request, private) for place in order]
    names = [f"episode{number:03d}" for number in range(1, len(requests) + 1)]
    plan = {
        "task": task,
        "rules": dict(rules or {}),
        "episodes": [{"name": name, "request": one.to_json()} for name, one in zip(names, requests, strict=True)],
        "versions": dict(present_versions()),
    }
    write_json(private / PLAN_FILE, plan)
    told = []
    with ProcessPool(min(processes, len(order))) as pool:
        calls = [(task, episode, private, private / BAGS, public) for episode in plan["episodes"]]
        for made in pool.map(made_episode, calls, on_episode):
            told.append({key: made[key] for key in ("name", "map_sha256", "bag_sha256", "question_sha256")})
            write_text(question_file(public, made["name"]), made["question"])
            write_text(public / MAPS / f"{made['map_sha256']}.net.xml", made["net"])
    content = {**plan, "commitment": commitment(salt, plan), "episodes": told}
    write_json(public / ROUND_FILE, content)
    return content


def made_episode(task: str, episode: Content, folder: Path, bags: Path, public: Path) -> Content:
    """Simulate an episode of a plan, and tell its question and the hashes of everything.

    Args:
        task: Kind of the round.
        episode: Its part of the plan.
        folder: Folder with the salt.
        bags: Folder that gets its bag.
        public: Folder that gets what participants need besides the question.

    Raises:
        EpisodeError: It fails.
    """
    request, bag = request_in(episode, folder), bags / episode["name"]
    outcome = record_episode(set_up_episode(request), bag).outcome
    if outcome.end is not EpisodeEnd.COMPLETE:
        raise EpisodeError(f"{episode['name']}: {outcome.reason}")
    record = read_episode(bag)
    question = json.dumps(KINDS[task].question(episode["name"], request, record, bag, public))
    return {
        "name": episode["name"],
        "map_sha256": record.description.map_sha256,
        "bag_sha256": bag_sha256(bag),
        "question_sha256": hashlib.sha256(question.encode()).hexdigest(),
        "question": question,
        "net": record.map_xml.decode(),
    }


def score_round(
    folder: Path,
    submissions: Path,
    *,
    answer_s: float = ANSWER_S,
    memory_mb: int = MEMORY_MB,
    container: str = "",
    processes: int = 1,
) -> Content:
    """Score all submissions in a folder, and write the board and the answers that it follows from.

    Args:
        folder: The round, with its private part.
        submissions: Folder with the submissions.
        answer_s: Wall time that a program has for an answer.
        memory_mb: Memory of each process of a program.
        container: Image of the container in which programs run; empty for processes with limits (``isolation``).
        processes: How many episodes drivers drive at once.

    Returns:
        The content of the board.

    Raises:
        InputError: The folders cannot be used, or no submission can be scored.
    """
    private, out = folder / PRIVATE, folder / SCORES
    plan = read_plan(private)
    kind = kind_of(plan)
    paths = [path for path in sorted(submissions.glob("*")) if _is_submission(path, kind)]
    names = [shown_text(path.stem) for path in paths]
    if not paths or len(set(names)) < len(names):
        known = ", ".join([*(f"NAME{suffix}" for suffix in kind.suffixes), f"folders NAME/{kind.holds}"])
        raise InputError("submissions", str(submissions), f"{known}, each once")
    judged, common = kind.judge(plan, private, private / BAGS)
    with writing(out, "folder"):
        shutil.rmtree(out, ignore_errors=True)
        (out / ANSWERS).mkdir(parents=True)
    refused, about, found = {}, {}, {}
    for name, path in zip(names, paths, strict=True):
        about[name] = {"sha256": sha256_of(path), "kind": "file"}
        if (path / COMMAND_FILE).is_file():
            about[name]["kind"] = f"program, container {container}" if container else isolation()
        try:
            limits = answer_s, memory_mb, container, processes
            file = kind.take(path, out / ANSWERS / name, private, plan, limits)
            found[file] = judged(file)
        except (SirenError, OSError) as error:
            for left in (out / ANSWERS).glob(f"{escape(name)}*"):
                if left.stem == name:
                    shutil.rmtree(left) if left.is_dir() else left.unlink()
            places = (f"{submissions}/", f"{out / ANSWERS}/")
            refused[name] = shown_text(str(error).replace(places[0], "").replace(places[1], ""))
    if not found:
        why = "; ".join(f"{name}: {reason}" for name, reason in refused.items())
        raise InputError("submissions", why, "one that can be scored")
    content = {**_board(plan, common, found), "refused": refused, "submissions": about}
    content |= {"limits": {"answer_s": answer_s, "memory_mb": memory_mb}}
    write_json(out / BOARD_FILE, content)
    return content


def kind_of(content: Content) -> Kind:
    """The kind of a plan or of a public part; InputError if there is none."""
    if content.get("task") not in KINDS:
        raise InputError("round", content.get("task"), f"a round of {', '.join(KINDS)}")
    return KINDS[content["task"]]


def _is_submission(path: Path, kind: Kind) -> bool:
    if path.is_symlink() or path.name.startswith("."):
        return False
    return any(path.glob(kind.holds)) if path.is_dir() else path.suffix in kind.suffixes


def _board(plan: Content, common: Content, found: Mapping[Path, tuple[BlockSums, str, Content]]) -> Content:
    """What follows from the answers: rows, differences, who is flagged and not ranked, and what else is told."""
    kind = kind_of(plan)
    fair = {file.stem: sums for file, (sums, flag, _) in found.items() if not flag}
    rows = standings(fair, kind.names[1], less_is_better=kind.less_is_better) if fair else ()
    values, differences = ([row.json() for row in rows if bool(row.against) is tested] for tested in (False, True))
    return {
        "task": plan["task"],
        "version": __version__,
        "rows": values,
        "differences": differences,
        **common,
        "flagged": {file.stem: flag for file, (_, flag, _) in found.items() if flag},
        "told": {file.stem: told for file, (_, _, told) in found.items() if told},
        "answers": {file.stem: sha256_of(file) for file in found},
    }


def publish_round(folder: Path, out: Path) -> None:
    """Write everything that the public needs: the public part, salt and plan, answers, the board and its page.

    Raises:
        InputError: The round has no scores, or the folder cannot be written.
    """
    private, scores = folder / PRIVATE, folder / SCORES
    read_plan(private)
    board = read_content(scores / BOARD_FILE, "rows", "differences", "flagged", "refused", "submissions")
    told = read_content(folder / PUBLIC / ROUND_FILE, "commitment", "rules", "episodes")
    of_round = {
        "commitment": told["commitment"],
        "rules": told["rules"],
        "split": "sealed",
        "episodes": told["episodes"],
    }
    content = {**board, **of_round, "salt": (private / SALT_FILE).read_text(encoding="ascii").strip()}
    with writing(out, "new folder"):
        shutil.copytree(folder / PUBLIC, out)
        shutil.copytree(private / SOURCES, out / SOURCES)
        shutil.copytree(scores / ANSWERS, out / ANSWERS)
        for name in (SALT_FILE, PLAN_FILE):
            shutil.copyfile(private / name, out / name)
    write_json(out / BOARD_FILE, content)
    write_text(out / "board.csv", csv_of(Scores.of_json(board).rows))
    write_text(out / "board.html", html_of(page_of(content)))


def tables_of(board: Content) -> tuple[Table, ...]:
    """The ranking of a board; none where nobody is ranked."""
    scores = [*Scores.of_json(board).rows, *map(_difference, board["differences"])]
    return (leaderboard(scores, "episodes"),) if scores else ()


def page_of(board: Content) -> Page:
    """A published board as a page."""
    flagged, refused, about = board["flagged"], board["refused"], board["submissions"]
    of_submissions: list[Row] = [
        (
            name,
            "refused" if name in refused else "flagged" if name in flagged else "ranked",
            known["kind"],
            known["sha256"],
            refused.get(name, flagged.get(name, "")),
        )
        for name, known in about.items()
    ]
    head = ("submission", "result", "kind", "SHA-256", "reason")
    episodes = [(one["name"], one["bag_sha256"], one["question_sha256"]) for one in board["episodes"]]
    sealed: list[Row] = [("salt", board["salt"]), ("commitment", board["commitment"]), ("split", board["split"])]
    sealed += [("SIREN", board["version"]), *((key, str(value)) for key, value in board["rules"].items())]
    floor = board.get("floor", {})
    text = (
        (floor["text"], "A submission that is flagged is not ranked before somebody has looked at it.") if floor else ()
    )
    known = dict.fromkeys(key for told in board["told"].values() for key in told)
    more = [(name, *(told.get(key) for key in known)) for name, told in board["told"].items()]
    told = (Table("told", "What else is known", ("submission", *known), tuple(more)),) if more else ()
    titles = ("episode", "SHA-256 of the bag", "of the question")
    seal = Table("sealed", "The seal", ("what", "value"), tuple(sealed))
    bags = Table("episodes", "Episodes", titles, tuple(episodes), folded=True)
    again = ("The command simulates the episodes again from the salt, and scores the answers again.",)
    given = Table("submissions", "Submissions", head, tuple(of_submissions))
    sections = (
        Section("board", "Board", text, tables=(*tables_of(board), *told, given)),
        Section("seal", "Seal", again, tables=(seal, bags), commands=("siren round verify FOLDER",)),
    )
    lead = f"{len(board['rows'])} of {len(about)} submissions are ranked on {len(episodes)} sealed episodes."
    return Page(f"Round: {kind_of(board).names[0]}", lead, sections)


def _difference(row: Content) -> Score:
    known = (row["model"], row["kind"], row["group"], row["metric"], interval_of_json(row), row["samples"])
    return Score(*known, row["against"], row["p"], row["p_holm"])


def verify_round(
    published: Path, kept: Path | None = None, processes: int = 1, on_episode: Callable[[], None] = lambda: None
) -> tuple[str, ...]:
    """What is wrong with a published round; nothing where everything follows from the salt and the answers.

    Args:
        published: Folder that ``publish_round`` wrote.
        kept: The ``round.json`` that a participant got when the round began.
        processes: How many episodes are simulated at once.
        on_episode: Called after each.

    Raises:
        InputError: The folder has no round, or its salt or plan are not those to which it committed.
    """
    try:
        return tuple(_wrong_with(published, kept, processes, on_episode))
    except (KeyError, TypeError, ValueError, AttributeError, OSError) as error:
        raise InputError("round", str(published), f"a folder of siren round publish ({error!r})") from error


def _wrong_with(published: Path, kept: Path | None, processes: int, on_episode: Callable[[], None]) -> list[str]:
    plan = read_plan(published)
    told = read_content(published / ROUND_FILE, "episodes", "versions")
    board = read_content(published / BOARD_FILE, "rows", "answers", "episodes", "commitment")
    here = present_versions()
    wrong = [
        f"{package} was {known} and is {here.get(package)} here"
        for package, known in plan["versions"].items()
        if known != here.get(package)
    ]
    if kept is not None and read_content(kept, "episodes") != told:
        wrong.append(f"{ROUND_FILE} is not the one that participants got")
    if any(board[key] != told[key] for key in ("episodes", "commitment", "rules")) or told["rules"] != plan["rules"]:
        wrong.append(f"{BOARD_FILE} is of another round")
    kind = kind_of(plan)
    with tempfile.TemporaryDirectory(prefix="siren-verify-") as scratch:
        bags, public, names = (
            Path(scratch) / BAGS,
            Path(scratch) / PUBLIC,
            {one["name"]: one for one in told["episodes"]},
        )
        public.mkdir()
        with ProcessPool(min(processes, len(names))) as pool:
            calls = [(plan["task"], episode, published, bags, public) for episode in plan["episodes"]]
            for made in pool.map(made_episode, calls, on_episode):
                known, name = names.get(made["name"], {}), made["name"]
                others = [what for what in _HASHED if made[f"{what}_sha256"] != known.get(f"{what}_sha256")]
                wrong += [f"{name}: the {what} does not follow from the salt" for what in others]
                if question_file(published, name).read_text(encoding="utf-8") != made["question"]:
                    wrong.append(f"{name}: the file of the question is another one")
        for bag in sorted(public.glob("*/*")):
            if sha256_of(bag) != sha256_of(published / bag.relative_to(public)):
                wrong.append(f"{bag.name}: the published bag is another one")
        answers = sorted((published / ANSWERS).iterdir())
        judged, common = kind.judge(plan, published, bags)
        found = {}
        for file in answers:
            try:
                found[file] = judged(file)
            except SirenError as error:
                wrong.append(f"{file.stem}: {shown_text(str(error))}")
        again = _board(plan, common, found)
    wrong += kind.forged(plan, published, answers)
    wrong += [f"{key} of {BOARD_FILE} do not follow from the answers" for key in again if again[key] != board.get(key)]
    return wrong
