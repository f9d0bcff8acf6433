from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import traffic_of
from hypothesis import given, settings
from hypothesis import strategies as st
from made_records import moving, record_with, samples_in

from siren_ros.errors import BagError
from siren_ros.scoring.evaluation.prediction.samples import (
    ARGOVERSE_WINDOW,
    HistoryWindow,
    Population,
    future_offsets,
    future_times_s,
    samples_of,
)
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.world.actors import ActorClass, Lights, SignalState


def test_the_future_is_5_s_and_the_history_3_s_every_200_ms_with_the_present() -> None:
    assert np.allclose(future_times_s(), np.arange(1, 26) * 0.2)
    assert len(future_offsets()) == 25
    assert np.allclose(HistoryWindow().times_s, np.arange(-15, 1) * 0.2)
    assert np.allclose(HistoryWindow(points=50, stride_frames=1).times_s, np.arange(-49, 1) * 0.1)


WINDOW = HistoryWindow()


@settings(max_examples=25, deadline=None)
@given(frames=st.integers(1, 110), late=st.integers(0, 7))
def test_a_gapless_track_gives_one_sample_for_each_frame_with_a_full_window(frames, late, straight_road) -> None:
    track = moving(0.0, -5.25, 5.0, steps=2 * frames - 1, first_step=2 * late)
    samples = samples_in({1: track}, straight_road)
    assert len(samples) == max(0, frames - 80)
    assert samples.future_xy_m.shape == (len(samples), 25, 2)
    longer = samples_in({1: track}, straight_road, HistoryWindow(points=50, stride_frames=1))
    assert len(longer) == max(0, frames - 99)


def test_a_window_with_a_missing_point_is_no_sample(straight_road) -> None:
    whole = moving(0.0, -5.25, 5.0, steps=2 * 90 - 1)
    gap = replace(whole, without=frozenset({80}))
    assert len(samples_in({1: whole}, straight_road)) == 10
    scored = samples_in({1: gap}, straight_road)
    # Frame 40 is missing: it is a grid point of the windows of every second frame.
    assert (scored.batch.step // 2).tolist() == [31, 33, 35, 37, 39]


def test_a_batch_says_of_every_vehicle_of_every_frame_what_was_logged(straight_road) -> None:
    """1 and 7 have samples at frames 30 and 31; 4 comes at step 54 and turns; SUMO says lanes from step 40 on."""
    tracks = {
        1: moving(3.0, -5.25, 5.0, 0.4, steps=163, actor_class=ActorClass.VAN, length_m=5.1),
        4: moving(40.0, -1.75, 4.0, -0.3, 0.2, steps=109, first_step=54, actor_class=ActorClass.BUS, length_m=12.0),
        7: moving(90.0, 1.75, 9.0, 0.1, np.pi, steps=163, is_emv=True, actor_class=ActorClass.AMBULANCE, length_m=6.2),
    }
    record = record_with(tracks, straight_road)
    bodies = {key: replace(body, width_m=1.5 + 0.1 * key) for key, body in record.actors.items()}
    lights = {1: int(Lights.BRAKE), 4: int(Lights.INDICATOR_LEFT), 7: int(Lights.BEACON | Lights.SIREN)}
    lanes = {1: 0, 7: 3}

    def shown(state):
        keys = state.actor_id.tolist()
        return replace(state, lights=np.array([lights[key] if state.step == 60 else 0 for key in keys], dtype=np.uint8))

    traffic = tuple(traffic_of(step, actor_id=[*lanes], lane=[*lanes.values()]) for step in range(40, 163))
    record = replace(record, actors=bodies, states=tuple(map(shown, record.states)), traffic=traffic)
    scored = samples_of(record, WINDOW, Population.ALL)
    batch = scored.batch
    assert (batch.step.tolist(), batch.frame_offset.tolist()) == ([60, 62], [0, 3, 6])
    assert (batch.target.tolist(), batch.signals) == ([0, 2, 3, 5], {})
    assert (batch.sample_step.tolist(), batch.actor_id.tolist()) == ([60, 60, 62, 62], [1, 7, 1, 7])

    def logged(key: int, step: int) -> tuple[float, ...]:
        """x, y, vx, vy, yaw, acceleration and SUMO's lane; zeros and no lane where nothing was logged."""
        x_m, y_m, mps, mps2, yaw, first = {
            1: (3.0, -5.25, 5.0, 0.4, 0.0, 0),
            4: (40.0, -1.75, 4.0, -0.3, 0.2, 54),
            7: (90.0, 1.75, 9.0, 0.1, np.pi, 0),
        }[key]
        if step < first:
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, NO_LANE
        time_s = 0.05 * (step - first)
        along, speed = mps * time_s + 0.5 * mps2 * time_s**2, mps + mps2 * time_s
        place = x_m + along * np.cos(yaw), y_m + along * np.sin(yaw), speed * np.cos(yaw), speed * np.sin(yaw)
        return *place, yaw, mps2, lanes.get(key, NO_LANE) if step >= 40 else NO_LANE

    rows = [(key, step) for step in (60, 62) for key in (1, 4, 7)]
    table = np.array([[logged(key, step - 4 * back) for back in range(15, -1, -1)] for key, step in rows])
    expected = {
        "frame": [0, 0, 0, 1, 1, 1],
        "actor_id": [1, 4, 7] * 2,
        "actor_class": [ActorClass.VAN, ActorClass.BUS, ActorClass.AMBULANCE] * 2,
        "is_emv": [False, False, True] * 2,
        "length_m": [5.1, 12.0, 6.2] * 2,
        "width_m": [1.6, 1.9, 2.2] * 2,
        "lights": [*lights.values(), 0, 0, 0],
        "observed": [[key != 4 or step - 4 * back >= 54 for back in range(15, -1, -1)] for key, step in rows],
        "xy_m": table[..., :2],
        "velocity_mps": table[..., 2:4],
        "yaw_rad": table[..., 4],
        "accel_mps2": table[..., 5],
        "past_sumo_lane": table[..., 6],
    }
    assert list(vars(batch.actors)) == list(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(batch.actors, name), values, atol=1e-9, err_msg=name)
    targets = [(1, 60), (7, 60), (1, 62), (7, 62)]
    future = [[logged(key, step + 4 * ahead)[:2] for ahead in range(1, 26)] for key, step in targets]
    np.testing.assert_allclose(scored.future_xy_m, future, atol=1e-9)
    last = batch.between(1, 2)
    assert (last.step.tolist(), last.frame_offset.tolist(), last.target.tolist()) == ([62], [0, 3], [0, 2])
    for name, values in expected.items():
        wanted = np.zeros(3) if name == "frame" else np.array(values)[3:]
        np.testing.assert_allclose(getattr(last.actors, name), wanted, atol=1e-9, err_msg=name)
    chosen = scored.select(np.array([1, 2]))
    assert chosen.batch.target.tolist() == [2, 3]
    assert (chosen.future_xy_m == scored.future_xy_m[1:3]).all()


def test_neighbours_are_the_others_of_the_frame_even_with_a_short_past(straight_road) -> None:
    later = moving(70.0, -1.75, 0.0, first_step=70, steps=40)
    tracks = {1: moving(0.0, -5.25, 5.0), 2: moving(40.0, -5.25, 5.0), 7: later}
    batch = samples_in(tracks, straight_road).batch
    sample, other = batch.neighbours()
    target = batch.target[sample]
    assert (batch.actors.frame[target] == batch.actors.frame[other]).all()
    assert (target != other).all()
    last = batch.sample_step == 80
    actor_id = batch.actors.actor_id
    ids = {int(batch.actor_id[row]): actor_id[other[sample == row]].tolist() for row in np.flatnonzero(last)}
    assert ids == {1: [2, 7], 2: [1, 7]}
    short = (batch.actors.actor_id == 7) & (batch.step[batch.actors.frame] == 80)
    assert batch.actors.observed[short].sum() == 3
    assert (batch.actors.xy_m[short][:, :13] == 0.0).all()


def test_people_have_samples_of_their_own(straight_road) -> None:
    """Samples of vehicles see cyclists and nobody on foot; samples of people see everybody."""
    kinds = {1: ActorClass.SEDAN, 2: ActorClass.PEDESTRIAN, 3: ActorClass.BICYCLE, 4: ActorClass.MOTORCYCLE}
    tracks = {key: moving(4.0 * key, -5.25, 1.0, steps=201, actor_class=kind) for key, kind in kinds.items()}
    record = record_with(tracks, straight_road)
    record = replace(record, description=replace(record.description, emv_ids=(1,)))
    for population in Population:
        vehicles, people = (
            samples_of(record, HistoryWindow(), population, people=people).batch for people in (False, True)
        )
        assert set(vehicles.actor_id.tolist()) == {1}
        assert set(vehicles.actors.actor_id.tolist()) == {1, 3, 4}
        assert set(people.actor_id.tolist()) == {2, 3, 4}
        assert set(people.actors.actor_id.tolist()) == {1, 2, 3, 4}
        assert len(people) == 3 * len(vehicles)


def test_states_of_an_unknown_actor_are_refused(straight_road) -> None:
    record = record_with({1: moving(0.0, -5.25, 5.0), 2: moving(0.0, -1.75, 5.0)}, straight_road)
    with pytest.raises(BagError, match=r"\[2\]"):
        samples_of(replace(record, actors={1: record.actors[1]}), WINDOW, Population.ALL)


def test_signals_are_those_of_the_frames(straight_road) -> None:
    """A frame is every second step; between them, before the first and behind the last one nothing is asked."""
    record = record_with({1: moving(0.0, -5.25, 5.0, steps=2 * 83 - 1)}, straight_road)
    first, second, last = samples_of(record, HistoryWindow(), Population.ALL).batch.step.tolist()
    shown = {first - 1: "rr", first: "rG", second: "yG", second + 1: "gg", last + 2: "Gr"}
    said = {"actor_id": [1], "lane": [NO_LANE]}
    traffic = tuple(traffic_of(n, **said, signals=(SignalState("crossing", at),)) for n, at in shown.items())
    signals = samples_of(replace(record, traffic=traffic), HistoryWindow(), Population.ALL).batch.signals
    assert [bytes(row) for row in signals["crossing"]] == [b"rG", b"yG", b"\0\0"]


def test_frames_behind_the_horizon_have_to_be_logged_where_the_window_says_so(straight_road) -> None:
    """Argoverse's window: 5 s before and 6 s after the present, every tenth of a second of them."""
    for frames, count in ((110, 1), (109, 0), (113, 4)):
        track = moving(0.0, -5.25, 5.0, steps=2 * frames - 1)
        assert len(samples_in({1: track}, straight_road, ARGOVERSE_WINDOW)) == count
    # Of 4 samples, with presents at 49 to 52: frame 112 is needed by the last alone, frame 103 by all of them.
    for missing, left in ((112, [49, 50, 51]), (103, [])):
        track = moving(0.0, -5.25, 5.0, steps=225, without=frozenset({2 * missing}))
        scored = samples_in({1: track}, straight_road, ARGOVERSE_WINDOW)
        assert (scored.batch.step // 2).tolist() == left
