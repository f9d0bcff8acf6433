"""What goes into a page."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

MODELS: Final = ("cv", "idm", "siren")
DETECTION: Final = "detection"
RISK: Final = "risk"
FILM_S: Final = 10.0


@dataclass(frozen=True)
class PageOptions:
    """What goes into a page."""

    models: tuple[str, ...] = MODELS
    """Trajectory predictors that are scored on the bags."""
    detection: Path | None = None
    """Where ``siren evaluate detection --out`` wrote; None: the folder ``detection`` of the study."""
    risk: Path | None = None
    """Where ``siren evaluate risk --out`` wrote; None: the folder ``risk`` of the study."""
    jobs: int = 1
    film_s: float = FILM_S
    """Length of the films."""

    def detection_in(self, folder: Path) -> Path:
        """Where the detectors' scores of a study are."""
        return self.detection or folder / DETECTION

    def risk_in(self, folder: Path) -> Path:
        """Where the risk task's scores of a study are."""
        return self.risk or folder / RISK
