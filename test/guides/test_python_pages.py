"""The programs of the pages about Python, run as a reader would, in an empty folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from repository import REPOSITORY

LIBRARY = ("Make an episode", "Read a record", "Score predictions", "Grade a driver", "In a notebook")
"""Sections that follow each other in one program; the study of the next one is as long as its episodes."""
_BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def program_of(page: str, *sections: str) -> str:
    """The Python blocks of some sections of a page, in their order; of all before the first section without any."""
    text = (REPOSITORY / "docs" / page).read_text(encoding="utf-8")
    head, *parts = re.split(r"^## (.+)\n", text, flags=re.MULTILINE)
    of = dict(zip(parts[::2], parts[1::2], strict=True))
    chosen = [of[section] for section in sections] or [head]
    return "\n".join(block for part in chosen for block in _BLOCK.findall(part))


def output_of(program: str, folder: Path) -> str:
    """What it prints, bars of tqdm left out; warnings are errors."""
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", program],
        cwd=folder,
        env={**os.environ, "TQDM_DISABLE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_learning(tmp_path: Path) -> None:
    pytest.importorskip("pettingzoo", reason="the extra learn is not installed")
    one, several = program_of("learning.md"), program_of("learning.md", "Several drivers")
    output_of(f"{one}\n{program_of('learning.md', 'Episodes')}\nenv.close()\n{several}\nenv.close()", tmp_path)


def test_the_library(tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    printed = output_of(program_of("library.md", *LIBRARY), tmp_path)
    assert "residual_m" in printed
    assert "ade_m" in printed
    assert "Certificate(driver=" in printed
    assert (tmp_path / "bags" / "from_python").is_dir()
