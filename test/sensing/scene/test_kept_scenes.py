"""A scene that was kept is the scene that was built, and nothing else is taken for it."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from made_crossing import ARMS, CROSSING, made_net

from siren_ros.sensing.meshes.mesh import Mesh
from siren_ros.sensing.scene import static_scene
from siren_ros.sensing.scene.static_scene import kept_scene
from siren_ros.sensing.scene.surfaces import SceneConfig
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import right_hand_image

NET = """<net>
  <location netOffset="0.00,0.00" convBoundary="0.00,0.00,200.00,0.00" projParameter="!"/>
  <edge id="a" from="A" to="B" priority="1">
    <lane id="a_0" index="0" disallow="all" allow="pedestrian" speed="13.9" length="200" width="2" shape="0,-6 200,-6"/>
    <lane id="a_1" index="1" speed="13.9" length="200" width="3.5" shape="0,-3 200,-3"/>
  </edge>
  <junction id="A" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,-7"/>
  <junction id="B" type="dead_end" x="200" y="0" incLanes="a_0 a_1" intLanes="" shape="200,0 200,-7"/>
</net>"""
COLUMNS = ("vertices_m", "triangles", "material", "colour_rgb")


@pytest.fixture(name="network")
def _network():
    return parse_road_network(NET.encode())


@pytest.fixture(name="folder", autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.setenv("SIREN_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture(name="built")
def _built(monkeypatch):
    """The seeds of the scenes that are built."""
    seeds, build = [], static_scene.static_scene
    monkeypatch.setattr(static_scene, "static_scene", lambda *given: (seeds.append(given[1]), build(*given))[1])
    return seeds


def files(folder):
    return sorted(folder.glob("scene-*.npz"))


def is_same(one, other):
    columns = [(getattr(one.mesh, name), getattr(other.mesh, name)) for name in COLUMNS]
    return (
        all(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in columns)
        and one.signal_lamps == other.signal_lamps
        and shapely.to_wkb(one.raised) == shapely.to_wkb(other.raised)
        and (one.raised_m, one.parked) == (other.raised_m, other.parked)
    )


def test_the_second_call_reads_what_the_first_one_built(network, built):
    first, second = kept_scene(network, 3), kept_scene(network, 3)
    assert built == [3]
    assert is_same(first, second)
    assert len(second.mesh) > 500
    places = np.array([10.0, 10.0]), np.array([-6.0, -3.0])
    assert second.ground_m(*places).tolist() == first.ground_m(*places).tolist() == [SceneConfig().kerb_height_m, 0.0]


def test_signals_come_back(tmp_path, built):
    network = parse_road_network(made_net(tmp_path, CROSSING, ARMS))
    first, second = kept_scene(network, 0), kept_scene(network, 0)
    assert built == [0]
    assert is_same(first, second)
    assert {type(lamp.colour) for lamp in second.signal_lamps} == {type(lamp.colour) for lamp in first.signal_lamps}


def test_another_seed_net_or_number_is_another_scene(network, folder, built):
    kept_scene(network, 3)
    kept_scene(network, 4)
    kept_scene(parse_road_network(NET.replace('shape="0,-3 200,-3"', 'shape="0,-3 190,-3"').encode()), 3)
    kept_scene(network, 3, SceneConfig(clutter_per_100_m=5.0))
    assert built == [3, 4, 3, 3]
    assert len(files(folder)) == 4
    kept_scene(network, 3, SceneConfig())
    assert built == [3, 4, 3, 3], "the same numbers as without"
    file, *_ = files(folder)
    with np.load(file) as content:
        assert set(content.files) == {"head", "raised", *Mesh.__dataclass_fields__}


def test_what_makes_a_scene_is_code_and_packages(monkeypatch, network, folder, built):
    library = Path(static_scene.__file__).parents[2]
    assert [name for name in static_scene.CODE if not list((library / name).glob("*.py"))] == []
    recipes = [static_scene.recipe.__wrapped__()]
    monkeypatch.setattr(static_scene, "CODE", static_scene.CODE[:-1])
    recipes.append(static_scene.recipe.__wrapped__())
    monkeypatch.setattr(static_scene, "version", lambda name: f"{name} of tomorrow")
    recipes.append(static_scene.recipe.__wrapped__())
    assert len(set(recipes)) == 3
    kept_scene(network, 3)
    monkeypatch.setattr(static_scene, "recipe", lambda: "other code")
    kept_scene(network, 3)
    assert built == [3, 3]
    assert len(files(folder)) == 2


def test_networks_that_were_changed_and_scenes_with_parked_vehicles_are_built(network, folder, built):
    for _ in range(2):
        kept_scene(replace(network, crossings=()), 3)
        kept_scene(network, 3, SceneConfig(parked_share=0.5))
    assert built == [3, 3, 3, 3]
    assert files(folder) == []


def test_a_scene_where_traffic_keeps_left_comes_back(built):
    left = parse_road_network(NET.replace("<net>", '<net lefthand="true">').encode())
    assert left.left_hand
    assert right_hand_image(left).net_sha256 == "", "is not taken for the net"
    first = kept_scene(left, 3)
    built.clear()
    assert is_same(first, kept_scene(left, 3))
    assert built == []


@pytest.mark.parametrize(
    "damage",
    [
        lambda _: b"",
        lambda content: content[: len(content) // 2],
        lambda content: content[:-1],
        lambda content: content[:5000] + bytes(8) + content[5008:],
        lambda _: b"a file of somebody else",
    ],
    ids=["empty", "half", "cut", "changed", "foreign"],
)
def test_a_damaged_file_is_made_again(network, folder, built, damage):
    scene = kept_scene(network, 3)
    (file,) = files(folder)
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert file.read_bytes() != whole
    assert is_same(kept_scene(network, 3), scene)
    assert built == [3, 3]
    assert file.read_bytes() == whole


def test_the_file_of_another_scene_under_its_name_is_not_read(network, folder, built):
    other, scene = kept_scene(network, 4), None
    (its,) = files(folder)
    content = its.read_bytes()
    scene = kept_scene(network, 3)
    (file,) = set(files(folder)) - {its}
    file.write_bytes(content)
    assert is_same(kept_scene(network, 3), scene)
    assert not is_same(scene, other)
    assert built == [4, 3, 3]


def test_a_folder_that_cannot_be_written_costs_time_alone(network, tmp_path, built, monkeypatch):
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    monkeypatch.setenv("SIREN_CACHE_DIR", str(tmp_path / "file"))
    assert is_same(kept_scene(network, 3), kept_scene(network, 3))
    assert built == [3, 3]


def test_the_files_used_last_stay(network, folder, built, monkeypatch):
    monkeypatch.setattr(static_scene, "KEPT", 2)
    for seed in (1, 2):
        kept_scene(network, seed)
    for file in files(folder):
        os.utime(file, (1.0, 1.0))
    for seed in (1, 3):
        kept_scene(network, seed)
    assert len(files(folder)) == 2
    assert not [file for file in folder.iterdir() if file.suffix != ".npz"]
    kept_scene(network, 1)
    kept_scene(network, 3)
    assert built == [1, 2, 3]
    kept_scene(network, 2)
    assert built == [1, 2, 3, 2]
