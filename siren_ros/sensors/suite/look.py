"""Light and weather: sun, sky, haze, wet roads."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

LOWEST_SUN_RAD: Final = float(np.radians(3.0))
"""Where the sun stands lower, it throws no shadows and the lamps are lit: shadows would reach farther than the map."""


@dataclass(frozen=True)
class Look:
    """Light and air. Colours are linear RGB; the defaults are a clear late morning."""

    sun_azimuth_rad: float = 2.2
    """Counter-clockwise from east, where the sun stands."""
    sun_elevation_rad: float = 0.80
    sun_colour: tuple[float, float, float] = (3.1, 2.8, 2.35)
    zenith_colour: tuple[float, float, float] = (0.13, 0.29, 0.66)
    horizon_colour: tuple[float, float, float] = (0.62, 0.72, 0.84)
    ambient: float = 0.95
    """Strength of the light from sky and ground."""
    haze_per_m: float = 0.0016
    cloud_cover: float = 0.45
    """0 clear, 1 overcast."""
    wetness: float = 0.0
    """0 dry, 1 soaked: dark asphalt that mirrors the sky."""
    rain_mm_per_h: float = 0.0
    visibility_m: float = 0.0
    """Meteorological optical range of fog; 0 where there is none."""

    @property
    def lamps_lit(self) -> bool:
        """Whether street lamps, head lamps and windows shine in place of the sun."""
        return self.sun_elevation_rad < LOWEST_SUN_RAD

    @property
    def direct_colour(self) -> tuple[float, float, float]:
        """Colour of the sunlight, black where the sun is down."""
        return (0.0, 0.0, 0.0) if self.lamps_lit else self.sun_colour

    @property
    def lidar_extinction_per_m(self) -> float:
        """Share of a laser's light lost per metre in rain and fog, one way.

        Rain: 1.076 R^0.67 dB/km (ITU-R P.1814, section 4.2). Fog: Koschmieder's law, 5 % left at the visibility.
        """
        rain = 1.076e-3 * self.rain_mm_per_h**0.67 * np.log(10.0) / 10.0
        fog = 3.0 / self.visibility_m if self.visibility_m > 0.0 else 0.0
        return float(rain + fog)

    @property
    def towards_sun(self) -> npt.NDArray[np.float64]:
        """Unit vector from the ground to the sun, ``map`` frame, shape ``(3,)``."""
        cos = np.cos(self.sun_elevation_rad)
        return np.array(
            [cos * np.cos(self.sun_azimuth_rad), cos * np.sin(self.sun_azimuth_rad), np.sin(self.sun_elevation_rad)]
        )
