"""Which frames a step of the training gets: a function of seed and step, so that a run that goes on draws the same."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from siren_ros.evaluation.detection.pillars.grid import PillarGrid
from siren_ros.evaluation.detection.pillars.pillars import Pillars, pillars_of
from siren_ros.training.detection.augmentation import varied
from siren_ros.training.detection.frame_store import BagFrames
from siren_ros.training.detection.targets import Targets, targets_of


@dataclass(frozen=True)
class FrameDraws:
    """All frames of the training, in an order that is new in every pass over them."""

    episodes: Sequence[BagFrames]
    grid: PillarGrid
    seed: int
    batch: int

    def __len__(self) -> int:
        return sum(len(episode) for episode in self.episodes)

    def rows(self, step: int) -> list[int]:
        """Numbers of the frames of a step."""
        found = []
        for position in range(step * self.batch, (step + 1) * self.batch):
            turn, place = divmod(position, len(self))
            found.append(int(np.random.default_rng([self.seed, turn]).permutation(len(self))[place]))
        return found

    def batch_of(self, step: int) -> list[tuple[Pillars, Targets]]:
        """Pillars and targets of the frames of a step, varied."""
        random = np.random.default_rng([self.seed, 1, step])
        ends = np.cumsum([len(episode) for episode in self.episodes])
        found = []
        for row in self.rows(step):
            number = int(np.searchsorted(ends, row, side="right"))
            episode = self.episodes[number]
            frame = varied(episode.frame(row - int(ends[number]) + len(episode)), random)
            found.append((pillars_of(frame.points, self.grid), targets_of(frame.boxes, self.grid)))
        return found
