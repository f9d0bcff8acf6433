"""The layout for Foxglove: it shows topics that a bag has, and each panel stands somewhere."""

import json
import re
from typing import Any

import av
from repository import REPOSITORY

from siren_ros.cli.main import main
from siren_ros.data.recording.bag_reader import open_bag

LAYOUT = json.loads((REPOSITORY / "params" / "foxglove" / "siren.json").read_text(encoding="utf-8"))


def _leaves(node: Any) -> list[str]:
    return [node] if isinstance(node, str) else [*_leaves(node["first"]), *_leaves(node["second"])]


def test_every_panel_has_its_place():
    assert sorted(_leaves(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


def test_topics_are_those_of_a_bag(sensed_bag):
    names = set(re.findall(r'"(/(?:emv|siren)/[a-z_/]+)', json.dumps(LAYOUT["configById"])))
    with open_bag(sensed_bag) as bag:
        assert names <= set(bag.type_names)
    assert len(names) > 10


def test_the_grid_film_shows_every_camera(sensed_bag, tmp_path):
    film = tmp_path / "grid.mp4"
    assert main(["video", str(sensed_bag), "--view", "grid", "--frames", "5", "--out", str(film)]) == 0
    with av.open(str(film)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == 5
    assert frames[0].shape == (960, 1920, 3)
    for row, column in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1)):
        cell = frames[2][row * 480 + 60 : row * 480 + 420, column * 640 + 20 : column * 640 + 620]
        assert cell.std() > 10.0, "a picture"
    assert frames[2][500:940, 1300:1900].std() < 3.0, "the sixth place is empty"
