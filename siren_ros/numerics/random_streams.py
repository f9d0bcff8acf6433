"""Independent random generators, one per purpose and actor, all from the episode's one seed."""

import numpy as np


def random_stream(seed: int, purpose: str, index: int = 0) -> np.random.Generator:
    """A generator that depends on seed, purpose and index alone, and on nothing drawn elsewhere.

    Args:
        seed: The episode's seed, at least 0.
        purpose: What the numbers are for: ``demand``, ``response``; part of the stream's identity.
        index: Tells streams of one purpose apart, an actor id for example; at least 0.
    """
    return np.random.default_rng(np.random.SeedSequence([seed, index, *purpose.encode()]))
