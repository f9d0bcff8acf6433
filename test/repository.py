"""Where the repository lies, and the folder of what it does not contain, for tests of every folder."""

import os
from pathlib import Path
from typing import Final

import pytest

REPOSITORY: Final = Path(__file__).resolve().parents[1]
_SHARED: Final = Path(os.environ.get("SIREN_SHARED") or REPOSITORY.parent / "shared").resolve()
"""Maps, weights and the paper's source, which are not the project's; CONTRIBUTING.md says what they are."""


def shared_file(*path: str) -> Path:
    """A file of the shared folder, by its path there; skips the test where it is absent."""
    file = _SHARED.joinpath(*path)
    if not file.is_file():
        pytest.skip(f"needs {'/'.join(path)} in the folder that SIREN_SHARED names")
    return file
