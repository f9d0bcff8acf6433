"""Constants of a look in all shaders: a software rasteriser would load each uniform anew for every few pixels."""

from collections.abc import Iterable
from typing import Final

from siren_ros.sensors.suite.look import Look

LIGHT_HALF_M: Final = 120.0
"""Half the side of the square that has shadows or lamps; beyond, everything lies in the sun, or in the dark."""
LIGHT_TEXELS: Final = 2048
LIGHT_GRID_M: Final = 40.0
"""The square moves in steps of this length, a multiple of the noise's period."""
_NOISE_PER_M: Final = 0.3
_FOG_HAZE_PER_M: Final = 0.004
"""From here on haze differs too much within a triangle to be interpolated, and is worked out per pixel."""
_MIRRORED_GROUND: Final = (0.168, 0.163, 0.158)
"""Light of streets and houses in mirroring surfaces, as a share of the ambient strength."""
_VERSION: Final = "#version 330 core\n"


def preamble(look: Look) -> str:
    """Preprocessor names and constants of a look, in GLSL."""
    names = (
        *(("FOG",) if look.haze_per_m > _FOG_HAZE_PER_M else ()),
        *(("WET",) if look.wetness > 0.0 else ()),
        *(("NIGHT",) if look.lamps_lit else ()),
    )
    vectors = {
        "towards_sun": tuple(float(value) for value in look.towards_sun),
        "sun_colour": look.direct_colour,
        "zenith_colour": look.zenith_colour,
        "horizon_colour": look.horizon_colour,
        "MIRRORED_GROUND": tuple(look.ambient * value for value in _MIRRORED_GROUND),
    }
    scalars = {
        "AMBIENT": look.ambient,
        "HAZE_PER_M": look.haze_per_m,
        "CLOUD_COVER": look.cloud_cover,
        "WETNESS": look.wetness,
        "NOISE_PER_LIGHT": 2.0 * LIGHT_HALF_M * _NOISE_PER_M,
    }
    return "".join(
        (
            *_defines(names),
            *(
                f"const vec3 {name} = vec3({', '.join(f'{v:.8f}' for v in value)});\n"
                for name, value in vectors.items()
            ),
            *(f"const float {name} = {value:.8f};\n" for name, value in scalars.items()),
        )
    )


def defined(source: str, constants: str, *names: str) -> str:
    """A shader with a look's constants and preprocessor names of its own."""
    return source.replace(_VERSION, _VERSION + "".join(_defines(names)) + constants, 1)


def _defines(names: Iterable[str]) -> list[str]:
    return [f"#define {name}\n" for name in names]
