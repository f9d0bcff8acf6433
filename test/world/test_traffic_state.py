"""Routes of one list for all vehicles, and the types of the columns."""

from typing import Any

import numpy as np

from siren_ros.world.traffic_state import TRAFFIC_STATE_DTYPES, TrafficFlags, TrafficState


def test_each_row_has_its_own_part_of_the_routes() -> None:
    columns: dict[str, Any] = {name: np.zeros(3, dtype) for name, dtype in TRAFFIC_STATE_DTYPES.items()}
    columns["route_offset"], columns["route_edges"] = (
        np.array([0, 2, 2, 5], np.int32),
        np.arange(10, 15, dtype=np.int32),
    )
    state = TrafficState(step=0, spawned=(), emvs=(), signals=(), **columns)
    assert [state.route_of_row(row).tolist() for row in range(3)] == [[10, 11], [], [12, 13, 14]]
    assert len(state) == 3


def test_columns_have_the_types_of_the_message() -> None:
    by_type: dict[Any, set[str]] = {}
    for name, dtype in TRAFFIC_STATE_DTYPES.items():
        by_type.setdefault(dtype, set()).add(name)
    assert by_type[np.uint32] == {"removed", "actor_id"}
    assert by_type[np.uint8] == {"owner", "lights", "flags"}
    assert by_type[np.int32] == {"lane", "route_offset", "route_edges"}
    assert {"sumo_x_m", "speed_mps", "lane_position_m", "lateral_offset_m"} <= by_type[np.float64]
    assert [int(flag) for flag in TrafficFlags] == [1, 2, 4, 8]
