"""Labels that do not overlap, and the scale bar."""

import math
from dataclasses import dataclass, field

from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.transforms import Bbox

from siren_ros.pictures.palette import FAINT_TEXT, TEXT

_CHARACTER_WIDTH = 0.56
"""Mean width of a character relative to the font size."""


@dataclass
class LabelPlacer:
    """Places small labels next to points without overlaps; leaves a label out where no place is free."""

    axes: Axes
    font_size: float
    taken: list[Bbox] = field(default_factory=list)

    def place(self, x_m: float, y_m: float, text: str, colour: str) -> bool:
        """Draws a label near a point with a thin leader line; False where no place is free."""
        dots = self.axes.figure.dpi / 72.0
        width, height = _CHARACTER_WIDTH * self.font_size * len(text) * dots, 1.25 * self.font_size * dots
        anchor_x, anchor_y = self.axes.transData.transform((x_m, y_m))
        frame = self.axes.bbox
        for radius in (11.0, 19.0, 28.0, 38.0, 50.0, 64.0):
            for direction in (90, -90, 60, 120, -60, -120, 30, 150, -30, -150):
                dx = radius * math.cos(math.radians(direction)) * 1.3
                dy = radius * math.sin(math.radians(direction))
                centre_x, centre_y = anchor_x + dx * dots, anchor_y + dy * dots
                half = (width / 2.0, height / 2.0)
                box = Bbox.from_extents(centre_x - half[0], centre_y - half[1], centre_x + half[0], centre_y + half[1])
                inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
                if not inside or any(box.overlaps(other) for other in self.taken):
                    continue
                self.taken.append(box)
                self._draw((x_m, y_m), (dx, dy), text, colour)
                return True
        return False

    def block(self, x_m: float, y_m: float, radius_points: float) -> None:
        """Keeps labels off a marker."""
        reach = radius_points * self.axes.figure.dpi / 72.0
        x, y = self.axes.transData.transform((x_m, y_m))
        self.taken.append(Bbox.from_extents(x - reach, y - reach, x + reach, y + reach))

    def _draw(self, point: tuple[float, float], offset: tuple[float, float], text: str, colour: str) -> None:
        self.axes.annotate(
            text,
            point,
            xytext=offset,
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=self.font_size,
            color=colour,
            zorder=9,
            bbox={"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none", "alpha": 0.78},
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5, "shrinkA": 0.0, "shrinkB": 2.0},
        )


def draw_scale_bar(axes: Axes) -> None:
    """A bar of 1, 2 or 5 × 10ⁿ m, about a sixth of the picture wide, in the lower left corner."""
    (x0, x1), (y0, _) = axes.get_xlim(), axes.get_ylim()
    wanted = (x1 - x0) / 6.0
    power = 10.0 ** math.floor(math.log10(wanted))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted)
    dots_per_m = axes.bbox.width / (x1 - x0)
    point_m = axes.figure.dpi / 72.0 / dots_per_m
    left, bottom = x0 + 12 * point_m, y0 + 10 * point_m
    for part, colour in ((0, TEXT), (1, "white")):
        axes.add_patch(
            Rectangle(
                (left + part * length / 2.0, bottom),
                length / 2.0,
                3.5 * point_m,
                facecolor=colour,
                edgecolor=TEXT,
                linewidth=0.6,
                zorder=10,
            )
        )
    box = {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.7}
    axes.text(
        left + length + 4 * point_m,
        bottom + 1.75 * point_m,
        f"{length:g} m",
        fontsize=7,
        color=FAINT_TEXT,
        va="center",
        zorder=10,
        bbox=box,
    )
