"""Copies of the working tree in a scratch folder: a mutant is a changed file in one of them."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def copy_working_tree(repository: Path, target: Path) -> None:
    """Copy tracked and new files, and what numba and Python keep next to them, with their times."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],  # noqa: S607 - git of the path
        cwd=repository,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    files = {Path(name) for name in listed.split("\0") if name}
    for folder in {file.parent for file in files if file.suffix == ".py"}:
        files.update(path.relative_to(repository) for path in (repository / folder / "__pycache__").glob("*.*"))
    for file in sorted(files):
        source = repository / file
        if source.is_file():
            (target / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target / file)


@contextmanager
def changed_file(path: Path, text: str) -> Iterator[None]:
    """A file with another text; afterwards it is as it was, with its time, so that what was compiled from it holds."""
    original, times = path.read_bytes(), path.stat()
    path.write_text(text, encoding="utf-8")
    try:
        yield
    finally:
        path.write_bytes(original)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
