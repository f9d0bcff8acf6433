"""What goes into a page."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError
from siren_ros.evaluation.paper_comparison.stored_scores import stored

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

    def check(self) -> None:
        """InputError if a folder that was asked for has no scores: a page without them would not say so."""
        for task, folder in ((DETECTION, self.detection), (RISK, self.risk)):
            if folder is not None and stored(folder) is None:
                raise InputError(task, str(folder), f"a folder that `siren evaluate {task} --out` wrote")
