"""The plan of the house, held against the code: what may import what."""

import ast
from pathlib import Path

import pytest
from repository import REPOSITORY

LAYERS = {
    "": [
        "cli",
        "benchmarks",
        "generation",
        "evaluation",
        "pictures",
        "datasets",
        "judging",
        "recording",
        "sensor_messages",
        "sensors",
        "behaviour",
        "dynamics",
        "traffic",
        "lockstep",
        "interfaces",
        "scenario",
        "roads",
        "world",
        "params",
        "numerics",
        "errors",
    ],
    "behaviour": ["civilians", "emv", "driving", "paths", "config", "constants"],
    "ros": ["programs", "participants", "transport", "parameters"],
    "roads": [
        "sites",
        "maps",
        "net_parser",
        "movements",
        "lane_permissions",
        "map_projection",
        "routing",
        "road_network",
    ],
    "sensors": [
        "rig",
        "truth",
        "camera",
        "lidar",
        "hearing",
        "navigation",
        "scene",
        "vehicles",
        "meshes",
        "suite",
    ],
    "traffic": ["simulation", "observation", "sumo", "demand"],
}
"""From the top to the foundation, in ``siren_ros`` and in the folders that have rooms; imports go downwards only."""
ROS_MODULES = {"rclpy", "rcl_interfaces", "siren_msgs", "sensor_msgs", "std_msgs", "nav_msgs", "geometry_msgs"}
KNOWS_ROS = ("siren_ros/ros/", "nodes/")
KNOWS_SUMO = ("siren_ros/traffic/sumo/", "siren_ros/traffic/simulation.py")


def source_files() -> list[Path]:
    return sorted([*(REPOSITORY / "siren_ros").rglob("*.py"), *(REPOSITORY / "nodes").rglob("*.py")])


def imports_of(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def layer_of(module: str, room: str) -> str | None:
    """The layer of a module within a folder of ``siren_ros``, by default ``siren_ros`` itself; None elsewhere."""
    inside = f"siren_ros.{room}." if room else "siren_ros."
    return module.removeprefix(inside).split(".")[0] if module.startswith(inside) else None


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_imports_point_downwards(path: Path) -> None:
    name = path.relative_to(REPOSITORY).as_posix()
    modules = imports_of(path)
    roots = {module.split(".")[0] for module in modules}
    if not name.startswith(KNOWS_ROS):
        assert not roots & ROS_MODULES, "the library is pure: ROS belongs to siren_ros/ros and nodes"
        assert name.startswith("siren_ros/benchmarks/") or "siren_ros.ros" not in {
            ".".join(module.split(".")[:2]) for module in modules
        }
    if not name.startswith(KNOWS_SUMO):
        assert not roots & {"libsumo", "traci"}, "SUMO belongs to siren_ros/traffic/sumo"
    if name.startswith("siren_ros/"):
        assert "siren_nodes" not in roots, "the library does not know the nodes"
        assert "nodes" not in roots
    here = ".".join(path.relative_to(REPOSITORY).with_suffix("").parts)
    for room, layers in LAYERS.items():
        own = layer_of(here, room)
        if own in layers:
            seen = {layer_of(module, room) for module in modules} & set(layers)
            above = {layer for layer in seen if layers.index(layer) < layers.index(own)}
            assert not above, f"{own} imports what stands above it: {sorted(above)}"


@pytest.mark.parametrize("room", LAYERS)
def test_every_folder_has_its_place(room: str) -> None:
    folder = REPOSITORY / "siren_ros" / room
    folders = {path.name for path in folder.iterdir() if path.is_dir() and any(path.glob("*.py"))}
    assert folders - set(LAYERS[room]) - {"ros"} == set()


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_library_code_neither_asserts_nor_exits(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert not [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Assert)]
    name = path.relative_to(REPOSITORY).as_posix()
    if not name.startswith(("nodes/", "siren_ros/cli/", "siren_ros/benchmarks/")):
        calls = [ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)]
        assert not {"sys.exit", "exit", "quit", "os._exit"} & set(calls)


@pytest.mark.parametrize("path", sorted((REPOSITORY / "nodes").glob("*.py")), ids=lambda path: path.name)
def test_nodes_are_thin(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 130


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_files_hold_one_concept(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400
