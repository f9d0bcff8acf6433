"""``siren evaluate risk SET``: how well answers tell normal scenes, near-misses and collisions; also asks models."""

import argparse
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from tqdm import tqdm

from siren_ros.base.tables import text_of
from siren_ros.cli.options import add_named_paths, check_numbers, positive, steps_of
from siren_ros.errors import EXIT_OK, InputError, write_text, writing
from siren_ros.scoring.evaluation.risk.people import PEOPLE, agreement, consensus, read_rating, write_rating_page
from siren_ros.scoring.evaluation.risk.report import (
    save_confusions,
    scores_as_json,
    table_of_agreement,
    table_of_changes,
    table_of_severity,
    tables_of,
    write_page,
)
from siren_ros.scoring.evaluation.risk.scoring import (
    REFERENCES,
    Answers,
    ModelScores,
    checked_answers,
    read_answers,
    read_severities,
    score_answers,
)
from siren_ros.scoring.evaluation.risk.sequence_model import CHANGES, Control, load_sequence_model, sequence_answers
from siren_ros.scoring.evaluation.risk.video_set import VideoSet, missing_files, read_set
from siren_ros.scoring.evaluation.risk.vlm.clients import CLIENTS
from siren_ros.scoring.evaluation.risk.vlm.pipeline import (
    ReplyCache,
    VisionLanguageModel,
    account,
    ask_about_all,
    write_answers,
)
from siren_ros.scoring.evaluation.scores import csv_of
from siren_ros.simulation.scenario.episode import overlap_warning

_SEQUENCE: Final = "sequence"
_UNKNOWN: Final = f"{_SEQUENCE}: its card does not list the episodes of its training, so no overlap is noticed"


def add_asking(task: argparse.ArgumentParser) -> None:
    """Adds the options for asking models."""
    for client in CLIENTS:
        group = task.add_argument_group(client.title)
        for name, setting in client.settings.items():
            group.add_argument(
                f"--{name.replace('_', '-')}",
                type=setting.kind,
                action="append" if setting.repeated else "store",
                default=[] if setting.repeated else setting.default,
                metavar=setting.metavar,
                help=setting.help,
            )
    both = task.add_argument_group("asking any model")
    both.add_argument(
        "--concurrency", type=positive, default=4, metavar="N", help="questions at the same time (default 4)"
    )
    both.add_argument(
        "--controls",
        nargs="*",
        choices=[control.value for control in Control],
        default=[],
        help="also ask with less: grey pictures, pictures in another order, the middle one alone, none; or with a "
        "picture every 0.2 s (dense); a row for each model and control, and for the reference sequence",
    )
    both.add_argument("--raw", action="store_true", help="pictures without outlines of the vehicles")
    both.add_argument("--cache", type=Path, metavar="DIR", help="folder of the replies (default: SET/replies)")
    both.add_argument("--price", type=_prices, metavar="IN,OUT", help="prices per million tokens; prints the cost")


def _prices(text: str) -> tuple[float, float]:
    try:
        prompt, completion = (float(part) for part in text.split(","))
    except ValueError:
        prompt = completion = math.nan
    if not (0.0 <= prompt < math.inf and 0.0 <= completion < math.inf):
        raise argparse.ArgumentTypeError(f"{text!r} is not two prices such as 0.5,1.5")
    return prompt, completion


def models_asked(arguments: argparse.Namespace) -> Iterator[VisionLanguageModel]:
    """The models, one after another; a local one is loaded when its turn comes.

    Raises:
        InputError: A number outside its limits, a server without address, a key that is not set, or a folder without a
            model.
    """
    settings = {name: setting for client in CLIENTS for name, setting in client.settings.items()}
    check_numbers(arguments, {name: setting.limits for name, setting in settings.items() if setting.limits})
    for client in CLIENTS:
        yield from client.models(vars(arguments))


def ask(
    arguments: argparse.Namespace, videos: VideoSet, model: VisionLanguageModel, control: Control | None = None
) -> Answers:
    """Asks a model about every video; what it answered is kept even if the run is interrupted."""
    if missing := missing_files(videos):
        raise InputError("set", f"{len(missing)} videos without their file, first {missing[0]}", "a complete set")
    cache = ReplyCache(arguments.cache or videos.folder / "replies")
    with tqdm(total=len(videos.videos), desc=model.name, unit="video", disable=None) as bar:
        step = steps_of(bar)
        answers = ask_about_all(
            videos,
            model,
            cache,
            marked=not arguments.raw,
            concurrency=arguments.concurrency,
            control=control,
            progress=lambda _: step(),
        )
    name = row_name(model.name, control)
    print("\n".join(account(name, answers.values(), arguments.price)))
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        write_answers(arguments.out / f"answers_{file_name(name)}.json", answers)
    return {key: answer.final for key, answer in answers.items()}


def row_name(model: str, control: Control | None) -> str:
    """What the tables call a model that was asked with a control."""
    return model if control is None else f"{model} ({control.value})"


def file_name(model: str) -> str:
    """A model's name as a part of a file's name: org/model becomes org_model."""
    return "".join(letter if letter.isalnum() or letter in "-._" else "_" for letter in model)


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    task.description = (
        "Scores the answers of vision-language models or other programs to a set of risk videos: accuracy, precision, "
        "recall and F1 of each class with 95 % intervals over videos, and confusion matrices overall and by template. "
        "References for comparison are the most frequent class, a small network that sees every second frame, and the "
        "measures of the record."
    )
    task.add_argument("set", type=Path, metavar="SET", help="folder that `siren generate risk` made")
    meaning = 'answers, JSON {"S1_000": "Normal", …} or CSV with the columns video and class'
    add_named_paths(task, "--predictions", "NAME=FILE", meaning)
    task.add_argument(
        "--references",
        nargs="*",
        choices=list(REFERENCES),
        default=list(REFERENCES),
        help=f"rows to compare with (default {' '.join(REFERENCES)})",
    )
    add_asking(task)
    task.add_argument(
        "--people", type=Path, nargs="*", default=[], metavar="FILE", help="answers that pages of `siren rate` saved"
    )
    task.add_argument("--allow-missing", action="store_true", help="score only the videos that have an answer")
    task.add_argument("--compare-paper", action="store_true", help="also print the paper's rows")
    task.add_argument("--out", type=Path, metavar="DIR", help="write CSV, LaTeX, JSON and pictures there")
    task.add_argument(
        "--page", type=Path, metavar="FILE", help="write an HTML page that plays each video next to all answers"
    )
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores every file of answers."""
    videos = read_set(arguments.set)
    answers = _answers(arguments, videos)
    ratings = _ratings(arguments.people, videos)
    if ratings:
        answers |= {PEOPLE: consensus(list(ratings.values())), **ratings}
    models = [score_answers(name, videos, given) for name, given in answers.items()]
    content, remark = scores_as_json(models), ""
    numbers = {name: given for name, path in arguments.predictions if (given := read_severities(path))}
    kappas = agreement(videos, ratings) if ratings else {}
    tables = (
        *tables_of(content, compare_paper=arguments.compare_paper),
        table_of_severity(videos, numbers),
        table_of_changes(videos),
        *((table_of_agreement(kappas),) if kappas else ()),
    )
    if _SEQUENCE in answers:
        content["models"][_SEQUENCE]["seen"] = standings = load_sequence_model().standings(videos)
        remark = overlap_warning(_SEQUENCE, standings) if standings else _UNKNOWN
    print("\n".join([*text_of(tables), *filter(None, (remark,))]))
    if arguments.out is not None:
        files = {
            "scores.csv": csv_of(row for model in models for row in model.rows),
            "scores.tex": "\n".join(table.latex() for table in tables if not table.folded),
            "scores.json": json.dumps(content, indent=1) + "\n",
        }
        _write(arguments.out, files, models)
    if arguments.page is not None:
        write_page(arguments.page, videos, answers, models)
        print(f"\n{arguments.page}")
    return EXIT_OK


def _answers(arguments: argparse.Namespace, videos: VideoSet) -> dict[str, Answers]:
    """Answers of references, files and models, with and without controls, by the name of their row."""
    answers: dict[str, Answers] = {name: REFERENCES[name](videos) for name in dict.fromkeys(arguments.references)}
    controls = [Control(name) for name in dict.fromkeys(arguments.controls)]
    changes = [control for control in controls if control in CHANGES]
    if changes and _SEQUENCE in answers:
        changed = sequence_answers(videos, load_sequence_model(), changes)
        answers |= {row_name(_SEQUENCE, control): given for control, given in changed.items()}
    for name, path in arguments.predictions:
        if name in {*answers, *REFERENCES}:
            raise InputError("predictions", name, "each name once, and none of " + ", ".join(REFERENCES))
        answers[name] = checked_answers(read_answers(path), videos.videos, allow_missing=arguments.allow_missing)
    for model in models_asked(arguments):
        if model.name in answers:
            raise InputError("model", model.name, "each name once")
        answers[model.name] = ask(arguments, videos, model)
        for control in controls:
            answers[row_name(model.name, control)] = ask(arguments, videos, model, control)
    return answers


def _ratings(paths: Sequence[Path], videos: VideoSet) -> dict[str, Answers]:
    ratings: dict[str, Answers] = {}
    for path in paths:
        rater, given = read_rating(path, videos)
        if rater in ratings:
            raise InputError("people", str(path), f"each person once, unlike {rater}")
        ratings[rater] = given
    return ratings


def _write(folder: Path, files: Mapping[str, str], models: Sequence[ModelScores]) -> None:
    with writing(folder, "folder"):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            write_text(folder / name, text)
        for model in models:
            save_confusions(model, folder / f"confusion_{file_name(model.name)}.png")


def add_rate(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Writes a page on which a person labels the videos of a set: blind, in an order of its own, without a network. "
        "The browser keeps the answers; the page saves them as a file for `siren evaluate risk --people`."
    )
    verb.add_argument("set", type=Path, metavar="SET", help="folder that `siren generate risk` made")
    verb.add_argument(
        "--rater", required=True, metavar="NAME", help="the person; decides names and order of the videos"
    )
    verb.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the page; new or empty")
    verb.add_argument("--key-frames", action="store_true", help="show the nine key frames in place of the video")
    verb.set_defaults(run=rate)


def rate(arguments: argparse.Namespace) -> int:
    """Writes the page on which people rate the videos."""
    videos = read_set(arguments.set)
    print(write_rating_page(videos, arguments.rater, arguments.out, pictures=arguments.key_frames))
    return EXIT_OK
