from dataclasses import replace

import numpy as np
import pytest

from siren_ros.base.numerics.units import STEP_S
from siren_ros.sensing.microphone import (
    LEVEL_AT_1_M_DB,
    SPEED_OF_SOUND_MPS,
    WAIL,
    YELP,
    Microphone,
    MicrophoneSpec,
    pressure,
)
from siren_ros.sensing.specification import Mount
from siren_ros.simulation.world.actors import ActorClass, Lights

SPEC = MicrophoneSpec("microphone", Mount(0.0, 0.0, 2.0), noise_db=0.0)


def record(boxes, distance_m, steps, sounding=lambda _: True, spec=SPEC):
    """Sound of an ambulance at a distance that depends on the step, at a microphone over the origin."""
    microphone, chunks = Microphone(spec, 0), []
    for step in range(steps):
        lights = [int(Lights.SIREN | Lights.BEACON) if sounding(step) else 0]
        states, _ = boxes.actors((ActorClass.SEDAN, distance_m(step), 0.0, 0.0), lights=lights)
        chunks.append(microphone.hear(replace(states, step=step), np.eye(4)).samples)
    return np.concatenate(chunks).astype(float)


def pitch_hz(tone, time_s):
    middle, half = (tone.high_hz + tone.low_hz) / 2.0, (tone.high_hz - tone.low_hz) / 2.0
    return middle - half * np.cos(2.0 * np.pi / tone.period_s * time_s)


def frequency(samples, rate_hz=16_000.0):
    """Of the strongest line near the fundamental."""
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples)), 1 << 17))
    lines = np.fft.rfftfreq(1 << 17, 1.0 / rate_hz)
    band = (lines > 500) & (lines < 1600)
    return float(lines[band][np.argmax(spectrum[band])])


def test_sound_arrives_late_by_the_distance(boxes):
    samples = record(boxes, lambda _: 100.0, 16)
    first = np.flatnonzero(samples)[0] / 16_000.0 - STEP_S  # the first chunk ends at time 0
    assert first == pytest.approx(100.0 / SPEED_OF_SOUND_MPS, abs=2e-3)


def test_a_siren_at_rest_is_the_formula_to_the_last_bit(boxes):
    """Spherical spreading, absorption of 0.005 dB/m and the way at the speed of sound, from 2 m above the ground."""
    steps = 16
    samples = record(boxes, lambda _: 40.0, steps, spec=replace(SPEC, mount=Mount(0.0, 0.0, 32.0)))[-2400:]
    distance = np.hypot(40.0, 30.0)
    time_s = (steps - 4) * STEP_S + np.arange(1, 2401) / 16_000.0  # three chunks, which join without clicks
    level_db = LEVEL_AT_1_M_DB - 0.005 * distance - 20.0 * np.log10(distance)
    wave = 10.0 ** (level_db / 20.0) * pressure(time_s - distance / SPEED_OF_SOUND_MPS)
    assert np.abs(samples - wave / 10.0 ** (130.0 / 20.0) * 32767.0).max() < 0.51


def test_an_approaching_siren_sounds_higher_and_a_receding_one_lower(boxes):
    speed, steps = 20.0, 18
    tones = []
    for sign in (-1.0, 1.0):
        samples = record(boxes, lambda step, s=sign: 60.0 + s * speed * step * STEP_S, steps)[-800:]
        emitted_s = (steps - 1.5) * STEP_S - (60.0 + sign * speed * (steps - 1.5) * STEP_S) / SPEED_OF_SOUND_MPS
        tones.append(frequency(samples) / pitch_hz(WAIL, emitted_s))
    assert tones[0] == pytest.approx(1.0 / (1.0 - speed / SPEED_OF_SOUND_MPS), rel=0.02)
    assert tones[1] == pytest.approx(1.0 / (1.0 + speed / SPEED_OF_SOUND_MPS), rel=0.02)


def test_without_a_siren_there_is_silence_or_the_background(boxes):
    assert not np.any(record(boxes, lambda _: 10.0, 6, lambda _: False))
    noisy = record(boxes, lambda _: 10.0, 20, lambda _: False, replace(SPEC, noise_db=90.0))
    full_scale_pa = 20e-6 * np.sqrt(2.0) * 10.0 ** (130.0 / 20.0)
    assert noisy.std() / 32767 * full_scale_pa == pytest.approx(20e-6 * 10.0 ** (90.0 / 20.0), rel=0.05)


def test_the_phase_is_the_integral_of_the_pitch():
    time_s = np.linspace(0.0, 1.0, 200_001)
    for tone in (WAIL, YELP):
        slope = np.gradient(tone.phase(time_s), time_s)
        assert np.allclose(slope[1:-1], pitch_hz(tone, time_s)[1:-1], rtol=1e-4, atol=0.0)
