"""Smooths the staircase edges of a drawn picture.

Where two colours meet along a row or a column, the ends of the run tell where the true edge lies, and the pixels beside
it get their share of both (morphological anti-aliasing: Reshetov, HPG 2009). That costs a fraction of several samples
per pixel, and labels keep their single sample.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.compiled import Array, compiled

_CONTRAST: Final = 20
"""Smallest difference in brightness (of 255) between two pixels that counts as an edge."""
_BELOW: Final = 1
_RIGHT: Final = 2


def smooth_edges(rgba: npt.NDArray[np.uint8]) -> None:
    """Smooth the colours in place; shape ``(height, width, 4)``. The fourth channel does not change."""
    height, width = rgba.shape[:2]
    edges = np.zeros((height, width), np.uint8)
    brightness = np.empty((height, width), np.int16)
    _find_edges(rgba, brightness, edges)
    drawn = rgba.copy()
    _smooth_along_rows(drawn, edges, rgba)
    _smooth_along_columns(drawn, edges, rgba)


_RED, _GREEN, _BLUE = range(3)


@compiled
def _find_edges(rgba: Array, brightness: Array, edges: Array) -> None:
    """Mark edges with two bits per pixel.

    One bit says that the pixel differs from the pixel below, the other that it differs from the one to its right.
    """
    height, width = edges.shape
    for y in range(height):
        for x in range(width):
            red, green, blue = np.int16(rgba[y, x, _RED]), np.int16(rgba[y, x, _GREEN]), np.int16(rgba[y, x, _BLUE])
            brightness[y, x] = (red * np.int16(2) + green * np.int16(5) + blue) >> np.int16(3)
    contrast = np.int16(_CONTRAST)
    for y in range(height):
        for x in range(width - 1):
            step = brightness[y, x + 1] - brightness[y, x]
            edges[y, x] = np.uint8(_RIGHT) * np.uint8((step > contrast) | (step < -contrast))
        if y + 1 < height:
            for x in range(width):
                step = brightness[y + 1, x] - brightness[y, x]
                edges[y, x] |= np.uint8(_BELOW) * np.uint8((step > contrast) | (step < -contrast))


@compiled
def _smooth_along_rows(drawn: Array, edges: Array, out: Array) -> None:
    height, width = edges.shape
    for y in range(height):
        start = -1
        for x in range(width + 1):
            if x < width and edges[y, x] & _BELOW:
                start = x if start < 0 else start
            elif start >= 0:
                _blend_run(drawn, edges, out, y, start, x, True)
                start = -1


@compiled
def _smooth_along_columns(drawn: Array, edges: Array, out: Array) -> None:
    """Smooth the horizontal edges. It reads memory row by row, so the runs of all columns are open at the same time."""
    height, width = edges.shape
    starts = np.full(width, -1, np.int32)
    for y in range(height + 1):
        for x in range(width):
            if y < height and edges[y, x] & _RIGHT:
                starts[x] = y if starts[x] < 0 else starts[x]
            elif starts[x] >= 0:
                _blend_run(drawn, edges, out, x, starts[x], y, False)
                starts[x] = -1


@compiled
def _turn(edges: Array, line: int, place: int, lies: bool, short: bool) -> int:
    """Find where an edge after ``line`` turns.

    It gives 1 where the edge turns towards the line between ``place`` and the next pixel, −1 where it turns away, 0
    otherwise.

    A straight edge has steps of one pixel along rows or columns. Where both sides are longer, there is a corner.
    """
    size = edges.shape[0] if lies else edges.shape[1]
    bit = _RIGHT if lies else _BELOW
    turn = 0
    for beside, beyond, side in ((line, line - 1, 1), (line + 1, line + 2, -1)):
        here = edges[beside, place] if lies else edges[place, beside]
        if here & bit:
            if not short and 0 <= beyond < size and (edges[beyond, place] if lies else edges[place, beyond]) & bit:
                return 0
            turn += side
    return turn


@compiled
def _blend_run(drawn: Array, edges: Array, out: Array, line: int, start: int, stop: int, lies: bool) -> None:
    """Blend the pixels along an edge between a line of pixels and the next; ``lies`` says that the lines are rows.

    The true edge leads from half a pixel beside the run's end, where it turns, to the run's middle.
    """
    size = edges.shape[1] if lies else edges.shape[0]
    short = stop - start == 1
    first = _turn(edges, line, start - 1, lies, short) if start > 0 else 0
    last = _turn(edges, line, stop - 1, lies, short) if stop < size else 0
    if (first == 0 and last == 0) or (first == last and _is_thin(edges, line, start, stop, first, lies)):
        return
    reach = 0.5 * (stop - start)
    for k in range(start, stop):
        if first != 0:
            _mix(drawn, out, line, k, first * _share(k - start, reach), lies)
        if last != 0:
            _mix(drawn, out, line, k, last * _share(stop - 1 - k, reach), lies)


@compiled
def _is_thin(edges: Array, line: int, start: int, stop: int, side: int, lies: bool) -> bool:
    """Whether a run borders a line that is one pixel thin; such lines are not smoothed."""
    other = line - side
    if stop - start == 1:
        return True
    if other < 0:
        return False
    if lies:
        return bool(edges[other, start] & edges[other, stop - 1] & _BELOW)
    return bool(edges[start, other] & edges[stop - 1, other] & _RIGHT)


@compiled
def _share(pixel: int, reach: float) -> float:
    """Share of a pixel below the true edge, which falls from ½ at the end of the run to 0 at ``reach`` pixels."""
    far = min(pixel + 1.0, reach)
    return 0.5 * (far - pixel) * (1.0 - 0.5 * (pixel + far) / reach) if far > pixel else 0.0


@compiled
def _mix(drawn: Array, out: Array, line: int, place: int, share: float, lies: bool) -> None:
    weight = int(256.0 * abs(share) + 0.5)
    if weight == 0:
        return
    near, far = (line, line + 1) if share > 0.0 else (line + 1, line)
    y, x, other_y, other_x = (near, place, far, place) if lies else (place, near, place, far)
    for c in range(3):
        own = int(drawn[y, x, c])
        value = int(out[y, x, c]) + ((weight * (int(drawn[other_y, other_x, c]) - own) + 128) >> 8)
        out[y, x, c] = min(max(value, 0), 255)
