"""Array types by what they hold. Shapes and units stand where the arrays are used."""

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
