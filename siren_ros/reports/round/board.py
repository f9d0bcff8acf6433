"""The board of a round: submissions are scored, ranked and published, and anybody can verify all of it.

A submission is a file of predictions, ``NAME.parquet``, or a folder ``NAME`` whose file ``command`` is the command line
of a program. One that cannot be scored is refused by its name; the others are ranked.
"""

import json
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from shlex import split
from typing import Any, Final

import numpy as np

from siren_ros import __version__
from siren_ros.base.params.plain_files import load_json, sha256_of, sha256_of_file
from siren_ros.base.processes.asked_program import (
    ANSWER_S,
    MEMORY_MB,
    READ_AT,
    asked_program,
    container_words,
    isolation,
)
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.base.tables import Row, Table, interval_of_json
from siren_ros.errors import InputError, SirenError, shown_text, write_text, writing
from siren_ros.reports.round.sealed_round import (
    BAGS,
    MAPS,
    PLAN_FILE,
    PRIVATE,
    PUBLIC,
    ROUND_FILE,
    SALT_FILE,
    made_episode,
    question_file,
    questions_with_truth,
    read_content,
    read_plan,
)
from siren_ros.reports.study_report.page import Page, Section, html_of
from siren_ros.running.generation.episode_setup import present_versions
from siren_ros.scoring.evaluation.prediction.predictors import predictors_named
from siren_ros.scoring.evaluation.prediction.questions import (
    Answer,
    Content,
    errors_of,
    floor_of,
    rows_in,
    write_answers,
)
from siren_ros.scoring.evaluation.prediction.samples import ScoredSamples
from siren_ros.scoring.evaluation.prediction.submission import ROWS_OF_FRAME, read_prediction_file, submission
from siren_ros.scoring.evaluation.scores import Score, Scores, csv_of, leaderboard, standings
from siren_ros.scoring.evaluation.statistics import BlockSums, block_sums, interval_of_mean

COMMAND_FILE: Final = "command"
BOARD_FILE: Final = "board.json"
ANSWERS: Final = "answers"
SCORES: Final = "scores"
METRIC: Final = "ADE in metres"
_HASHED: Final = ("map", "bag", "question")
FLOOR_MODELS: Final = ("cv", "idm_stop", "ca", "ctra", "cv_lane", "decay_lane", "decay_stop", "imm", "siren")
"""Models of the floor: those of the project that need no other package."""


def score_round(
    folder: Path, submissions: Path, *, answer_s: float = ANSWER_S, memory_mb: int = MEMORY_MB, container: str = ""
) -> Content:
    """Score all submissions in a folder, and write the board and the answers that it follows from.

    Args:
        folder: The round, with its private part.
        submissions: Folder with the submissions.
        answer_s: Wall time that a program has for an answer.
        memory_mb: Memory of each process of a program.
        container: Image of the container in which programs run; empty for processes with limits (``isolation``).

    Returns:
        The content of the board.

    Raises:
        InputError: The folders cannot be used, or no submission can be scored.
    """
    private, out = folder / PRIVATE, folder / SCORES
    plan = read_plan(private)
    questions = questions_with_truth(plan, private, private / BAGS)
    found = sorted(submissions.glob("*"))
    known = [path for path in found if path.suffix == ".parquet" or (path / COMMAND_FILE).is_file()]
    paths = [path for path in known if not path.is_symlink()]
    names = [shown_text(path.stem) for path in paths]
    if not paths or len(set(names)) < len(names):
        raise InputError("submissions", str(submissions), f"NAME.parquet and folders NAME/{COMMAND_FILE}, each once")
    with writing(out, "folder"):
        shutil.rmtree(out, ignore_errors=True)
        (out / ANSWERS).mkdir(parents=True)
    refused, about = {}, {}
    for name, path in zip(names, paths, strict=True):
        file = out / ANSWERS / f"{name}.parquet"
        about[name] = {"sha256": sha256_of(path), "kind": "file"}
        try:
            if path.is_dir():
                about[name]["kind"] = f"program, container {container}" if container else isolation()
                write_answers(file, _asked(path, folder / PUBLIC, list(questions), answer_s, memory_mb, container))
            else:
                shutil.copyfile(path, file)
            errors_of(questions, _read(file, len(questions)))
        except (SirenError, OSError) as error:
            file.unlink(missing_ok=True)
            refused[name] = shown_text(str(error).replace(f"{submissions}/", "").replace(f"{out / ANSWERS}/", ""))
    content = {**board_of(plan, questions, out / ANSWERS), "refused": refused, "submissions": about}
    content |= {"limits": {"answer_s": answer_s, "memory_mb": memory_mb}}
    write_text(out / BOARD_FILE, json.dumps(content, indent=1) + "\n")
    return content


def _read(file: Path, questions: int) -> Any:
    return submission(read_prediction_file(file, ROWS_OF_FRAME * questions))


def _asked(
    program: Path, public: Path, names: Sequence[str], answer_s: float, memory_mb: int, container: str
) -> list[Answer]:
    """The rows that a program answers, question by question."""
    with tempfile.TemporaryDirectory(prefix="siren-maps-") as readable:
        shutil.copytree(public / MAPS, readable, dirs_exist_ok=True)
        try:
            words = split((program / COMMAND_FILE).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError("program", program.name, f"a command line in {COMMAND_FILE} ({error})") from error
        processor_s = answer_s * len(names)
        if container:
            words = [*container_words(container, program, Path(readable), memory_mb, processor_s), *words]
        words = [*words, READ_AT if container else readable]
        rows: list[Answer] = []
        with asked_program(
            words,
            program,
            answer_s=answer_s,
            memory_mb=memory_mb,
            processor_s=processor_s,
            readable=() if container else (program, Path(readable)),
        ) as ask:
            for name in names:
                question = question_file(public, name).read_text(encoding="utf-8")
                try:
                    answer = load_json(ask(question))
                except ValueError as error:
                    raise InputError("answer", f"{program.name}: {error}", "a line of JSON") from error
                rows += rows_in(load_json(question), answer)
        return rows


def board_of(plan: Content, questions: Mapping[str, ScoredSamples], answers: Path) -> Content:
    """What follows from the answers: rows, differences, the floor, and who is below it and not ranked.

    Raises:
        InputError: No answers can be scored.
    """
    files = sorted(answers.glob("*.parquet"))
    if not files:
        raise InputError("submissions", str(answers), "one that can be scored")
    kinds = [str(one["request"]["template"]) for one in plan["episodes"]]
    stratum = np.unique(kinds, return_inverse=True)[1]

    def sums_of(errors: list[Any]) -> BlockSums:
        return block_sums(np.concatenate(errors), np.repeat(np.arange(len(errors)), [*map(len, errors)]), stratum)

    sums = {file.stem: sums_of(errors_of(questions, _read(file, len(questions)))) for file in files}
    floor = interval_of_mean(sums_of(floor_of(questions, predictors_named(FLOOR_MODELS)))).value
    means = {name: interval_of_mean(of_name).value for name, of_name in sums.items()}
    fair = {name: of_name for name, of_name in sums.items() if means[name] >= floor}
    rows = standings(fair, METRIC, less_is_better=True) if fair else ()
    values, differences = ([row.json() for row in rows if bool(row.against) is tested] for tested in (False, True))
    return {
        "task": "prediction",
        "version": __version__,
        "rows": values,
        "differences": differences,
        "floor": {"models": list(FLOOR_MODELS), "ade_m": floor},
        "flagged": {name: mean for name, mean in means.items() if name not in fair},
        "answers": {file.stem: sha256_of_file(file) for file in files},
    }


def publish_round(folder: Path, out: Path) -> None:
    """Write everything that the public needs: the public part, salt and plan, answers, the board and its page.

    Raises:
        InputError: The round has no scores, or the folder cannot be written.
    """
    private, scores = folder / PRIVATE, folder / SCORES
    read_plan(private)
    board = read_content(scores / BOARD_FILE, "rows", "differences", "floor", "flagged", "refused", "submissions")
    told = read_content(folder / PUBLIC / ROUND_FILE, "commitment", "episodes")
    of_round = {"commitment": told["commitment"], "split": "sealed", "episodes": told["episodes"]}
    content = {**board, **of_round, "salt": (private / SALT_FILE).read_text(encoding="ascii").strip()}
    with writing(out, "new folder"):
        shutil.copytree(folder / PUBLIC, out)
        shutil.copytree(private / "sources", out / "sources")
        shutil.copytree(scores / ANSWERS, out / ANSWERS)
        for name in (SALT_FILE, PLAN_FILE):
            shutil.copyfile(private / name, out / name)
    write_text(out / BOARD_FILE, json.dumps(content, indent=1) + "\n")
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
            "refused" if name in refused else f"flagged, {flagged[name]:.3f} m" if name in flagged else "ranked",
            known["kind"],
            known["sha256"],
            refused.get(name, ""),
        )
        for name, known in about.items()
    ]
    head = ("submission", "result", "kind", "SHA-256", "reason")
    episodes = [(one["name"], one["bag_sha256"], one["question_sha256"]) for one in board["episodes"]]
    sealed: list[Row] = [("salt", board["salt"]), ("commitment", board["commitment"]), ("split", board["split"])]
    sealed += [("SIREN", board["version"])]
    floor = board["floor"]
    models = ", ".join(floor["models"])
    text = (
        f"The floor is {floor['ade_m']:.3f} m: for each vehicle the best of all hypotheses of {models}.",
        "A submission below the floor is not ranked before somebody has looked at it.",
    )
    titles = ("episode", "SHA-256 of the bag", "of the question")
    seal = Table("sealed", "The seal", ("what", "value"), tuple(sealed))
    bags = Table("episodes", "Episodes", titles, tuple(episodes), folded=True)
    again = ("The command simulates the episodes again from the salt, and scores the answers again.",)
    given = Table("submissions", "Submissions", head, tuple(of_submissions))
    sections = (
        Section("board", "Board", text, tables=(*tables_of(board), given)),
        Section("seal", "Seal", again, tables=(seal, bags), commands=("siren round verify FOLDER",)),
    )
    lead = f"{len(board['rows'])} of {len(about)} submissions are ranked on {len(episodes)} sealed episodes."
    return Page("Round: trajectory prediction", lead, sections)


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
    if (board["episodes"], board["commitment"]) != (told["episodes"], told["commitment"]):
        wrong.append(f"{BOARD_FILE} is of another round")
    with tempfile.TemporaryDirectory(prefix="siren-verify-") as scratch:
        bags, names = Path(scratch), {one["name"]: one for one in told["episodes"]}
        with ProcessPool(min(processes, len(names))) as pool:
            calls = [(episode, published, bags) for episode in plan["episodes"]]
            for made in pool.map(made_episode, calls, on_episode):
                known, name = names.get(made["name"], {}), made["name"]
                others = [what for what in _HASHED if made[f"{what}_sha256"] != known.get(f"{what}_sha256")]
                wrong += [f"{name}: the {what} does not follow from the salt" for what in others]
                if question_file(published, name).read_text(encoding="utf-8") != made["question"]:
                    wrong.append(f"{name}: the file of the question is another one")
        again = board_of(plan, questions_with_truth(plan, published, bags), published / ANSWERS)
    wrong += [f"{key} of {BOARD_FILE} do not follow from the answers" for key in again if again[key] != board.get(key)]
    return wrong
