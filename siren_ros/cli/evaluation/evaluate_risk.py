"""``siren evaluate risk SET``: how well answers tell normal scenes, near-misses and collisions; also asks models."""

import argparse
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tqdm import tqdm

from siren_ros.cli.options import check_numbers, named_path, positive
from siren_ros.errors import EXIT_OK, InputError, whole_file, writing
from siren_ros.evaluation.risk.answers import REFERENCES, Answers, checked_answers, read_answers
from siren_ros.evaluation.risk.confusion_picture import save_confusions
from siren_ros.evaluation.risk.risk_page import write_page
from siren_ros.evaluation.risk.scoring import ModelScores, score_answers
from siren_ros.evaluation.risk.tables import as_json, confusion_lines, csv_table, latex_table, text_table
from siren_ros.evaluation.risk.video_set import VideoSet, missing_files, read_set
from siren_ros.evaluation.risk.vlm.local_model import LocalModel
from siren_ros.evaluation.risk.vlm.model import MOST_TOKENS, ReplyCache, VisionLanguageModel
from siren_ros.evaluation.risk.vlm.openai_server import OpenAiServer, key_from
from siren_ros.evaluation.risk.vlm.pipeline import account, ask_about_all, write_answers


def add_asking(task: argparse.ArgumentParser) -> None:
    """The options."""
    served = task.add_argument_group("asking a model behind a server that speaks OpenAI's protocol")
    served.add_argument("--base-url", metavar="URL", help="of the server, such as http://localhost:8000/v1")
    served.add_argument(
        "--model", action="append", default=[], metavar="NAME", help="the server's name; may be repeated"
    )
    served.add_argument("--api-key-env", default="", metavar="VAR", help="environment variable with the key (or none)")
    served.add_argument("--concurrency", type=positive, default=4, metavar="N", help="requests at once (default 4)")
    served.add_argument("--retries", type=int, default=5, metavar="N", help="of a failed request (default 5)")
    served.add_argument("--timeout-s", type=float, default=120.0, metavar="S", help="for a whole reply (default 120)")
    local = task.add_argument_group("asking a model in this process: ./env --with vlm-local siren evaluate risk …")
    local.add_argument(
        "--local-model",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="folder of Hugging Face's format; its name is the model's; may be repeated",
    )
    local.add_argument("--device", default="cpu", help="cpu (default) or cuda")
    local.add_argument(
        "--most-tokens", type=positive, default=MOST_TOKENS, metavar="N", help="of an answer (default %(default)s)"
    )
    both = task.add_argument_group("asking any model")
    both.add_argument("--raw", action="store_true", help="plain pictures instead of ones with outlined vehicles")
    both.add_argument("--cache", type=Path, metavar="DIR", help="where replies are kept (default: SET/replies)")
    both.add_argument("--price", type=_prices, metavar="IN,OUT", help="per million tokens, to print what it cost")


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
    check_numbers(arguments, {"retries": (0, 1000), "timeout_s": (0.001, 1e6)})
    for name in arguments.model:
        if arguments.base_url is None:
            raise InputError("base-url", "", "the address of a server, such as http://localhost:8000/v1")
        key = key_from(arguments.api_key_env)
        yield OpenAiServer(arguments.base_url, name, key, arguments.timeout_s, arguments.retries)
    for folder in arguments.local_model:
        yield LocalModel(folder, arguments.device, arguments.most_tokens)


def ask(arguments: argparse.Namespace, videos: VideoSet, model: VisionLanguageModel) -> Answers:
    """Asks a model about every video; what it answered is kept even if the run is interrupted."""
    if missing := missing_files(videos):
        raise InputError("set", f"{len(missing)} videos without their file, first {missing[0]}", "a complete set")
    cache = ReplyCache(arguments.cache or videos.folder / "replies")
    with tqdm(total=len(videos.videos), desc=model.name, unit="video", disable=None) as bar:
        answers = ask_about_all(
            videos,
            model,
            cache,
            marked=not arguments.raw,
            concurrency=arguments.concurrency,
            told=lambda _: _count(bar),
        )
    print("\n".join(account(model.name, answers.values(), arguments.price)))
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        write_answers(arguments.out / f"answers_{file_name(model.name)}.json", answers)
    return {key: answer.final for key, answer in answers.items()}


def _count(bar: "tqdm[Any]") -> None:
    bar.update(1)


def file_name(model: str) -> str:
    """A model's name as a part of a file's name: org/model becomes org_model."""
    return "".join(letter if letter.isalnum() or letter in "-._" else "_" for letter in model)


def add_arguments(task: argparse.ArgumentParser) -> None:
    """Describe the task, and what it takes."""
    task.description = (
        "Scores the answers of vision-language models, or of any other program, to a set of risk videos: accuracy, "
        "precision, recall and F1 of each class, with 95 % intervals over videos, and confusion matrices "
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
    add_asking(task)
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
    for model in models_asked(arguments):
        if model.name in answers:
            raise InputError("model", model.name, "each name once")
        answers[model.name] = ask(arguments, videos, model)
    models = [score_answers(name, videos, given) for name, given in answers.items()]
    print("\n".join(text_table(models, compare_paper=arguments.compare_paper)))
    for scored in models:
        if scored.name not in {"majority", "oracle"}:
            print("\n" + "\n".join(confusion_lines(scored)))
    if arguments.out is not None:
        _write(arguments.out, models, compare_paper=arguments.compare_paper)
    if arguments.page is not None:
        write_page(arguments.page, videos, answers, models)
        print(f"\n{arguments.page}")
    return EXIT_OK


def _write(folder: Path, models: list[ModelScores], *, compare_paper: bool) -> None:
    with writing(folder, "folder"):
        folder.mkdir(parents=True, exist_ok=True)
        tables = {
            "scores.csv": csv_table(models),
            "scores.tex": latex_table(models, compare_paper=compare_paper),
            "scores.json": json.dumps(as_json(models), indent=1) + "\n",
        }
        for name, text in tables.items():
            with whole_file(folder / name) as file:
                file.write_text(text, encoding="utf-8")
        for model in models:
            save_confusions(model, folder / f"confusion_{file_name(model.name)}.png")
