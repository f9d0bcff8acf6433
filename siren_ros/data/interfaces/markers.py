"""Makes ``visualization_msgs/MarkerArray``: vehicles for RViz and Foxglove while an episode runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from siren_ros.base.numerics.units import NS_PER_S
from siren_ros.data.interfaces.cdr import COUNT, STAMPED, CdrWriter, Layout, stamped, text, text_once
from siren_ros.data.interfaces.transforms import (
    Vector,
    from_quaternion,
    from_vector,
    quaternion_of_yaw,
    yaw_of_quaternion,
)
from siren_ros.simulation.world.actors import ActorDescription, ActorStates, Mode
from siren_ros.simulation.world.carrier import MAP_FRAME

Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, 0–1 each."""

EMV_COLOUR: Final[Colour] = (0.85, 0.10, 0.12, 1.0)
MODE_COLOURS: Final[dict[Mode, Colour]] = {
    Mode.YIELD_REACTING: (0.99, 0.85, 0.30, 1.0),
    Mode.YIELD_DEFERRED: (0.95, 0.60, 0.10, 1.0),
    Mode.YIELD_LANE_CHANGE: (0.10, 0.60, 0.85, 1.0),
    Mode.YIELD_KEEP_LANE: (0.15, 0.70, 0.55, 1.0),
    Mode.YIELD_PULL_OVER: (0.45, 0.35, 0.80, 1.0),
    Mode.YIELD_HOLD: (0.30, 0.20, 0.55, 1.0),
    Mode.REJOIN: (0.55, 0.75, 0.45, 1.0),
    Mode.STOPPED: (0.83, 0.0, 0.0, 1.0),
}
"""Colours of civilians that yield or have been in contact; all other vehicles have their paint."""
LIFETIME_NS: Final = 400_000_000
"""Lifetime of a marker: two periods of the topic. Markers of actors that have left disappear by themselves."""
_TEXT_HEIGHT_M: Final = 1.4
_TEXT_ABOVE_ROOF_M: Final = 1.2


class MarkerShape(IntEnum):
    """The ``type`` constants of ``visualization_msgs/Marker`` in use."""

    CUBE = 1
    TEXT = 9


@dataclass(frozen=True)
class Marker:
    """One shape in the ``map`` frame."""

    namespace: str
    marker_id: int
    shape: MarkerShape
    centre_m: Vector
    yaw_rad: float
    size_m: Vector
    colour: Colour
    text: str = ""


def vehicle_markers(states: ActorStates, actors: Mapping[int, ActorDescription]) -> tuple[Marker, ...]:
    """A coloured box per actor, and above each EMV its mode and speed."""
    markers = []
    rows = zip(
        states.actor_id.tolist(),
        states.x_m.tolist(),
        states.y_m.tolist(),
        states.z_m.tolist(),
        states.yaw_rad.tolist(),
        states.mode.tolist(),
        states.speed_mps.tolist(),
        strict=True,
    )
    for actor_id, x_m, y_m, z_m, yaw_rad, mode_code, speed_mps in rows:
        actor, mode = actors[actor_id], Mode(mode_code)
        size = (actor.length_m, actor.width_m, actor.height_m)
        centre = (x_m, y_m, z_m + actor.height_m / 2.0)
        colour = _colour_of(actor, mode)
        markers.append(Marker("vehicles", actor_id, MarkerShape.CUBE, centre, yaw_rad, size, colour))
        if actor.is_emv:
            above = (x_m, y_m, z_m + actor.height_m + _TEXT_ABOVE_ROOF_M)
            text = f"{mode.name.lower().replace('_', ' ')}  {speed_mps * 3.6:.0f} km/h"
            text_size = (0.0, 0.0, _TEXT_HEIGHT_M)
            markers.append(Marker("emv", actor_id, MarkerShape.TEXT, above, 0.0, text_size, (1.0, 1.0, 1.0, 1.0), text))
    return tuple(markers)


def _colour_of(actor: ActorDescription, mode: Mode) -> Colour:
    if actor.is_emv:
        return EMV_COLOUR
    red, green, blue = actor.colour_rgb
    return MODE_COLOURS.get(mode, (red / 255.0, green / 255.0, blue / 255.0, 0.85))


_MARKER: Final = Layout(f"{STAMPED} s i i i 7d 3d 4f i I ? I I s i I s s I I s s s I ?")
"""Fields of a marker. The zero counts at its end mean: no points, no colours, no texture, no mesh."""


def to_markers(step: int, markers: Sequence[Marker]) -> bytes:
    """Makes the message ``visualization_msgs/MarkerArray`` of one step, as CDR."""
    writer = CdrWriter()
    writer.put(COUNT, len(markers))
    head, nothing = stamped(step, MAP_FRAME), text("")
    lifetime = divmod(LIFETIME_NS, NS_PER_S)
    bare = (False, 0, 0, nothing, 0, 0, nothing, nothing, 0, 0)
    meshless = (nothing, nothing, 0, False)
    for marker in markers:
        writer.put(
            _MARKER,
            *head,
            text(marker.namespace),
            *(marker.marker_id, int(marker.shape), 0),
            *(*marker.centre_m, *quaternion_of_yaw(marker.yaw_rad), *marker.size_m),
            *(*marker.colour, *lifetime, *bare),
            text_once(marker.text),
            *meshless,
        )
    return writer.cdr()


def from_markers(message: Any) -> tuple[Marker, ...]:
    """Reads the message that ``to_markers`` makes."""
    return tuple(
        Marker(
            namespace=str(marker.ns),
            marker_id=int(marker.id),
            shape=MarkerShape(int(marker.type)),
            centre_m=from_vector(marker.pose.position),
            yaw_rad=yaw_of_quaternion(from_quaternion(marker.pose.orientation)),
            size_m=from_vector(marker.scale),
            colour=(float(marker.color.r), float(marker.color.g), float(marker.color.b), float(marker.color.a)),
            text=str(marker.text),
        )
        for marker in message.markers
    )
