"""Makes params/left_hand_places.json: where traffic keeps left, as polygons of longitude and latitude.

    npm pack world-atlas@2.0.2 && tar xzf world-atlas-2.0.2.tgz
    ./env python tools/left_hand_places.py package/countries-10m.json

The borders are Natural Earth's, which is in the public domain, at 1:10 million. Coasts move 30 km out to sea, so that
they need few points; land borders stay within 500 m.
"""

import json
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

COUNTRIES: Final = frozenset({
    "Akrotiri", "Anguilla", "Antigua and Barb.", "Ashmore and Cartier Is.", "Australia", "Bahamas", "Bangladesh",
    "Barbados", "Bermuda", "Bhutan", "Botswana", "British Virgin Is.", "Brunei", "Cayman Is.", "Cook Is.", "Cyprus",
    "Cyprus U.N. Buffer Zone", "Dhekelia", "Dominica", "Falkland Is.", "Fiji", "Grenada", "Guernsey", "Guyana",
    "Hong Kong", "India", "Indian Ocean Ter.", "Indonesia", "Ireland", "Isle of Man", "Jamaica", "Japan", "Jersey",
    "Kenya", "Kiribati", "Lesotho", "Macao", "Malawi", "Malaysia", "Maldives", "Malta", "Mauritius", "Montserrat",
    "Mozambique", "N. Cyprus", "Namibia", "Nauru", "Nepal", "New Zealand", "Niue", "Norfolk Island", "Pakistan",
    "Papua New Guinea", "Pitcairn Is.", "Saint Helena", "Saint Lucia", "Samoa", "Seychelles", "Siachen Glacier",
    "Singapore", "Solomon Is.", "South Africa", "Sri Lanka", "St. Kitts and Nevis", "St. Vin. and Gren.", "Suriname",
    "Tanzania", "Thailand", "Timor-Leste", "Tonga", "Trinidad and Tobago", "Turks and Caicos Is.", "Tuvalu",
    "U.S. Virgin Is.", "Uganda", "United Kingdom", "Zambia", "Zimbabwe", "eSwatini",
})  # fmt: skip
"""Names as in Natural Earth (https://en.wikipedia.org/wiki/Left-_and_right-hand_traffic)."""
OUT_TO_SEA_DEG: Final = 0.3
BORDER_DEG: Final = 0.005
SMALLEST_HOLE_DEG2: Final = 0.01
LEAST_POINTS: Final = 3
"""A ring with no more is an island without area."""
DIGITS: Final = 3


def countries(topology: dict[str, Any]) -> dict[str, BaseGeometry]:
    """The countries of a TopoJSON file by name (https://github.com/topojson/topojson-specification)."""
    scale, translate = (np.array(topology["transform"][name]) for name in ("scale", "translate"))
    arcs = [np.cumsum(np.array(arc), axis=0) * scale + translate for arc in topology["arcs"]]

    def area(rings: list[list[int]]) -> BaseGeometry:
        points = [np.concatenate([arcs[k] if k >= 0 else arcs[~k][::-1] for k in ring]) for ring in rings]
        outline, *holes = points
        return shapely.Polygon(outline, holes).buffer(0) if len(outline) > LEAST_POINTS else shapely.Polygon()

    found = {}
    for shape in topology["objects"]["countries"]["geometries"]:
        parts = shape["arcs"] if shape["type"] == "MultiPolygon" else [shape["arcs"]]
        found[shape["properties"]["name"]] = shapely.union_all([area(rings) for rings in parts])
    return found


def main(source: str) -> None:
    """Write the polygons beside the other parameters."""
    every = countries(json.loads(Path(source).read_text(encoding="utf-8")))
    if unknown := COUNTRIES - every.keys():
        raise SystemExit(f"names that the file lacks: {sorted(unknown)}")
    left = shapely.union_all([every[name] for name in COUNTRIES])
    right = shapely.union_all([area for name, area in every.items() if name not in COUNTRIES])
    coast = left.buffer(OUT_TO_SEA_DEG, quad_segs=1).simplify(OUT_TO_SEA_DEG / 4)
    near = coast.difference(right).simplify(BORDER_DEG)
    kept = [part for part in shapely.get_parts(near) if part.intersects(left)]
    polygons = [
        [np.round(ring.coords, DIGITS).tolist() for ring in (part.exterior, *part.interiors) if is_kept(ring)]
        for part in kept
    ]
    target = Path(__file__).parent.parent / "params" / "left_hand_places.json"
    shape = {"type": "MultiPolygon", "coordinates": polygons}
    target.write_text(json.dumps(shape, separators=(",", ":")) + "\n", encoding="utf-8")


def is_kept(ring: shapely.LinearRing) -> bool:
    """Whether an outline or a hole is large enough to be written."""
    return shapely.Polygon(ring).area > SMALLEST_HOLE_DEG2


if __name__ == "__main__":
    main(sys.argv[1])
