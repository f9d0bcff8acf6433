"""The plan of the house, held against the code: what may import what."""

import ast
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
LAYERS = [
    "cli",
    "benchmarks",
    "generation",
    "evaluation",
    "pictures",
    "datasets",
    "recording",
    "sensors",
    "behaviour",
    "dynamics",
    "traffic",
    "interfaces",
    "world",
]
"""From the top of the house to its foundation; each imports only what stands below it."""
ROS_MODULES = {"rclpy", "rcl_interfaces", "siren_msgs", "sensor_msgs", "std_msgs", "nav_msgs", "geometry_msgs"}
KNOWS_ROS = ("siren_ros/ros/", "siren_ros/ros2cli/", "nodes/")
KNOWS_SUMO = ("siren_ros/traffic/",)


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


def layer_of(module: str) -> str | None:
    parts = module.split(".")
    return parts[1] if parts[0] == "siren_ros" and len(parts) > 1 and parts[1] in [*LAYERS, "ros"] else None


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_imports_point_downwards(path: Path) -> None:
    name = path.relative_to(REPOSITORY).as_posix()
    modules = imports_of(path)
    roots = {module.split(".")[0] for module in modules}
    if not name.startswith(KNOWS_ROS):
        assert not roots & ROS_MODULES, "the library is pure: ROS belongs to siren_ros/ros and nodes"
        assert "siren_ros.ros" not in {".".join(module.split(".")[:2]) for module in modules}
    if not name.startswith(KNOWS_SUMO):
        assert not roots & {"libsumo", "traci"}, "SUMO belongs to siren_ros/traffic"
    if name.startswith("siren_ros/"):
        assert "siren_nodes" not in roots, "the library does not know the nodes"
        assert "nodes" not in roots
    own = (
        layer_of("siren_ros." + ".".join(path.relative_to(REPOSITORY / "siren_ros").with_suffix("").parts))
        if (name.startswith("siren_ros/"))
        else None
    )
    if own in LAYERS:
        below = LAYERS[LAYERS.index(own) :]
        above = {layer for module in modules if (layer := layer_of(module)) and layer not in below}
        assert not above, f"{own} imports what stands above it: {sorted(above)}"


def test_every_folder_has_its_place() -> None:
    folders = {path.name for path in (REPOSITORY / "siren_ros").iterdir() if path.is_dir() and any(path.glob("*.py"))}
    assert folders - set(LAYERS) - {"ros", "ros2cli"} == set()


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_library_code_neither_asserts_nor_exits(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert not [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Assert)]
    name = path.relative_to(REPOSITORY).as_posix()
    if not name.startswith(("nodes/", "siren_ros/cli/", "siren_ros/benchmarks/", "siren_ros/ros2cli/")):
        calls = [ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)]
        assert not {"sys.exit", "exit", "quit", "os._exit"} & set(calls)


@pytest.mark.parametrize("path", sorted((REPOSITORY / "nodes").glob("*.py")), ids=lambda path: path.name)
def test_nodes_are_thin(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 130


@pytest.mark.parametrize("path", source_files(), ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_files_hold_one_concept(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400
