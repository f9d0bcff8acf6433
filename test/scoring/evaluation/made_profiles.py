"""Profiles of episodes with what a test is about."""

import numpy as np

from siren_ros.scoring.evaluation.diversity import InteractionProfile


def profile(
    seed: int = 0,
    *happenings: str,
    way: tuple[tuple[float, float], ...] = ((0.0, 0.0),),
    level: str = "L2",
    **parameters: float,
) -> InteractionProfile:
    return InteractionProfile(
        f"bag{seed}", "S2", level, seed, "town", "", parameters, np.array(way, dtype=np.float64), happenings
    )
