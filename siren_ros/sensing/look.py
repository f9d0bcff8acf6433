"""Light and weather: sun, sky, haze and wet roads.

A look is read from ``params/looks/NAME.yaml`` or from a user's file.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFiles, StrictMapping
from siren_ros.simulation.scenario.episode import DEFAULT_LOOK, EpisodeDescription

LOWEST_SUN_RAD: Final = float(np.radians(3.0))
"""Below this elevation of the sun there are no shadows and the lamps are lit; shadows would be longer than the map."""


@dataclass(frozen=True)
class Look:
    """Light and weather of an episode. Colours are linear RGB; the defaults are a clear late morning."""

    sun_azimuth_rad: float = 2.2
    """Azimuth of the sun, counter-clockwise from east."""
    sun_elevation_rad: float = 0.80
    sun_colour: tuple[float, float, float] = (3.1, 2.8, 2.35)
    zenith_colour: tuple[float, float, float] = (0.13, 0.29, 0.66)
    horizon_colour: tuple[float, float, float] = (0.62, 0.72, 0.84)
    ambient: float = 0.95
    """Strength of the light from sky and ground."""
    haze_per_m: float = 0.0016
    cloud_cover: float = 0.45
    """Cloud cover from 0 (clear) to 1 (overcast)."""
    wetness: float = 0.0
    """Wetness of the road from 0 (dry) to 1 (soaked: dark asphalt that mirrors the sky)."""
    rain_mm_per_h: float = 0.0
    visibility_m: float = 0.0
    """Meteorological optical range in fog; 0 means no fog."""

    @property
    def lamps_lit(self) -> bool:
        """Whether street lamps, head lamps and windows are lit instead of the sun."""
        return self.sun_elevation_rad < LOWEST_SUN_RAD

    @property
    def direct_colour(self) -> tuple[float, float, float]:
        """Colour of the sunlight, black where the sun is down."""
        return (0.0, 0.0, 0.0) if self.lamps_lit else self.sun_colour

    @property
    def lidar_extinction_per_m(self) -> float:
        """Share of a laser's light lost per metre in rain and fog, on the way in one direction.

        Rain: 1.076 R^0.67 dB/km (ITU-R P.1814, section 4.2). Fog: Koschmieder's law, 5 % left at the visibility.
        """
        rain = 1.076e-3 * self.rain_mm_per_h**0.67 * np.log(10.0) / 10.0
        fog = 3.0 / self.visibility_m if self.visibility_m > 0.0 else 0.0
        return float(rain + fog)

    @property
    def towards_sun(self) -> Floats:
        """Unit vector from the ground to the sun, ``map`` frame, shape ``(3,)``."""
        cos = np.cos(self.sun_elevation_rad)
        return np.array(
            [cos * np.cos(self.sun_azimuth_rad), cos * np.sin(self.sun_azimuth_rad), np.sin(self.sun_elevation_rad)]
        )


_COLOURS: Final = ("sun_colour", "zenith_colour", "horizon_colour")
_BRIGHTEST: Final = 20.0
_NUMBERS: Final = {
    "ambient": (0.0, 10.0),
    "haze_per_m": (0.0, 1.0),
    "cloud_cover": (0.0, 1.0),
    "wetness": (0.0, 1.0),
    "rain_mm_per_h": (0.0, 150.0),
    "visibility_m": (10.0, 100_000.0),
}
_NIGHT_HAZE_PER_M: Final = 0.0012
_SOLAR_NOON_H: Final = 12.0
_DUSK: Final = {
    -90.0: ((0.0, 0.0, 0.0), (0.006, 0.009, 0.020), (0.030, 0.030, 0.036), 0.55),
    -12.0: ((0.0, 0.0, 0.0), (0.006, 0.009, 0.020), (0.030, 0.030, 0.036), 0.55),
    -4.0: ((0.0, 0.0, 0.0), (0.020, 0.040, 0.110), (0.160, 0.120, 0.110), 0.50),
    3.0: ((0.0, 0.0, 0.0), (0.080, 0.140, 0.320), (0.520, 0.380, 0.300), 0.60),
}
"""By elevation of the low sun: colours of sun, zenith and horizon, and the ambient strength."""
_OBLIQUITY_RAD: Final = float(np.radians(23.44))


def look_of(episode: EpisodeDescription) -> str:
    """Name or path of the look with which an episode was requested."""
    return str(episode.asked.get("look", DEFAULT_LOOK))


def load_look(name_or_path: str, files: InputFiles = FILES_ON_DISK) -> Look:
    """Load a look by name or from a YAML file; values that are left out are those of a clear morning.

    The sun stands where ``sun_azimuth_deg`` (counter-clockwise from east) and ``sun_elevation_deg`` say, or where it
    is at an ``hour`` of local solar time on a ``day_of_year`` at ``latitude_deg``. Where that is lower than 3 degrees
    the lamps are lit, and colours that are left out follow from how low it is.

    Raises:
        InputError: No such look, an unknown key, a value of the wrong type or out of range.
    """
    top = files.read("look", "looks", name_or_path).mapping()
    values: dict[str, Any] = _sun(top)
    values |= _dusk(values.get("sun_elevation_rad", Look.sun_elevation_rad))
    for key in _COLOURS:
        if top.has(key):
            values[key] = top.numbers(key, 3, 0.0, _BRIGHTEST)
    for key, (low, high) in _NUMBERS.items():
        if top.has(key):
            values[key] = top.number(key, low, high)
    top.finish()
    if "visibility_m" in values:
        values["haze_per_m"] = max(values.get("haze_per_m", 0.0), 3.0 / values["visibility_m"])
    return Look(**values)


def _sun(top: StrictMapping) -> dict[str, Any]:
    if top.has("hour"):
        hour = top.number("hour", 0.0, 24.0)
        day = top.integer("day_of_year", 1, 366) if top.has("day_of_year") else 172
        latitude = top.number("latitude_deg", -66.0, 66.0) if top.has("latitude_deg") else 49.0
        azimuth_rad, elevation_rad = sun_position(hour, day, float(np.radians(latitude)))
        return {"sun_azimuth_rad": azimuth_rad, "sun_elevation_rad": elevation_rad}
    angles = {}
    if top.has("sun_azimuth_deg"):
        angles["sun_azimuth_rad"] = float(np.radians(top.number("sun_azimuth_deg", -360.0, 360.0)))
    if top.has("sun_elevation_deg"):
        angles["sun_elevation_rad"] = float(np.radians(top.number("sun_elevation_deg", -90.0, 90.0)))
    return angles


def _dusk(elevation_rad: float) -> dict[str, Any]:
    """Default colours and ambient strength for a sun below the horizon; empty for a higher sun."""
    if elevation_rad >= LOWEST_SUN_RAD:
        return {}
    degrees = list(_DUSK)
    rows = np.array([[*sun, *zenith, *horizon, ambient] for sun, zenith, horizon, ambient in _DUSK.values()])
    mixed = [float(np.interp(np.degrees(elevation_rad), degrees, column)) for column in rows.T]
    colours = {name: tuple(mixed[3 * k : 3 * k + 3]) for k, name in enumerate(_COLOURS)}
    return {**colours, "ambient": mixed[9], "haze_per_m": _NIGHT_HAZE_PER_M}


def sun_position(hour: float, day_of_year: int, latitude_rad: float) -> tuple[float, float]:
    """Azimuth counter-clockwise from east, and elevation, of the sun at local solar time.

    Declination by Cooper's formula δ = ε sin(2π (284 + n) / 365); altitude and azimuth from the hour angle (Duffie and
    Beckman, Solar Engineering of Thermal Processes, section 1.6).
    """
    declination = _OBLIQUITY_RAD * np.sin(2.0 * np.pi * (284 + day_of_year) / 365.0)
    angle = np.pi / 12.0 * (hour - _SOLAR_NOON_H)
    east = -np.cos(declination) * np.sin(angle)
    north = np.sin(declination) * np.cos(latitude_rad) - np.cos(declination) * np.sin(latitude_rad) * np.cos(angle)
    up = np.sin(declination) * np.sin(latitude_rad) + np.cos(declination) * np.cos(latitude_rad) * np.cos(angle)
    return float(np.arctan2(north, east)), float(np.arcsin(np.clip(up, -1.0, 1.0)))
