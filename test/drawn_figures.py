"""What a figure shows, as plain values: two pictures that look alike have the same."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Annotation, Text


def shown(figure: Figure) -> list[Any]:
    """The axes from top left on, each before those in it, then texts and legends of the figure itself."""
    every = [part for axes in figure.axes for part in (axes, *axes.child_axes)]
    return [_axes(axes) for axes in every] + [[_text(text) for text in figure.texts], *_legends(figure.legends)]


def _axes(axes: Axes) -> dict[str, Any]:
    legend = axes.get_legend()
    titles = [axes.get_title(loc=loc) for loc in ("left", "center", "right")]
    told = {
        "titles": [*titles, axes.get_xlabel(), axes.get_ylabel()],
        "limits": [*axes.get_xlim(), *axes.get_ylim()],
        "artists": list(_artists(axes, ["", *titles])),
        "legend": list(_legends([] if legend is None else [legend])),
        "images": [[*image.get_array().shape, float(image.get_array().mean())] for image in axes.images],
    }
    return {name: value for name, value in told.items() if value}


def _artists(axes: Axes, titles: list[str]) -> Iterator[list[Any]]:
    looks: dict[tuple[Any, ...], list[np.ndarray]] = {}
    for artist in axes.get_children():
        if isinstance(artist, Text):
            if isinstance(artist, Annotation) or artist.get_text() not in titles:
                yield _text(artist)
        elif isinstance(artist, Line2D | Collection) or (isinstance(artist, Patch) and artist is not axes.patch):
            looks.setdefault(_look(artist), []).extend(_places(artist))
    for look, places in looks.items():
        if places:
            yield [*look, len(places), *_summary(places)]


def _look(artist: Artist) -> tuple[Any, ...]:
    label = str(artist.get_label())
    colours: Any = artist.get_color() if isinstance(artist, Line2D) else artist.get_facecolor()
    edges: Any = "none" if isinstance(artist, Line2D) else artist.get_edgecolor()
    width: Any = artist.get_linewidth()  # type: ignore[attr-defined] # all of these have one
    return (
        type(artist).__name__.removesuffix("Collection"),
        "" if label.startswith("_") else label,
        *(_colour(colour) for colour in (colours, edges)),
        round(float(np.mean(width)), 3),
        artist.get_zorder(),
    )


def _colour(colour: Any) -> str:
    rows = np.asarray(colour, dtype=object)
    if rows.ndim == 2:
        return " ".join(dict.fromkeys(to_hex(tuple(row), keep_alpha=True) for row in rows[:4])) if len(rows) else "none"
    return "none" if isinstance(colour, str) and colour == "none" else to_hex(colour, keep_alpha=True)


def _places(artist: Artist) -> Iterator[np.ndarray]:
    if isinstance(artist, Line2D):
        yield np.asarray(artist.get_xydata(), dtype=float)
    elif isinstance(artist, Patch):
        yield artist.get_patch_transform().transform(artist.get_path().vertices)
    elif isinstance(artist, Collection):
        offsets = np.asarray(artist.get_offsets(), dtype=float)
        paths = [path.vertices for path in artist.get_paths()]
        yield from [offsets] if len(offsets) and np.abs(offsets).any() else paths


def _summary(places: list[np.ndarray]) -> list[float]:
    """First point, mean and spread."""
    points = np.concatenate(places)
    points = points[np.isfinite(points).all(axis=1)]
    return [*points[0], *points.mean(axis=0), *points.std(axis=0)] if len(points) else []


def _text(text: Text) -> list[Any]:
    return [text.get_text(), *(float(value) for value in getattr(text, "xy", text.get_position()))]


def _legends(legends: Iterable[Any]) -> Iterator[list[str]]:
    for legend in legends:
        yield [text.get_text() for text in legend.get_texts()]
