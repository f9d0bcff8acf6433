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
from siren_ros.sensing.specification import Mount, map_from_base
from siren_ros.simulation.world.actors import ActorClass, Lights

SPEC = MicrophoneSpec("microphone", Mount(0.0, 0.0, 2.0), noise_db=0.0)


def record(boxes, distance_m, steps, sounding=lambda _: True, spec=SPEC, ear_m=lambda _: 0.0):
    """Sound of ambulances at distances that depend on the step, at a microphone on their line."""
    microphone, chunks = Microphone(spec, 0), []
    for step in range(steps):
        places = np.atleast_1d(distance_m(step))
        lights = np.where(np.broadcast_to(sounding(step), places.shape), int(Lights.SIREN | Lights.BEACON), 0)
        states, _ = boxes.actors(*((ActorClass.SEDAN, place, 0.0, 0.0) for place in places), lights=lights)
        pose = map_from_base(ear_m(step), 0.0, 0.0, 0.0)
        chunks.append(microphone.hear(replace(states, step=step), pose).samples)
    return np.concatenate(chunks).astype(float)


def pitch_hz(tone, time_s):
    middle, half = (tone.high_hz + tone.low_hz) / 2.0, (tone.high_hz - tone.low_hz) / 2.0
    return middle - half * np.cos(2.0 * np.pi / tone.period_s * time_s)


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


@pytest.mark.parametrize(
    ("siren_mps", "ear_mps"), [(20.0, 0.0), (-20.0, 0.0), (0.0, 20.0), (0.0, -20.0), (-15.0, 10.0)]
)
def test_a_siren_and_an_ear_that_move_are_the_formula_of_the_time_of_emission(boxes, siren_mps, ear_mps):
    """An approaching siren sounds higher: e = t - (60 m + v e - w t) / c, which three steps solve to about 0.01 m."""
    steps = 18
    ways = (lambda step: 60.0 + siren_mps * step * STEP_S), (lambda step: ear_mps * step * STEP_S)
    samples = record(boxes, ways[0], steps, ear_m=ways[1])[-2400:]
    time_s = (steps - 4) * STEP_S + np.arange(1, 2401) / 16_000.0
    emitted_s = time_s
    for _ in range(3):
        distance = 60.0 + siren_mps * emitted_s - ear_mps * time_s
        emitted_s = time_s - distance / SPEED_OF_SOUND_MPS
    exact_s = (time_s * (1.0 + ear_mps / SPEED_OF_SOUND_MPS) - 60.0 / SPEED_OF_SOUND_MPS) / (
        1.0 + siren_mps / SPEED_OF_SOUND_MPS
    )
    assert np.abs(emitted_s - exact_s).max() * SPEED_OF_SOUND_MPS < 0.02
    level_db = LEVEL_AT_1_M_DB - 0.005 * distance - 20.0 * np.log10(distance)
    wave = 10.0 ** ((level_db - 130.0) / 20.0) * pressure(emitted_s) * 32767.0
    assert np.abs(samples - wave).max() < 1.0


def test_each_siren_sounds_for_itself_and_arrives_after_it_has_ended(boxes):
    """The ear moves towards both at 10 m/s."""
    ways, until = (40.0, 100.0), 8

    def heard(way_m, sounding=lambda _: True):
        return record(boxes, lambda _: way_m, 18, sounding, ear_m=lambda step: 10.0 * step * STEP_S)

    near, far, always = heard(ways[0]), heard(ways[1], lambda step: step < until), heard(ways[1])
    assert np.abs(heard(ways, lambda step: (True, step < until)) - near - far).max() <= 1.0
    assert np.array_equal(far[far != 0.0], always[far != 0.0])
    last = np.flatnonzero(far)[-1] / 16_000.0 - STEP_S
    expected = (until * STEP_S + ways[1] / SPEED_OF_SOUND_MPS) / (1.0 + 10.0 / SPEED_OF_SOUND_MPS)
    assert last == pytest.approx(expected, abs=2e-3)


def test_what_is_too_loud_is_cut_off(boxes):
    soft, loud = (record(boxes, lambda _: 40.0, 8, spec=replace(SPEC, full_scale_db=level)) for level in (110.0, 70.0))
    assert (loud.min(), loud.max()) == (-32767.0, 32767.0)
    assert np.array_equal(np.sign(loud)[soft != 0.0], np.sign(soft[soft != 0.0]))


def test_the_modes_take_turns():
    time_s, shares = np.array([3.0, 9.1, 17.2, 25.3]), (1.0, 0.5, 0.33, 0.25)
    cycles = [tone.phase(at) for tone, at in zip((WAIL, YELP) * 2, time_s, strict=True)]
    waves = [sum(share * np.sin(2.0 * np.pi * k * one) for k, share in enumerate(shares, 1)) for one in cycles]
    assert pressure(time_s) == pytest.approx(np.array(waves) / sum(shares))


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
