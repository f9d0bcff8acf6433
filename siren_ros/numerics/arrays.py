"""Array types by what they hold, and independent random generators, all from the episode's one seed.

Shapes and units stand where the arrays are used.
"""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Floats32 = npt.NDArray[np.float32]
Points = npt.NDArray[np.float64]
"""Coordinates in metres, ``(N, 2)`` unless said otherwise."""
Matrix = npt.NDArray[np.float64]
Ids = npt.NDArray[np.uint32]
"""Ids of actors."""
Codes = npt.NDArray[np.uint8]
"""Members of an enumeration."""
Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.intp]
"""Indices into other arrays."""


def random_stream(seed: int, purpose: str, index: int = 0) -> np.random.Generator:
    """A generator that depends on seed, purpose and index alone, and on nothing drawn elsewhere.

    Args:
        seed: The episode's seed, at least 0.
        purpose: What the numbers are for: ``demand``, ``response``; part of the stream's identity.
        index: Tells streams of one purpose apart, an actor id for example; at least 0.
    """
    return np.random.default_rng(np.random.SeedSequence([seed, index, *purpose.encode()]))
