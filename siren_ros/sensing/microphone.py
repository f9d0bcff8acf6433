"""Simulates a microphone on a carrier: it records sirens with delay, Doppler shift and loss over distance.

The sound at its source is a sawtooth-like tone whose pitch rises and falls.
"""

from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Matrix
from siren_ros.base.numerics.units import STEP_S
from siren_ros.sensing.specification import SensorSpec, number, sensor_generator
from siren_ros.simulation.world.actors import ActorStates, Lights
from siren_ros.simulation.world.carrier import AudioChunk

LEVEL_AT_1_M_DB: Final = 124.0
"""Sound pressure level on the axis of a 100 W siren, dB re 20 µPa: SAE J1849 asks for 118 dB(A) at 3 m and more, which
spherical spreading makes 128 dB at 1 m; 4 dB less for all directions together."""
_HARMONICS: Final = (1.0, 0.5, 0.33, 0.25)
"""Amplitudes of the siren's harmonics: those of a square-like wave behind a horn, lower with each order."""


@dataclass(frozen=True)
class Tone:
    """A mode of a siren: the pitch glides up and down between two frequencies in one period."""

    low_hz: float
    high_hz: float
    period_s: float

    def phase(self, time_s: Floats) -> Floats:
        """Cycles since time 0 of the pitch f = m − d cos(2πt/T), where m is the middle and d half of the span."""
        middle, half = (self.high_hz + self.low_hz) / 2.0, (self.high_hz - self.low_hz) / 2.0
        turn = 2.0 * np.pi / self.period_s
        return middle * time_s - half / turn * np.sin(turn * time_s)


WAIL: Final = Tone(650.0, 1450.0, 60.0 / 14.0)
"""The wail: SAE J1849 asks for 10–18 cycles a minute between 650–900 Hz and 1200–1700 Hz."""
YELP: Final = Tone(650.0, 1450.0, 60.0 / 200.0)
"""The yelp: SAE J1849 asks for 150–250 cycles a minute between the same pitches."""
MODE_S: Final = 8.0
"""Duration of each mode; the siren begins with the wail."""


def pressure(time_s: Floats) -> Floats:
    """Sound pressure at times of emission, in units of its amplitude, between −1 and 1; any shape."""
    wail = np.mod(time_s, 2.0 * MODE_S) < MODE_S
    cycles = np.where(wail, WAIL.phase(time_s), YELP.phase(time_s))
    wave = np.zeros_like(cycles)
    for order, share in enumerate(_HARMONICS, start=1):
        wave += share * np.sin(2.0 * np.pi * order * cycles)
    return wave / sum(_HARMONICS)


SPEED_OF_SOUND_MPS: Final = 343.2
"""Speed of sound in dry air at 20 °C (ISO 9613-1)."""
REFERENCE_PA: Final = 20e-6
_HISTORY_STEPS: Final = 40
"""The last 2 s of sound are kept, so that sirens are heard up to 686 m away."""
_SOURCE_HEIGHT_M: Final = 2.0
_ABSORPTION_DB_PER_M: Final = 0.005
"""Absorption of sound in air at 1 kHz, 20 °C, 50–70 % humidity (ISO 9613-1, table 1)."""
_NEAREST_M: Final = 1.0
_FULL_SCALE: Final = 32767.0
_ITERATIONS: Final = 3
"""Iterations to solve for the time of emission. Each scales the error by speed / speed of sound; of 60 m
0.01 m remain at 20 m/s."""


@dataclass(frozen=True)
class MicrophoneSpec(SensorSpec):
    """An omnidirectional microphone that records a chunk of 16-bit PCM at every step."""

    sample_rate_hz: int = number(8_000, 48_000, 16_000)
    full_scale_db: float = number(60.0, 160.0, 130.0)
    """Sound pressure level of a sine wave at full scale, dB re 20 µPa."""
    noise_db: float = number(0.0, 120.0, 45.0)
    """Level of the background noise, dB re 20 µPa; 0 switches it off."""


@dataclass(frozen=True, eq=False)
class _Heard:
    """Places of the microphone and of the sirens at one step."""

    step: int
    ear_m: Floats
    """Place of the microphone, shape ``(3,)``."""
    sirens: dict[int, Floats]
    """Place of each active siren by actor id."""


class Microphone:
    """Simulates one microphone. Sound arrives late, so it keeps past places: call ``hear`` at every step."""

    def __init__(self, spec: MicrophoneSpec, seed: int) -> None:
        """Start in silence; ``seed`` is that of the carrier's noise."""
        self.spec = spec
        self._seed = seed
        self._past: deque[_Heard] = deque(maxlen=_HISTORY_STEPS)

    def hear(self, states: ActorStates, map_from_base: Matrix) -> AudioChunk:
        """The sound that arrives between the last step and this one, for a pose of the carrier.

        Silence at the first step.
        """
        spec = self.spec
        ear = (map_from_base @ np.array([spec.mount.x_m, spec.mount.y_m, spec.mount.z_m, 1.0]))[:3]
        rows = np.flatnonzero(states.lights & Lights.SIREN)
        place = np.stack((states.x_m, states.y_m, states.z_m + _SOURCE_HEIGHT_M), axis=1)
        sirens = {int(states.actor_id[row]): place[row] for row in rows}
        self._past.append(_Heard(states.step, ear, sirens))
        count = round(spec.sample_rate_hz * STEP_S)
        time_s = (states.step - 1) * STEP_S + np.arange(1, count + 1) / spec.sample_rate_hz
        sound = np.zeros(count)
        if len(self._past) > 1:
            for actor_id in sorted({actor for past in self._past for actor in past.sirens}):
                sound += self._arriving(actor_id, time_s)
        sound += self._background(states.step, count)
        full_pa = REFERENCE_PA * np.sqrt(2.0) * 10.0 ** (spec.full_scale_db / 20.0)
        samples = np.clip(np.rint(sound / full_pa * _FULL_SCALE), -_FULL_SCALE, _FULL_SCALE).astype(np.int16)
        return AudioChunk(states.step, spec.name, spec.sample_rate_hz, samples)

    def _arriving(self, actor_id: int, time_s: Floats) -> Floats:
        """Sound pressure in Pa of one siren at times of arrival, shape ``(S,)``."""
        known = [past for past in self._past if actor_id in past.sirens]
        at_s = np.array([past.step * STEP_S for past in known])
        siren = np.array([past.sirens[actor_id] for past in known])
        past_s = np.array([past.step * STEP_S for past in self._past])
        ears = np.array([past.ear_m for past in self._past])
        ear = np.stack([np.interp(time_s, past_s, ears[:, axis]) for axis in range(3)], axis=1)
        emitted = time_s
        distance = np.zeros_like(time_s)
        for _ in range(_ITERATIONS):
            source = np.stack([np.interp(emitted, at_s, siren[:, axis]) for axis in range(3)], axis=1)
            distance = np.linalg.norm(ear - source, axis=1)
            emitted = time_s - distance / SPEED_OF_SOUND_MPS
        audible = (emitted >= at_s[0]) & (emitted <= at_s[-1] + STEP_S)
        level_db = LEVEL_AT_1_M_DB - _ABSORPTION_DB_PER_M * distance
        amplitude = REFERENCE_PA * np.sqrt(2.0) * 10.0 ** (level_db / 20.0) / np.maximum(distance, _NEAREST_M)
        return np.where(audible, amplitude * pressure(emitted), 0.0)

    def _background(self, step: int, count: int) -> Floats:
        """White background noise of the suite's level, in Pa."""
        if self.spec.noise_db <= 0.0:
            return np.zeros(count)
        draw = sensor_generator(self._seed, self.spec.name, step).standard_normal(count)
        return draw * REFERENCE_PA * 10.0 ** (self.spec.noise_db / 20.0)
