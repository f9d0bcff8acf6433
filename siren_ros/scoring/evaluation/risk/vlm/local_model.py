"""Runs models in this process with Hugging Face transformers, from a folder on this machine."""

import time
from io import BytesIO
from pathlib import Path
from threading import Lock
from typing import Any, Final

from PIL import Image

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.vlm.model import MOST_TOKENS, ModelUnavailableError, Question, Reply

_PARTS: Final = "a folder with a vision-language model that transformers knows, its processor and its chat template"


class LocalModel:
    """A model of transformers' image-text-to-text class; it answers one question at a time."""

    def __init__(self, folder: Path, device: str, most_tokens: int = MOST_TOKENS) -> None:
        """Load the model. It uses no network and runs no code from the folder.

        ``huggingface-cli download NAME --local-dir FOLDER`` makes such a folder; a device is ``cpu`` or ``cuda``.

        Raises:
            InputError: transformers is not installed, or the folder holds no such model.
        """
        try:
            import transformers  # noqa: PLC0415 - an extra
        except ImportError as error:
            runs = "./env --with vlm-local siren evaluate risk …"
            raise InputError("local-model", str(folder), f"the library: run `{runs}`") from error
        if not (folder / "config.json").is_file():
            raise InputError("local-model", str(folder), _PARTS)
        try:
            # Remote code is off: transformers refuses models that need it.
            self._processor: Any = transformers.AutoProcessor.from_pretrained(folder, local_files_only=True)
            model: Any = transformers.AutoModelForImageTextToText.from_pretrained(
                folder, local_files_only=True, dtype="auto"
            )
            self._model = model.to(device).eval()
        except (OSError, ValueError, KeyError, ImportError, RuntimeError) as error:
            raise InputError("local-model", str(folder), f"{_PARTS} ({_first_line(error)})") from error
        if not getattr(self._processor, "chat_template", None):
            raise InputError("local-model", str(folder), f"{_PARTS} (no chat template)")
        self._folder, self._most_tokens, self._lock = folder, most_tokens, Lock()

    @property
    def name(self) -> str:
        """Implements ``VisionLanguageModel.name``: the folder's name."""
        return self._folder.resolve().name

    def answer(self, question: Question) -> Reply:
        """Implements ``VisionLanguageModel.answer``; decoding is greedy, which equals temperature 0."""
        images = [Image.open(BytesIO(picture)).convert("RGB") for picture in question.pictures]
        pictures = [{"type": "image", "image": image} for image in images]
        messages = [
            {"role": "system", "content": [{"type": "text", "text": question.system}]},
            {"role": "user", "content": [*pictures, {"type": "text", "text": question.text}]},
        ]
        with self._lock:
            begin = time.monotonic()
            try:
                inputs = self._processor.apply_chat_template(
                    messages, add_generation_prompt=True, tokenize=True, return_dict=True, return_tensors="pt"
                ).to(self._model.device, dtype=self._model.dtype)
                output = self._model.generate(**inputs, do_sample=False, max_new_tokens=self._most_tokens)
            except (RuntimeError, ValueError, TypeError, IndexError) as error:
                raise ModelUnavailableError(f"{self.name}: {type(error).__name__}: {_first_line(error)}") from error
            seconds = time.monotonic() - begin
        prompt = int(inputs["input_ids"].shape[1])
        answer = output[0, prompt:]
        text = self._processor.decode(answer, skip_special_tokens=True)
        return Reply(str(text), prompt, len(answer), seconds)


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [""])[0]
