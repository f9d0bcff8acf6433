"""nuScenes' categories, levels, channels and the mask of where one can drive."""

import io

import numpy as np
import pytest
from hand_made_record import crossing
from PIL import Image

from siren_ros.data.datasets.nuscenes import episode_tables
from siren_ros.data.datasets.nuscenes.map_expansion import map_corners, mask_png
from siren_ros.data.record.episode_source import MountedCamera
from siren_ros.sensing.specification import Mount
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.measurements import CameraIntrinsics


def test_emergency_vehicles_are_cars_unless_they_have_their_own():
    for member in ActorClass:
        category = episode_tables.CATEGORY_OF_CLASS[member]
        plain, emergency, paper = (
            episode_tables.category_of(member, episode_tables.CAR),
            episode_tables.category_of(member, episode_tables.EMERGENCY),
            episode_tables.category_of(member, episode_tables.EMERGENCY, episode_tables.CAR),
        )
        if member.is_emergency:
            assert (plain, emergency, paper) == (episode_tables.CAR, category, category)
            assert category.startswith("vehicle.emergency.")
        elif member is ActorClass.PEDESTRIAN:
            assert {plain, emergency, paper} == {"human.pedestrian.adult"}
        else:
            assert (plain, emergency, paper) == (category, category, episode_tables.CAR)


@pytest.mark.parametrize(
    ("fraction", "level"), [(0.0, "1"), (0.39, "1"), (0.4, "2"), (0.6, "3"), (0.79, "3"), (0.8, "4"), (1.0, "4")]
)
def test_levels_of_visibility(fraction, level):
    assert episode_tables.visibility_of(fraction) == level


def test_who_is_slower_than_a_foot_per_second_stands():
    assert episode_tables.attribute_of(ActorClass.BICYCLE, 0.31) == "cycle.with_rider"
    walks = ActorClass.PEDESTRIAN
    assert (episode_tables.attribute_of(walks, 0.31), episode_tables.attribute_of(walks, 0.29)) == (
        "pedestrian.moving",
        "pedestrian.standing",
    )
    car = ActorClass.SEDAN
    assert (episode_tables.attribute_of(car, 0.31), episode_tables.attribute_of(car, 0.29)) == (
        "vehicle.moving",
        "vehicle.stopped",
    )


def test_tokens_are_md5_of_their_parts():
    assert episode_tables.token("a", 1, "b") == episode_tables.token("a/1/b") != episode_tables.token("a", 1)
    assert episode_tables.token("") == "d41d8cd98f00b204e9800998ecf8427e"


def test_fixed_tables_number_the_categories_from_one():
    tables = episode_tables.fixed_tables()
    assert [row["index"] for row in tables["category"]] == list(
        range(1, 1 + len(set(episode_tables.CATEGORY_OF_CLASS.values())))
    )
    assert [row["name"] for row in tables["category"]] == sorted(set(episode_tables.CATEGORY_OF_CLASS.values()))
    assert tables["visibility"][1]["description"] == "visible fraction 40-60 %"
    assert tables["attribute"][0]["token"] == episode_tables.token("attribute", "vehicle.moving")


def camera(name: str, yaw_deg: float) -> MountedCamera:
    mount = Mount(1.0, 0.0, 1.5, yaw_rad=np.radians(yaw_deg)).base_from_sensor
    optical = mount @ np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    model = CameraIntrinsics(8, 6, 4.0, 4.0, 4.0, 3.0)
    return MountedCamera(name=name, topic=name, base_from_sensor=optical, model=model, truth_topic="")


@pytest.mark.parametrize(
    ("yaw_deg", "channel"),
    [
        (0.0, "CAM_FRONT"),
        (29.0, "CAM_FRONT"),
        (55.0, "CAM_FRONT_LEFT"),
        (-55.0, "CAM_FRONT_RIGHT"),
        (84.0, "CAM_FRONT_LEFT"),
        (86.0, "CAM_BACK_LEFT"),
        (-110.0, "CAM_BACK_RIGHT"),
        (149.0, "CAM_BACK_LEFT"),
        (151.0, "CAM_BACK"),
        (180.0, "CAM_BACK"),
        (-175.0, "CAM_BACK"),
    ],
)
def test_channels_are_where_cameras_look(yaw_deg, channel):
    assert episode_tables.channels((camera("one", yaw_deg),)) == {"one": channel}


def test_a_second_camera_of_a_direction_is_numbered():
    names = episode_tables.channels((camera("a", 0.0), camera("b", 5.0), camera("c", -5.0), camera("d", 50.0)))
    assert names == {"a": "CAM_FRONT", "b": "CAM_FRONT_2", "c": "CAM_FRONT_3", "d": "CAM_FRONT_LEFT"}


def test_the_lidars_axes_are_right_and_ahead():
    """A point 5 m ahead and 2 m to the left."""
    assert (episode_tables.NUSCENES_FROM_LIDAR @ [5.0, 2.0, 1.0, 1.0]).tolist() == [-2.0, 5.0, 1.0, 1.0]
    turned = np.eye(4)
    turned[:3, :3] = [[0.0, -1.0, 0], [1.0, 0, 0], [0, 0, 1.0]]
    assert episode_tables.rotation_wxyz(turned) == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])


def test_the_mask_is_white_where_one_drives():
    """10 pixels for each metre from the lower left corner, 60 m beyond the outermost centre lines."""
    network = crossing()
    low, high = map_corners(network)
    assert (low.tolist(), high.tolist()) == ([-170.0, -180.0], [180.0, 170.0])
    image = Image.open(io.BytesIO(mask_png(network)))
    assert image.size == (3500, 3500)

    def at(x_m: float, y_m: float) -> int:
        return int(image.getpixel((round((x_m - low[0]) * 10), round(3500 - (y_m - low[1]) * 10))))

    # The approach from the south reaches from 0 to 9.5 m; then nothing until the road of its own from 12.25 m on.
    assert [at(x_m, -70.0) for x_m in (0.3, 5.0, 9.2, 9.8, 12.0, 12.5, 15.5, 16.0)] == [
        255,
        255,
        255,
        0,
        0,
        255,
        255,
        0,
    ]
    assert at(-5.0, 0.0) == 255, "the junction"
    assert at(60.0, 40.0) == 0
