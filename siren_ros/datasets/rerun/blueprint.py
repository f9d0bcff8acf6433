"""How the viewer arranges an episode when its file is opened."""

from collections.abc import Sequence
from typing import Any

import rerun.blueprint as rrb

MAP_ROOT = "map"
EGO = "map/emv"
EVENTS = "events"
SPEED = "speed"


def blueprint(cameras: Sequence[str]) -> Any:
    """The scene in 3-D, the cameras in a grid, events and speed below."""
    scene = rrb.Spatial3DView(origin=MAP_ROOT, name="Scene")
    pictures = [rrb.Spatial2DView(origin=f"{EGO}/{name}", name=name) for name in cameras]
    events, speed = rrb.TextLogView(origin=EVENTS, name="Events"), rrb.TimeSeriesView(origin=SPEED, name="Speed")
    below = rrb.Horizontal(events, speed)
    above = rrb.Horizontal(scene, rrb.Grid(*pictures), column_shares=[3, 2]) if pictures else scene
    return rrb.Blueprint(
        rrb.Vertical(above, below, row_shares=[3, 1]),
        rrb.TimePanel(state="expanded"),
        rrb.SelectionPanel(state="collapsed"),
    )
