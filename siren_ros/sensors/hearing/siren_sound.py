"""The sound of a siren at its source: a sawtooth-like tone whose pitch rises and falls."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Floats

LEVEL_AT_1_M_DB: Final = 124.0
"""Sound pressure level on the axis of a 100 W siren, dB re 20 µPa: SAE J1849 asks for 118 dB(A) at 3 m and more, which
spherical spreading makes 128 dB at 1 m; 4 dB less for all directions together."""
_HARMONICS: Final = (1.0, 0.5, 0.33, 0.25)
"""Of a square-like wave behind a horn: falling with the order."""


@dataclass(frozen=True)
class Tone:
    """A siren's mode: the pitch glides between two frequencies, up and down alike, in one period."""

    low_hz: float
    high_hz: float
    period_s: float

    def phase(self, time_s: Floats) -> Floats:
        """Cycles since time 0 of the glide f = m − d cos(2πt/T), m the middle and d half the span."""
        middle, half = (self.high_hz + self.low_hz) / 2.0, (self.high_hz - self.low_hz) / 2.0
        turn = 2.0 * np.pi / self.period_s
        return middle * time_s - half / turn * np.sin(turn * time_s)

    def frequency_hz(self, time_s: Floats) -> Floats:
        """Pitch at a time."""
        middle, half = (self.high_hz + self.low_hz) / 2.0, (self.high_hz - self.low_hz) / 2.0
        return middle - half * np.cos(2.0 * np.pi / self.period_s * time_s)


WAIL: Final = Tone(650.0, 1450.0, 60.0 / 14.0)
"""SAE J1849: wail 10–18 cycles a minute between 650–900 Hz and 1200–1700 Hz."""
YELP: Final = Tone(650.0, 1450.0, 60.0 / 200.0)
"""SAE J1849: yelp 150–250 cycles a minute, the same pitches."""
MODE_S: Final = 8.0
"""The mode changes this often, wail first."""


def pressure(time_s: Floats) -> Floats:
    """Sound pressure in units of its amplitude, of peak 1 at most, at times of emission; any shape."""
    wail = np.mod(time_s, 2.0 * MODE_S) < MODE_S
    cycles = np.where(wail, WAIL.phase(time_s), YELP.phase(time_s))
    wave = np.zeros_like(cycles)
    for order, share in enumerate(_HARMONICS, start=1):
        wave += share * np.sin(2.0 * np.pi * order * cycles)
    return wave / sum(_HARMONICS)
