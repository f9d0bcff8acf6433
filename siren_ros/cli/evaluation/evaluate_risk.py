"""``siren evaluate risk SET --predictions NAME=FILE``: how well models judge the risk in videos."""

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tqdm import tqdm

from siren_ros.cli.evaluation.named_path import named_path
from siren_ros.cli.generation.positive import positive
from siren_ros.errors import EXIT_OK, InputError
from siren_ros.evaluation.risk.answers import Answers, checked_answers, read_answers
from siren_ros.evaluation.risk.page.risk_page import write_page
from siren_ros.evaluation.risk.references import REFERENCES
from siren_ros.evaluation.risk.reports.confusion_picture import save_confusions
from siren_ros.evaluation.risk.reports.tables import as_json, confusion_lines, csv_table, latex_table, text_table
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.scoring import ModelScores, score_answers
from siren_ros.evaluation.risk.video_set import VideoSet, missing_files, read_set
from siren_ros.evaluation.risk.vlm.openai_server import OpenAiServer, key_from
from siren_ros.evaluation.risk.vlm.pipeline import VideoAnswer, ask_about_all, write_answers
from siren_ros.evaluation.risk.vlm.reply_cache import ReplyCache


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Describe the task, and what it takes."""
    task.description = (
        "Scores the answers of vision-language models, or of any other program, to a set of risk videos: accuracy, "
        "precision, recall and F1 of each class, with 95 % intervals by bootstrap over videos, and confusion matrices "
        "overall and by template. References to compare with: the most frequent class, a small network that sees each "
        "second frame, and the record's own measures."
    )
    task.add_argument("set", type=Path, metavar="SET", help="folder that `siren generate risk` made")
    task.add_argument(
        "--predictions",
        type=named_path,
        action="append",
        default=[],
        metavar="NAME=FILE",
        help='answers, JSON {"S1_000": "Normal", …} or CSV with the columns video and class; may be repeated',
    )
    task.add_argument(
        "--references",
        nargs="*",
        choices=list(REFERENCES),
        default=list(REFERENCES),
        help=f"rows to compare with (default {' '.join(REFERENCES)})",
    )
    asked = task.add_argument_group("asking a model behind a server that speaks OpenAI's protocol")
    asked.add_argument("--base-url", metavar="URL", help="of the server, such as http://localhost:8000/v1")
    asked.add_argument(
        "--model", action="append", default=[], metavar="NAME", help="the server's name; may be repeated"
    )
    asked.add_argument("--api-key-env", default="", metavar="VAR", help="environment variable with the key (or none)")
    asked.add_argument("--raw", action="store_true", help="plain pictures instead of ones with outlined vehicles")
    asked.add_argument("--concurrency", type=positive, default=4, metavar="N", help="requests at once (default 4)")
    asked.add_argument("--retries", type=int, default=5, metavar="N", help="of a failed request (default 5)")
    asked.add_argument("--timeout-s", type=float, default=120.0, metavar="S", help="of a request (default 120)")
    asked.add_argument("--cache", type=Path, metavar="DIR", help="where replies are kept (default: SET/replies)")
    asked.add_argument("--price", type=_prices, metavar="IN,OUT", help="per million tokens, to print what it cost")
    task.add_argument("--allow-missing", action="store_true", help="score the videos that have an answer")
    task.add_argument("--compare-paper", action="store_true", help="print the paper's rows, too")
    task.add_argument("--out", type=Path, metavar="DIR", help="write CSV, LaTeX, JSON and pictures there")
    task.add_argument(
        "--page", type=Path, metavar="FILE", help="write an HTML page that plays each video next to all answers"
    )
    task.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Scores every file of answers."""
    videos = read_set(arguments.set)
    answers: dict[str, Answers] = {name: REFERENCES[name](videos) for name in dict.fromkeys(arguments.references)}
    for name, path in arguments.predictions:
        if name in {*answers, *REFERENCES}:
            raise InputError("predictions", name, "each name once, and none of " + ", ".join(REFERENCES))
        answers[name] = checked_answers(read_answers(path), videos.videos, allow_missing=arguments.allow_missing)
    for name in arguments.model:
        if name in answers:
            raise InputError("model", name, "each name once")
        answers[name] = _asked(arguments, videos, name)
    models = [score_answers(name, videos, given) for name, given in answers.items()]
    print("\n".join(text_table(models, compare_paper=arguments.compare_paper)))
    for model in models:
        if model.name not in {"majority", "oracle"}:
            print("\n" + "\n".join(confusion_lines(model)))
    if arguments.out is not None:
        _write(arguments.out, models, compare_paper=arguments.compare_paper)
    if arguments.page is not None:
        write_page(arguments.page, videos, answers, models)
        print(f"\n{arguments.page}")
    return EXIT_OK


def _prices(text: str) -> tuple[float, float]:
    try:
        prompt, completion = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not two prices such as 0.5,1.5") from None
    return prompt, completion


def _asked(arguments: argparse.Namespace, videos: VideoSet, name: str) -> dict[str, RiskClass | None]:
    """Asks a model about every video; what it answered is kept even if the run is interrupted."""
    if arguments.base_url is None:
        raise InputError("base-url", "", "the address of a server, such as http://localhost:8000/v1")
    if missing := missing_files(videos):
        raise InputError("set", f"{len(missing)} videos without their file, first {missing[0]}", "a complete set")
    key = key_from(arguments.api_key_env)
    server = OpenAiServer(arguments.base_url, name, key, arguments.timeout_s, max(0, arguments.retries))
    cache = ReplyCache(arguments.cache or videos.folder / "replies")
    with tqdm(total=len(videos.videos), desc=name, unit="video", disable=None) as bar:
        answers = ask_about_all(
            videos,
            server,
            cache,
            marked=not arguments.raw,
            concurrency=arguments.concurrency,
            told=lambda _: _count(bar),
        )
    print("\n".join(_account(name, answers, arguments.price)))
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        write_answers(arguments.out / f"answers_{file_name(name)}.json", answers)
    return {key: answer.final for key, answer in answers.items()}


def _count(bar: "tqdm[Any]") -> None:
    bar.update(1)


def file_name(model: str) -> str:
    """A model's name as a part of a file's name: org/model becomes org_model."""
    return "".join(letter if letter.isalnum() or letter in "-._" else "_" for letter in model)


def _account(name: str, answers: Mapping[str, VideoAnswer], prices: tuple[float, float] | None) -> list[str]:
    """Questions, what could not be read, tokens and cost."""
    replies = [reply for answer in answers.values() for reply in answer.replies]
    unreadable = sum(prediction is None for answer in answers.values() for prediction in answer.predictions)
    cached = sum(answer.cached for answer in answers.values())
    tokens = sum(reply.prompt_tokens for reply in replies), sum(reply.completion_tokens for reply in replies)
    line = f"{name}: {len(replies)} questions, {cached} of them answered before, {unreadable} answers unreadable"
    line += f"; {tokens[0]} tokens in, {tokens[1]} out"
    if prices is not None:
        line += f", cost {(tokens[0] * prices[0] + tokens[1] * prices[1]) / 1e6:.2f}"
    return [line]


def _write(folder: Path, models: list[ModelScores], *, compare_paper: bool) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder.joinpath("scores.csv").write_text(csv_table(models), encoding="utf-8")
        folder.joinpath("scores.tex").write_text(latex_table(models, compare_paper=compare_paper), encoding="utf-8")
        folder.joinpath("scores.json").write_text(json.dumps(as_json(models), indent=1) + "\n", encoding="utf-8")
        for model in models:
            save_confusions(model, folder / f"confusion_{file_name(model.name)}.png")
    except OSError as error:
        raise InputError("out", str(folder), f"a folder that can be written ({error.strerror or error})") from error
