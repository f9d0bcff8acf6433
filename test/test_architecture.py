"""The code held against its plan: what may import what, and where ``docs/architecture.md`` says that things are."""

import ast
import itertools
import re
from pathlib import Path

import pytest
from repository import REPOSITORY

LAYERS = {
    "": [
        "cli",
        "benchmarks",
        "training",
        "study_report",
        "studies",
        "calibration",
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
        "conflicts",
        "lockstep",
        "interfaces",
        "scenario",
        "roads",
        "world",
        "params",
        "numerics",
        "user_folder",
        "errors",
    ],
    "evaluation": [
        "paper_comparison",
        "diversity",
        "prediction",
        "detection",
        "risk",
        "yielding",
        "surrogate_safety",
        "statistics",
        "aligned_text",
        "network_file",
    ],
    "evaluation/detection": [
        "reports",
        "scoring",
        "self_test",
        "detectors",
        "pillars",
        "inputs",
        "metrics",
        "protocol",
    ],
    "evaluation/prediction": [
        "charts",
        "reports",
        "scoring",
        "submitted",
        "predictors",
        "published",
        "siren_model",
        "baselines",
        "metrics",
        "protocol",
    ],
    "datasets": [
        "export_job",
        "registry",
        "rerun",
        "scenarionet",
        "openscenario",
        "opendrive",
        "commonroad",
        "argoverse2",
        "ngsim",
        "nuscenes",
        "openpcdet",
        "kitti",
        "trajectory_csv",
        "exporting",
        "sources",
    ],
    "behaviour": ["civilians", "emv", "driving", "paths", "config"],
    "ros": ["programs", "participants", "transport", "parameters"],
    "roads": [
        "sites",
        "maps",
        "net_parser",
        "movements",
        "bend_speeds",
        "junction_lanes",
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
APART = {
    "sensors": {"interfaces"},
    "recording": {"sensors", "sensor_messages"},
    "judging": {"sensors", "sensor_messages"},
    "behaviour/civilians": {"behaviour/emv"},
}
"""Folders that must not import each other, whatever their order."""
ROS_MODULES = {"rclpy", "rcl_interfaces", "siren_msgs", "sensor_msgs", "std_msgs", "nav_msgs", "geometry_msgs"}
KNOWS_ROS = ("siren_ros/ros/", "nodes/")
KNOWS_TORCH = (
    "siren_ros/evaluation/prediction/published/",
    "siren_ros/training/fitting/",
    "siren_ros/training/risk/fitting/",
    "siren_ros/training/detection/fitting/",
)
"""Folders that may import torch, which an extra installs; they are loaded when somebody asks for them."""
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
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("import_module", "__import__")):
            found.add(imported_name(node))
    return found


def imported_name(call: ast.Call) -> str:
    """The module that a call of ``import_module`` names: as far as its text is known before it runs."""
    name = call.args[0]
    parts = name.values if isinstance(name, ast.JoinedStr) else [name]
    known = itertools.takewhile(lambda part: isinstance(part, ast.Constant), parts)
    return "".join(str(part.value) for part in known if isinstance(part, ast.Constant)).rstrip(".")


def layer_of(module: str, room: str) -> str | None:
    """The layer of a module within a folder of ``siren_ros``, by default ``siren_ros`` itself; None elsewhere."""
    inside = f"siren_ros.{room.replace('/', '.')}." if room else "siren_ros."
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
    if not name.startswith(KNOWS_TORCH):
        assert "torch" not in roots, "torch is an extra: it belongs to the folders that need it"
        known = {folder for folder in KNOWS_TORCH if any(_lies_in(module, folder[10:-1]) for module in modules)}
        assert not known, "these folders are loaded by name, so that everything else runs without torch"
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


@pytest.mark.parametrize("folder", APART)
def test_folders_that_are_apart_do_not_import_each_other(folder: str) -> None:
    for one, others in [(folder, APART[folder]), *((other, {folder}) for other in APART[folder])]:
        for path in (REPOSITORY / "siren_ros" / one).rglob("*.py"):
            seen = imports_of(path)
            known = {other for other in others if any(_lies_in(module, other) for module in seen)}
            assert not known, f"{path.name} of {one}"


def _lies_in(module: str, folder: str) -> bool:
    return f"{module}.".startswith(f"siren_ros.{folder.replace('/', '.')}.")


def test_imports_by_name_are_seen(tmp_path: Path) -> None:
    calls = [
        "import_module('siren_ros.a')",
        "importlib.import_module(f'siren_nodes.{name}')",
        "import_module(f'{name}.b')",
    ]
    (tmp_path / "module.py").write_text("\n".join(calls), encoding="utf-8")
    assert imports_of(tmp_path / "module.py") == {"siren_ros.a", "siren_nodes", ""}


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


PLAN = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
TO_COME = "(to come)"


def planned_folders() -> dict[str, bool]:
    """Folders of the plan's tree in its order, and whether they are still to come."""
    tree = PLAN.split("## The folder tree")[1].split("```")[1].strip("\n")
    found: dict[str, bool] = {}
    above: list[str] = []
    for line in tree.splitlines():
        name, text = line.strip().split(maxsplit=1)
        depth = (len(line) - len(line.lstrip())) // 2
        above = [*above[:depth], name.removesuffix("/")]
        found["/".join(above)] = text.startswith(TO_COME)
    return found


def rows_where_to_look() -> list[tuple[str, str, str]]:
    """What one looks for, file, symbol: the rows of the plan's last table."""
    table = PLAN.split("## Where to look")[1]
    rows = re.findall(r"^\| (.+?) \| `([^`]+)` \| `([^`]+)` \|$", table, re.MULTILINE)
    return [(looked_for, path, symbol) for looked_for, path, symbol in rows]


def names_defined_in(body: list[ast.stmt]) -> dict[str, list[ast.stmt]]:
    """Names that a module or class defines, each with the statements inside it."""
    found: dict[str, list[ast.stmt]] = {}
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = node.body
        elif isinstance(node, ast.Assign):
            found.update({target.id: [] for target in node.targets if isinstance(target, ast.Name)})
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found[node.target.id] = []
    return found


def test_the_plan_draws_every_folder() -> None:
    planned = planned_folders()
    there = {path.parent.relative_to(REPOSITORY).as_posix() for path in source_files()}
    assert {folder for folder, to_come in planned.items() if not to_come} == there
    assert not {folder for folder, to_come in planned.items() if to_come} & there, "no longer to come"


@pytest.mark.parametrize("room", LAYERS)
def test_the_plan_draws_folders_in_the_order_of_imports(room: str) -> None:
    folder = f"siren_ros/{room}" if room else "siren_ros"
    drawn = [Path(path).name for path in planned_folders() if Path(path).parent.as_posix() == folder]
    in_order = [layer for layer in LAYERS[room] if layer in drawn]
    assert [name for name in drawn if name in in_order] == in_order


def test_the_plan_has_enough_rows_of_where_to_look() -> None:
    rows = PLAN.split("## Where to look")[1].count("\n| ") - 1
    assert rows == len(rows_where_to_look()) > 40


@pytest.mark.parametrize(("looked_for", "path", "symbol"), rows_where_to_look())
def test_what_the_plan_points_to_is_there(looked_for: str, path: str, symbol: str) -> None:
    file = REPOSITORY / path
    assert file.is_file(), f"{looked_for}: mend the row in docs/architecture.md"
    inside = ast.parse(file.read_text(encoding="utf-8")).body
    for name in symbol.split("."):
        names = names_defined_in(inside)
        assert name in names, f"{looked_for}: {path} does not define {symbol}; mend the row in docs/architecture.md"
        inside = names[name]


def folders_of_the_library() -> list[Path]:
    library = REPOSITORY / "siren_ros"
    return sorted({library, *(path for path in library.rglob("*") if path.is_dir() and any(path.glob("*.py")))})


@pytest.mark.parametrize("folder", folders_of_the_library(), ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_a_folder_can_be_taken_in_at_a_glance(folder: Path) -> None:
    assert len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= 16
    assert ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("below", "above"), [("roads", "traffic"), ("roads", "scenario"), ("scenario", "traffic"), ("params", "scenario")]
)
def test_the_order_of_the_foundation(below: str, above: str) -> None:
    """Roads know no SUMO vehicle, scenarios no traffic: written out, since the table above may grow in between."""
    assert LAYERS[""].index(above) < LAYERS[""].index(below)
