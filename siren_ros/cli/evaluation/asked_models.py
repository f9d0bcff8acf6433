"""Options of ``siren evaluate risk`` that ask vision-language models, and how they are asked."""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tqdm import tqdm

from siren_ros.cli.generation.positive import positive
from siren_ros.cli.options.numbers import check_numbers
from siren_ros.errors import InputError
from siren_ros.evaluation.risk.answers import Answers
from siren_ros.evaluation.risk.reports.cost import account
from siren_ros.evaluation.risk.video_set import VideoSet, missing_files
from siren_ros.evaluation.risk.vlm.local_model import LocalModel
from siren_ros.evaluation.risk.vlm.model import MOST_TOKENS, VisionLanguageModel
from siren_ros.evaluation.risk.vlm.openai_server import OpenAiServer, key_from
from siren_ros.evaluation.risk.vlm.pipeline import ask_about_all, write_answers
from siren_ros.evaluation.risk.vlm.reply_cache import ReplyCache


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
