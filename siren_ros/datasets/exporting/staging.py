"""The hidden folder in which a dataset grows, and its move to the final name when it is whole."""

import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError, writing

_JOB: Final = "job.json"
_DATASET: Final = "dataset"


class Staging:
    """``.NAME.partial`` beside the dataset's final place. What is finished in it is kept for the next try."""

    def __init__(self, out: Path) -> None:
        self.out = Path(os.path.abspath(out))  # noqa: PTH100 - without following a link that is there already
        self.path = self.out.parent / f".{self.out.name}.partial"

    def check_free(self) -> None:
        """Refuses a final place that is taken.

        Raises:
            InputError: Something is there already that is not an empty folder.
        """
        with writing(self.out, "place"):
            link = self.out.is_symlink()  # the move to the final name would not follow it
            taken = link or (self.out.exists() and (not self.out.is_dir() or any(self.out.iterdir())))
        if taken:
            raise InputError("out", str(self.out), "a folder that is new or empty")

    @contextmanager
    def opened(self, job: Mapping[str, Any]) -> Iterator[None]:
        """Makes the folder, or takes up what an interrupted export of the same job left in it.

        Raises:
            InputError: Another job's unfinished export is there, somebody else writes it now, or it cannot be made.
        """
        new = not self.path.exists()
        try:
            with writing(self.path, "place"):
                self.path.mkdir(parents=True, exist_ok=True)
                with (self.path / ".lock").open("w") as file:
                    try:
                        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    except BlockingIOError as error:
                        raise InputError("out", str(self.out), "a folder that no other export is writing") from error
                    self._check_job(job)
                    yield
        finally:
            if new and not any(self.path.glob("parts/*.json")):
                self.remove()

    def _check_job(self, job: Mapping[str, Any]) -> None:
        text = json.dumps(job, indent=2, sort_keys=True) + "\n"
        file = self.path / _JOB
        if not file.exists():
            file.write_text(text, encoding="utf-8")
        elif file.read_text(encoding="utf-8") != text:
            allowed = f"a place without an unfinished export of other bags or options; remove {self.path} or finish it"
            raise InputError("out", str(self.out), allowed)

    def part(self, index: int) -> Path:
        """Folder of one episode's files."""
        return self.path / "parts" / f"{index:06d}"

    def report_of(self, index: int) -> dict[str, Any] | None:
        """What was noted of a finished part; None where it is not finished."""
        file = self.part(index).with_suffix(".json")
        with suppress(OSError, ValueError):
            found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
            return found
        return None

    def finish_part(self, index: int, report: Mapping[str, Any]) -> None:
        """Notes that a part is finished."""
        file = self.part(index).with_suffix(".json")
        growing = file.with_suffix(".growing")
        with writing(file, "place"):
            growing.write_text(json.dumps(report), encoding="utf-8")
            growing.replace(file)

    def new_part(self, index: int) -> Path:
        """An empty folder for a part; what an interrupted try left in it goes away."""
        folder = self.part(index)
        with writing(folder, "place"):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
        return folder

    def new_dataset(self) -> Path:
        """An empty folder for the assembled dataset."""
        folder = self.path / _DATASET
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return folder

    def publish(self) -> None:
        """Gives the assembled dataset its final name; InputError where that has been taken meanwhile."""
        with writing(self.out, "place"):
            (self.path / _DATASET).rename(self.out)
        self.remove()

    def publish_part(self, index: int) -> None:
        """Gives the files of one finished part the dataset's final name; InputError as ``publish``."""
        with writing(self.out, "place"):
            self.part(index).rename(self.out)
        self.remove()

    def remove(self) -> None:
        """Takes the hidden folder away."""
        shutil.rmtree(self.path, ignore_errors=True)


def link(source: Path, target: Path) -> None:
    """Gives a file a second name, or copies it where the file system has no links."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        target.hardlink_to(source)
    except (OSError, NotImplementedError):  # no links on this file system, or in this Python
        shutil.copyfile(source, target)


def link_tree(source: Path, target: Path) -> None:
    """Links all files below a folder to the same places below another one."""
    for path in sorted(source.rglob("*")):
        if path.is_file():
            link(path, target / path.relative_to(source))
        else:
            (target / path.relative_to(source)).mkdir(parents=True, exist_ok=True)
