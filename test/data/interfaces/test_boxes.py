from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import actor_states
from sensor_message_readers import from_boxes, from_markers

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.boxes import (
    EMV_COLOUR,
    LIFETIME_NS,
    MODE_COLOURS,
    MarkerShape,
    boxes_of,
    to_boxes,
    to_markers,
    vehicle_markers,
)
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, Mode
from siren_ros.simulation.world.carrier import GROUND_TRUTH_DTYPES, GroundTruth


@pytest.mark.parametrize("count", [0, 3])
@pytest.mark.parametrize("named", [False, True])
def test_boxes_come_back_with_or_without_ids(round_trip, count, named):
    random = np.random.default_rng(2)
    arrays = {name: random.uniform(0, 1, count).astype(dtype) for name, dtype in GROUND_TRUTH_DTYPES.items()}
    arrays["actor_id"] = np.arange(1, count + 1, dtype=np.uint32)
    arrays["actor_class"] = np.array([ActorClass.VAN, ActorClass.AMBULANCE, ActorClass.POLICE][:count], dtype=np.uint8)
    boxes = boxes_of(GroundTruth(step=40, carrier_id=9, **arrays), "lidar")
    boxes = replace(boxes, ids=boxes.ids if named else None, score=random.uniform(size=count))
    back = from_boxes(round_trip(to_boxes(boxes), topics.BOXES.type_name))
    assert (back.step, back.frame_id, back.class_names) == (40, "lidar", ("van", "ambulance", "police")[:count])
    assert back.ids == (tuple("123"[:count]) or None if named else None)
    for name in ("centre_m", "size_m", "yaw_rad", "score"):
        assert getattr(back, name) == pytest.approx(getattr(boxes, name))


def _states(modes):
    return actor_states(8, actor_id=range(1, len(modes) + 1), mode=modes, vx_mps=[10.0] * len(modes))


def _actor(actor_id, is_emv=False):
    return ActorDescription(actor_id, f"v{actor_id}", ActorClass.SEDAN, 4.6, 1.8, 1.4, (51, 102, 204), is_emv)


def test_markers_show_the_emv_the_yielding_and_the_rest():
    states = _states([Mode.ROUTE_FOLLOW, Mode.YIELD_LANE_CHANGE, Mode.NOMINAL])
    markers = vehicle_markers(states, {1: _actor(1, is_emv=True), 2: _actor(2), 3: _actor(3)})
    cubes = [marker for marker in markers if marker.shape is MarkerShape.CUBE]
    colours = [EMV_COLOUR, MODE_COLOURS[Mode.YIELD_LANE_CHANGE], (0.2, 0.4, 0.8, 0.85)]
    assert ([marker.colour for marker in cubes], cubes[0].size_m) == (colours, (4.6, 1.8, 1.4))
    assert cubes[0].centre_m[2] == pytest.approx(0.7)
    (label,) = [marker for marker in markers if marker.shape is MarkerShape.TEXT]
    assert label.text == "route follow  36 km/h"


def test_every_yielding_mode_has_a_colour_of_its_own():
    yielding = [mode for mode in Mode if mode.is_yielding]
    assert len({MODE_COLOURS[mode] for mode in yielding}) == len(yielding)


def test_a_box_is_turned_as_its_vehicle_and_a_text_is_upright_above_it(round_trip):
    states = replace(
        _states([Mode.NOMINAL]), x_m=np.array([3.0]), y_m=np.array([-4.0]), z_m=np.array([0.5]), yaw_rad=np.array([1.2])
    )
    markers = vehicle_markers(states, {1: _actor(1, is_emv=True)})
    drawn = round_trip(to_markers(8, markers), topics.MARKERS.type_name)
    box, text = drawn.markers
    for read, marker in zip(from_markers(drawn), markers, strict=True):
        assert (read.namespace, read.marker_id, read.shape) == (marker.namespace, marker.marker_id, marker.shape)
        assert read.colour == pytest.approx(marker.colour, abs=1e-6)
    centre, turn = box.pose.position, box.pose.orientation
    assert (centre.x, centre.y, centre.z) == pytest.approx((3.0, -4.0, 0.5 + 0.7))
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0.0, 0.0, np.sin(0.6), np.cos(0.6)))
    upright = text.pose.orientation
    assert (upright.x, upright.y, upright.z, upright.w) == (0.0, 0.0, 0.0, 1.0)
    above = text.pose.position
    assert (above.x, above.y) == (3.0, -4.0)
    assert above.z > 0.5 + 1.4
    assert text.scale.z > 0.0
    assert (text.color.r, text.color.g, text.color.b, text.color.a) == (1.0, 1.0, 1.0, 1.0)
    for marker in (box, text):
        assert marker.lifetime.sec * 10**9 + marker.lifetime.nanosec == LIFETIME_NS
        assert marker.header.frame_id == "map"
