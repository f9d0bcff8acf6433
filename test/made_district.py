"""A district as an OpenDRIVE map: streets of two lanes each way with shoulders and sidewalks, signals and stop signs.

Six junctions in two rows, whose streets are straight; at three of them are signals, at two all have a stop sign. The
whole is turned by 0.4 rad. Streets are counted from their first junction; those that leave the district end nowhere.
"""

import math
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Final, NamedTuple

HEADING_RAD: Final = 0.4
ORIGIN_M: Final = (30.0, -20.0)
HALF_M: Final = 20.0
"""From the middle of a junction to where its streets begin."""
LEAVING_M: Final = 160.0
LANES: Final = (("driving", 3.5), ("driving", 3.5), ("shoulder", 2.2), ("sidewalk", 3.0))
"""Of each side of a street, from its middle outwards: type and width in metres."""
MIDDLES_M: Final = {
    "100": (0.0, 0.0),
    "101": (300.0, 0.0),
    "102": (545.0, 0.0),
    "110": (0.0, 245.0),
    "111": (300.0, 245.0),
    "112": (545.0, 245.0),
}
SIGNALS: Final = ("100", "101", "111")
STOPS: Final = ("102", "110")
CROSSED: Final = ("101", "110")
"""Junctions with a crosswalk in each of their streets."""
_NOT_LEAVING: Final = (("102", 3), ("110", 1), ("112", 0))
_AHEAD: Final = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Directions of streets: 0 east, 1 north, 2 west, 3 south, before the whole is turned."""


LAT_LON_DEG: Final = (48.0, 11.0)
"""Of the map's origin."""
_HEADER: Final = (
    '<header revMajor="1" revMinor="4" name="district" version="1"><geoReference><![CDATA[+proj=tmerc +ellps=WGS84 '
    f"+lat_0={LAT_LON_DEG[0]} +lon_0={LAT_LON_DEG[1]} +k=1 +x_0=0 +y_0=0 +units=m +no_defs]]></geoReference></header>"
)


class Arm(NamedTuple):
    """A street as a junction sees it."""

    street: str
    at_end: bool
    """Whether the street's reference line ends here."""


def place_m(x_m: float, y_m: float) -> tuple[float, float]:
    """A place on the map from one of the district before it is turned."""
    cos, sin = math.cos(HEADING_RAD), math.sin(HEADING_RAD)
    return ORIGIN_M[0] + cos * x_m - sin * y_m, ORIGIN_M[1] + sin * x_m + cos * y_m


def _lane(number: int, kind: str, width_m: float, links: str = "") -> str:
    link = f"<link>{links}</link>" if links else ""
    width = f'<width sOffset="0" a="{width_m}" b="0" c="0" d="0"/>'
    return f'<lane id="{number}" type="{kind}" level="false">{link}{width}</lane>'


def _road(name: str, junction: str, length_m: float, start: tuple[float, float, int], **parts: str) -> str:
    """A road from a place of the district in one of its directions; straight unless ``shape`` says otherwise."""
    (x_m, y_m), heading = place_m(*start[:2]), HEADING_RAD + start[2] * math.pi / 2.0
    return (
        f'<road name="" id="{name}" junction="{junction}" length="{length_m}"><link>{parts["link"]}</link>'
        f'<type s="0" type="town"/><planView><geometry s="0" x="{x_m}" y="{y_m}" hdg="{heading}" length="{length_m}">'
        f'{parts.get("shape", "<line/>")}</geometry></planView><lanes><laneSection s="0">{parts["lanes"]}'
        f"</laneSection></lanes><objects>{parts.get('objects', '')}</objects>"
        f"<signals>{parts.get('signals', '')}</signals></road>"
    )


_CENTRE: Final = '<center><lane id="0" type="none" level="false"/></center>'
_BOTH_SIDES: Final = (
    f"<left>{''.join(_lane(k + 1, *LANES[k]) for k in reversed(range(len(LANES))))}</left>{_CENTRE}"
    f"<right>{''.join(_lane(-k - 1, *lane) for k, lane in enumerate(LANES))}</right>"
)


def _streets() -> Iterator[tuple[str, str, int, str | None, float]]:
    """Each street's id, its junction and direction there, the junction at its end, and its length."""
    at = {middle: name for name, middle in MIDDLES_M.items()}
    numbers = count(1)
    for name, (x_m, y_m) in MIDDLES_M.items():
        for direction, (ahead_x, ahead_y) in enumerate(_AHEAD):
            others = {
                (other[0] - x_m) * ahead_x + (other[1] - y_m) * ahead_y: other
                for other in at
                if (other[0] - x_m) * ahead_y == (other[1] - y_m) * ahead_x
            }
            away_m = min((distance for distance in others if distance > 0.0), default=None)
            if away_m is not None and direction in (0, 1):
                yield str(next(numbers)), name, direction, at[others[away_m]], away_m - 2.0 * HALF_M
            elif away_m is None and (name, direction) not in _NOT_LEAVING:
                yield str(next(numbers)), name, direction, None, LEAVING_M


def _furniture(street: str, junction: str | None, s_m: float, orientation: str) -> tuple[str, str]:
    """Objects and signals of a street next to one of its ends; traffic towards it has the orientation."""
    crosswalk = f'<object id="{street}{orientation}" type="crosswalk" s="{s_m}" t="0"/>'
    kind, dynamic = ("1000001", "yes") if junction in SIGNALS else ("206", "no")
    signal = (
        f'<signal id="{street}{orientation}" type="{kind}" dynamic="{dynamic}" s="{s_m}" t="0" '
        f'orientation="{orientation}" country="OpenDRIVE" subtype="-1" value="-1"/>'
    )
    return crosswalk if junction in CROSSED else "", signal if junction in (*SIGNALS, *STOPS) else ""


def _turns(junction: str, arms: dict[int, Arm], numbers: Iterator[int]) -> Iterator[tuple[str, str]]:
    """Roads across a junction, each with its entry in the junction."""
    for towards, source in arms.items():
        for turned, kept, curvature in ((2, (1, 2), 0.0), (1, (2,), -1.0 / HALF_M), (3, (1,), 1.0 / HALF_M)):
            target = arms.get((towards + turned) % 4)
            if target is None:
                continue
            signs = -1 if source.at_end else 1, 1 if target.at_end else -1
            ends = ["end" if arm.at_end else "start" for arm in (source, target)]
            name = str(next(numbers))
            links = {k: f'<predecessor id="{signs[0] * k}"/><successor id="{signs[1] * k}"/>' for k in kept}
            right = (_lane(-k, LANES[k - 1][0] if k in kept else "none", 3.5, links.get(k, "")) for k in (1, 2))
            ahead, (x_m, y_m) = _AHEAD[towards], MIDDLES_M[junction]
            signal = (
                f'<signalReference id="{source.street}{"+" if source.at_end else "-"}" s="0" t="0" orientation="+"/>'
            )
            road = _road(
                *(name, junction, math.pi / 2.0 * HALF_M if curvature else 2.0 * HALF_M),
                (x_m + HALF_M * ahead[0], y_m + HALF_M * ahead[1], (towards + 2) % 4),
                link=f'<predecessor elementType="road" elementId="{source.street}" contactPoint="{ends[0]}"/>'
                f'<successor elementType="road" elementId="{target.street}" contactPoint="{ends[1]}"/>',
                shape=f'<arc curvature="{curvature}"/>' if curvature else "<line/>",
                lanes=f"{_CENTRE}<right>{''.join(right)}</right>",
                signals=signal if junction in SIGNALS else "",
            )
            entry = f'id="{name}" incomingRoad="{source.street}" connectingRoad="{name}" contactPoint="start"'
            lanes = "".join(f'<laneLink from="{signs[0] * k}" to="{-k}"/>' for k in kept)
            yield road, f"<connection {entry}>{lanes}</connection>"


def district_xodr() -> str:
    """The map's text."""
    roads, controllers, junctions = [], [], []
    arms: dict[str, dict[int, Arm]] = {name: {} for name in MIDDLES_M}
    for street, first, direction, second, length_m in _streets():
        arms[first][direction] = Arm(street, at_end=False)
        link = f'<predecessor elementType="junction" elementId="{first}"/>'
        if second is not None:
            arms[second][(direction + 2) % 4] = Arm(street, at_end=True)
            link += f'<successor elementType="junction" elementId="{second}"/>'
        ends = [_furniture(street, first, 2.0, "-"), _furniture(street, second, length_m - 2.0, "+")]
        objects, signals = ("".join(parts) for parts in zip(*ends, strict=True))
        ahead, (x_m, y_m) = _AHEAD[direction], MIDDLES_M[first]
        start = (x_m + HALF_M * ahead[0], y_m + HALF_M * ahead[1], direction)
        parts = {"link": link, "lanes": _BOTH_SIDES, "objects": objects, "signals": signals}
        roads.append(_road(street, "-1", length_m, start, **parts))
    numbers = count(1000)
    for name, around in arms.items():
        turns = list(_turns(name, around, numbers))
        roads += [road for road, _ in turns]
        junctions.append(f'<junction name="" id="{name}">{"".join(entry for _, entry in turns)}</junction>')
    signals = [f"{arm.street}{'+' if arm.at_end else '-'}" for name in SIGNALS for arm in arms[name].values()]
    controllers = [
        f'<controller id="c{signal}" name="" sequence="0"><control signalId="{signal}" type=""/></controller>'
        for signal in signals
    ]
    return f'<?xml version="1.0"?><OpenDRIVE>{_HEADER}{"".join((*roads, *controllers, *junctions))}</OpenDRIVE>'


def write_district(folder: Path) -> Path:
    """Writes the map's file into a folder."""
    file = folder / "district.xodr"
    file.write_text(district_xodr(), encoding="utf-8")
    return file
