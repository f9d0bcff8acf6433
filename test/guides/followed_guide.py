"""Follows a guide of ``docs/how_to_add`` in a copy of the repository, to the letter."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from repository import REPOSITORY

MOST_CHANGED = 2
"""Files that a guide may change besides its new ones."""
_BLOCK = re.compile(r'^( *)```(\w+)(?: title="([^"]+)")?\n(.*?)^\1```$', re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class FollowedGuide:
    """A copy of the repository in which the guide was followed."""

    root: Path
    commands: tuple[str, ...]

    def run(self, command: str) -> subprocess.CompletedProcess[str]:
        """Runs a command of the guide as its reader would, in the copy."""
        words = shlex.split(command.removeprefix("./env "))
        runs = {"siren": [sys.executable, "-m", "siren_ros.cli.main"], "python": [sys.executable]}
        typed, changed = [*runs[words[0]], *words[1:]], {"PYTHONPATH": str(self.root), "AMENT_PREFIX_PATH": ""}
        options = {"cwd": self.root, "env": {**os.environ, **changed}, "capture_output": True, "text": True}
        return subprocess.run(typed, check=False, timeout=300.0, **options)


def follow(guide: str, root: Path) -> FollowedGuide:
    """Follows ``docs/how_to_add/GUIDE.md`` in a new copy below ``root``."""
    for folder in ("siren_ros", "params"):
        shutil.copytree(REPOSITORY / folder, root / folder)
    shutil.copy(REPOSITORY / "package.xml", root)
    text = (REPOSITORY / "docs" / "how_to_add" / f"{guide}.md").read_text(encoding="utf-8")
    changed: set[str] = set()
    commands: list[str] = []
    for indent, language, title, indented in _BLOCK.findall(text):
        content = re.sub(rf"^{indent}", "", indented, flags=re.MULTILINE)
        if language == "console":
            typed = [line.removeprefix("$ ") for line in content.splitlines() if line.startswith("$ ")]
            for copy in (line.split() for line in typed if line.startswith("cp ")):
                shutil.copy(root / copy[1], root / copy[2])
            commands += [line for line in typed if not line.startswith("cp ")]
        elif language == "diff":
            if (REPOSITORY / title).exists():
                changed.add(title)
            apply(root / title, content)
        elif title:
            assert not (root / title).exists(), title
            (root / title).parent.mkdir(parents=True, exist_ok=True)
            (root / title).write_text(content, encoding="utf-8")
    assert len(changed) <= MOST_CHANGED
    return FollowedGuide(root, tuple(commands))


def apply(file: Path, diff: str) -> None:
    """Applies a diff without line numbers: its unchanged and removed lines stand exactly once in the file."""
    lines = diff.splitlines()
    before = "".join(f"{line[1:]}\n" for line in lines if not line.startswith("+"))
    after = "".join(f"{line[1:]}\n" for line in lines if not line.startswith("-"))
    text = file.read_text(encoding="utf-8")
    assert text.count(before) == 1, f"{file.name}: the guide's lines stand {text.count(before)} times:\n{before}"
    file.write_text(text.replace(before, after), encoding="utf-8")
