"""The code held against its plan: the contracts of ``.importlinter``, and what ``docs/architecture.md`` says."""

import ast
import configparser
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from repository import REPOSITORY

LIBRARY = REPOSITORY / "siren_ros"
PLAN = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
CONTRACTS = configparser.ConfigParser()
CONTRACTS.read(REPOSITORY / ".importlinter", encoding="utf-8")
MAY_EXIT = ("nodes/", "siren_ros/cli/", "siren_ros/lab/benchmarks/", "siren_ros/lab/learning/snapshot.py")
"""Programs, and the forks of a snapshot, which nothing else may end."""
LOADS_ROS_BY_NAME = ("nodes/", "siren_ros/running/ros/", "siren_ros/lab/benchmarks/")


@cache
def sources() -> list[tuple[str, ast.Module]]:
    """Each file of the library and of the nodes: its path in the repository and its syntax tree."""
    paths = [path for folder in (LIBRARY, REPOSITORY / "nodes") for path in sorted(folder.rglob("*.py"))]
    return [(path.relative_to(REPOSITORY).as_posix(), ast.parse(path.read_text(encoding="utf-8"))) for path in paths]


def calls(tree: ast.Module) -> Iterator[tuple[str, ast.Call]]:
    """Each call with the dotted name of what it calls; calls of what is no name are left out."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id=name)):
                yield name, node
            case ast.Call(func=ast.Attribute(value=ast.Name(id=module), attr=name)):
                yield f"{module}.{name}", node


def packages(folder: Path) -> set[str]:
    return {path.parent.name for path in folder.glob("*/*.py")}


def test_imports_keep_the_contracts() -> None:
    linter = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as lint; lint()"]
    done = subprocess.run([*linter, "--no-cache"], cwd=REPOSITORY, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_modules_loaded_by_name_keep_the_contracts_too() -> None:
    """import-linter reads import statements; ROS, SUMO and nodes shall not come in through ``import_module`` either."""
    offenders = [
        f"{path}:{call.lineno}"
        for path, tree in sources()
        if not path.startswith(LOADS_ROS_BY_NAME)
        for name, call in calls(tree)
        if name.endswith(("import_module", "__import__"))
        if re.match(r"f?'(rclpy|libsumo|traci|siren_nodes|siren_ros\.ros|\{(?!__package__))", ast.unparse(call.args[0]))
    ]
    assert offenders == []


def test_library_code_neither_asserts_nor_exits() -> None:
    asserts = [
        f"{path}:{node.lineno}" for path, tree in sources() for node in ast.walk(tree) if isinstance(node, ast.Assert)
    ]
    exits = [
        f"{path}:{call.lineno}"
        for path, tree in sources()
        if not path.startswith(MAY_EXIT)
        for name, call in calls(tree)
        if name in {"sys.exit", "exit", "quit", "os._exit"}
    ]
    assert asserts + exits == []


def test_nodes_are_thin() -> None:
    nodes = (REPOSITORY / "nodes").glob("*.py")
    assert [path.name for path in nodes if len(path.read_text(encoding="utf-8").splitlines()) > 130] == []


def planned_folders() -> list[str]:
    """Folders of the plan's tree, in its order."""
    planned: list[str] = []
    above: list[str] = []
    for line in PLAN.split("## The folder tree")[1].split("```")[1].strip("\n").splitlines():
        depth = (len(line) - len(line.lstrip())) // 2
        above = [*above[:depth], line.split()[0].removesuffix("/")]
        planned.append("/".join(above))
    return planned


def test_the_plan_draws_folders_that_are_there_and_every_room() -> None:
    planned = planned_folders()
    assert [folder for folder in planned if not (REPOSITORY / folder).exists()] == []
    assert packages(LIBRARY) - {Path(folder).name for folder in planned} == set()


def test_the_plan_draws_folders_in_the_order_of_imports() -> None:
    for section in CONTRACTS.values():
        if section.get("type") != "layers":
            continue
        room = section["containers"].replace(".", "/")
        drawn = [Path(folder).name for folder in planned_folders() if Path(folder).parent.as_posix() == room]
        in_order = [layer for layer in section["layers"].split() if layer in drawn]
        assert [name for name in drawn if name in in_order] == in_order, room


def test_every_folder_has_its_layer() -> None:
    for section in CONTRACTS.values():
        if section.get("type") == "layers":
            room = REPOSITORY / section["containers"].replace(".", "/")
            assert packages(room) - set(section["layers"].split()) - {"ros"} == set(), room


def names_defined_in(body: list[ast.stmt]) -> dict[str, list[ast.stmt]]:
    """Names that a module or class defines, each with the statements inside it."""
    names: dict[str, list[ast.stmt]] = {}
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names[node.name] = node.body
        elif isinstance(node, ast.Assign):
            names.update({target.id: [] for target in node.targets if isinstance(target, ast.Name)})
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names[node.target.id] = []
    return names


def is_defined(path: str, symbol: str) -> bool:
    """Whether a file is there and defines a symbol such as ``Class.method``."""
    file = REPOSITORY / path
    inside = ast.parse(file.read_text(encoding="utf-8")).body if file.is_file() else []
    for name in symbol.split("."):
        names = names_defined_in(inside)
        if name not in names:
            return False
        inside = names[name]
    return True


def test_what_the_plan_points_to_is_there() -> None:
    table = PLAN.split("## Where to look")[1]
    rows = re.findall(r"^\|(.+?)\|`([^`]+)` `([^`]+)`\|$", table, re.MULTILINE)
    assert len(rows) == table.count("\n|") - 2 > 20
    assert [row for row in rows if not is_defined(row[1], row[2])] == []


def ways_out_of_the_repository(tree: ast.Module) -> Iterator[ast.expr]:
    """Where a source builds a path to the shared folder, or to anything else beside the repository."""
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Name(id="REPOSITORY"), attr="parent" | "parents") | ast.Name(id="_SHARED"):
                yield node
            case ast.Constant(value=str(text)) if "shared" in text.split("/") and not re.search(r"\s", text):
                yield node


def test_no_test_looks_for_the_shared_folder_by_itself() -> None:
    """``shared_file`` finds its files and skips a test where they are absent: a clone with nothing beside it passes."""
    offenders = [
        f"{path.relative_to(REPOSITORY)}:{node.lineno}"
        for path in sorted((REPOSITORY / "test").rglob("*.py"))
        if path.name not in {"repository.py", Path(__file__).name}
        if re.search(r"shared|_SHARED|REPOSITORY\.parent", text := path.read_text(encoding="utf-8"))
        for node in ways_out_of_the_repository(ast.parse(text))
    ]
    assert offenders == []
