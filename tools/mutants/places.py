"""Which files and lines are changed, and where their tests are."""

import re
import subprocess
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_HUNK: Final = re.compile(r"^@@ -\S+ \+(\d+)(?:,(\d+))? @@")


@dataclass(frozen=True)
class Folder:
    """A folder of the code whose tests are in the folder of the same name."""

    package: str
    """``siren_ros/simulation/behaviour``, or the file itself where it stands directly in its package."""
    tests: str
    """``test/simulation/behaviour``."""


def folder_of(file: str) -> Folder:
    """The folder of a file, at most the second level below its package: a whole wing has too many tests."""
    parts = Path(file).parts
    if len(parts) < 3:
        return Folder(file, f"test/test_{Path(file).name}")
    package, *folders = parts[:-1][:3]
    return Folder("/".join((package, *folders)), "/".join(("test", *folders)))


def mirror_of(file: str) -> str:
    """The file of tests that mirrors a file."""
    path = Path(*Path(file).parts[1:])
    return (Path("test") / path.parent / f"test_{path.name}").as_posix()


def files_below(root: Path, names: Iterable[str]) -> list[str]:
    """The Python files that the names mean, relative to the root, without the ``__init__.py``.

    Raises:
        FileNotFoundError: There is no such file or folder.
    """
    found: set[Path] = set()
    for name in names:
        path = (root / name).resolve()
        if not path.exists():
            raise FileNotFoundError(name)
        found.update(path.rglob("*.py") if path.is_dir() else [path])
    return sorted(path.relative_to(root).as_posix() for path in found if path.name != "__init__.py")


def changed_lines_since(root: Path, revision: str) -> dict[str, set[int]]:
    """The lines, as they are now, that differ from a revision, per Python file; removed lines count for none.

    Raises:
        ValueError: git does not know the revision.
    """
    command = ["git", "diff", "--unified=0", "--no-color", "--no-ext-diff", "--diff-filter=d", revision, "--", "*.py"]
    done = subprocess.run(command, cwd=root, check=False, capture_output=True, text=True)  # noqa: S603 - git
    if done.returncode:
        raise ValueError(done.stderr.strip().splitlines()[0])
    lines: dict[str, set[int]] = defaultdict(set)
    file = ""
    for line in done.stdout.splitlines():
        if line.startswith("+++ "):
            file = line[4:].removeprefix("b/")
        elif hunk := _HUNK.match(line):
            start, count = int(hunk[1]), int(hunk[2] or 1)
            lines[file].update(range(start, start + count))
    return dict(lines)
