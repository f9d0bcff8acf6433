"""Where the repository and what stands beside it lie, for tests of every folder."""

from pathlib import Path
from typing import Final

REPOSITORY: Final = Path(__file__).resolve().parents[1]
SHARED: Final = REPOSITORY.parent / "shared"
"""Large maps, weights and the paper's source; tests that use them skip where they are absent."""
