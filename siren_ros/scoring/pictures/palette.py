"""Colours of the pictures: muted roads, a speed scale, and one colour per yield state."""

from typing import Final

from siren_ros.data.interfaces.markers import EMV_COLOUR, MODE_COLOURS
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.world.actors import Mode
from siren_ros.simulation.world.traffic_state import EventKind

Rgba = tuple[float, float, float, float]

GROUND: Final = "#f3f1ea"
JUNCTION: Final = "#c3c7cc"
LANE_FILL: Final = {
    LaneKind.DRIVING: "#c9cdd2",
    LaneKind.INTERNAL: "#c3c7cc",
    LaneKind.SHOULDER: "#d9d4c5",
    LaneKind.CYCLE: "#dfc4b4",
    LaneKind.KERB: "#b9b3a6",
    LaneKind.SIDEWALK: "#e6e0d2",
    LaneKind.CROSSING: "#d7dade",
}
MARKING: Final = "#ffffff"
ROAD_EDGE: Final = "#8f959c"
TEXT: Final = "#22262b"
FAINT_TEXT: Final = "#6b7178"
SPEED_MAP: Final = "plasma"
CIVILIAN: Final[Rgba] = (0.42, 0.46, 0.51, 1.0)

MODE_NAMES: Final = {
    Mode.NOMINAL: "driving in traffic",
    Mode.ROUTE_FOLLOW: "following its route",
    Mode.FORCED_LANE_CHANGE: "forcing a lane change",
    Mode.COPY_SUMO: "in the corridor",
    Mode.GAP_ESCAPE: "escaping through a gap",
    Mode.YIELD_REACTING: "reacting",
    Mode.YIELD_DEFERRED: "deferred",
    Mode.YIELD_LANE_CHANGE: "changing lane",
    Mode.YIELD_KEEP_LANE: "lane cleared",
    Mode.YIELD_PULL_OVER: "pulling over",
    Mode.YIELD_HOLD: "holding",
    Mode.REJOIN: "rejoining",
    Mode.EXTERNAL: "driven by the AV's program",
    Mode.STOPPED: "stopped after contact",
}
"""Name of each mode in pictures and pages."""
STATE_NAMES: Final = {mode: name for mode, name in MODE_NAMES.items() if mode in MODE_COLOURS}
"""Names of the modes in which a civilian has its own colour."""
EMV_MODE_COLOURS: Final = {
    Mode.NOMINAL: "#b9bec4",
    Mode.ROUTE_FOLLOW: "#e9a3a3",
    Mode.FORCED_LANE_CHANGE: "#d95a20",
    Mode.COPY_SUMO: "#8f3fa8",
    Mode.GAP_ESCAPE: "#1f1f24",
    Mode.STOPPED: "#d40000",
}
EVENT_STYLES: Final[dict[EventKind, tuple[str, str, str]]] = {
    EventKind.YIELD_STARTED: (">", "#1a86b8", "yield starts"),
    EventKind.YIELD_COMPLETED: ("o", "#12855f", "lane cleared"),
    EventKind.YIELD_HELD: ("s", "#4a3590", "holds"),
    EventKind.LANE_CHANGE_STARTED: ("^", "#b3121a", "EMV changes lane"),
    EventKind.CORRIDOR_ENTERED: ("P", "#8f3fa8", "EMV enters corridor"),
    EventKind.GAP_ESCAPE_ENTERED: ("D", "#1f1f24", "EMV escapes through a gap"),
    EventKind.STOP_LINE_CROSSED: ("d", "#b3121a", "EMV crosses stop line"),
    EventKind.COLLISION: ("X", "#d40000", "collision"),
}
"""Marker, colour and legend text of the events that a picture shows."""
EMV_EVENTS: Final = frozenset(
    {
        EventKind.LANE_CHANGE_STARTED,
        EventKind.CORRIDOR_ENTERED,
        EventKind.GAP_ESCAPE_ENTERED,
        EventKind.STOP_LINE_CROSSED,
    }
)
"""Kinds of events that are shown for emergency vehicles only, because they are too frequent for civilians."""


def colour_of(mode: int, is_emv: bool) -> Rgba:
    """Fill colour of a vehicle: red for an EMV, its state's colour for a yielding civilian, otherwise grey."""
    if is_emv:
        return EMV_COLOUR
    return MODE_COLOURS.get(Mode(mode), CIVILIAN)
