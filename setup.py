"""Which files the package installs, and where: under colcon as the ROS 2 package ``siren_ros``, under pip as a wheel.

What the package is and needs stands in ``pyproject.toml``.
"""

import re
import sys
from pathlib import Path

from setuptools import find_packages, setup

NAME = "siren_ros"

NODES = sorted(path.stem for path in Path(__file__).resolve().with_name("nodes").glob("[a-z]*.py"))
"""Each file of the folder is a program."""

INTERFACES = {"siren_msgs": "msg_defs/msg", "vision_msgs": "tools/environment/interfaces/vision_msgs/msg"}
"""Folders of the message definitions that the library reads where no ROS has installed them."""

COMMANDS_OF_PIP = {"bdist_wheel", "dist_info", "editable_wheel"}


def executables(arguments: list[str]) -> list[str]:
    """The entry points: colcon installs them in lib/siren_ros under the nodes' names, where `ros2 run` looks for them.

    pip installs them in bin/, next to everybody else's programs: there their names begin with the project's.
    """
    in_bin = COMMANDS_OF_PIP.intersection(arguments)
    names = {node: f"siren-{node.replace('_', '-')}" if in_bin else node for node in NODES}
    return ["siren = siren_ros.cli.main:main", *(f"{names[node]} = siren_nodes.{node}:main" for node in NODES)]


_ELSEWHERE = """
`./env` and the documents are in the repository. This package brings the library `siren_ros` and the command `siren`
(`siren --help`), for Linux; its nodes also need ROS 2 Jazzy.
"""


def long_description() -> str:
    """README.md for a package index: without what leads to files of the repository, which are not there."""
    text = re.sub(r"<!--.*?-->", "", Path(__file__).resolve().with_name("README.md").read_text(encoding="utf-8"))
    text = re.sub(r"\n## Where to go\n.*?(?=\nLicence:)", _ELSEWHERE, text, flags=re.DOTALL)
    text = re.sub(r"!\[[^\]]*\]\((?!https://)[^)]*\)\n*", "", text)
    return re.sub(r"\[([^\]]*)\]\((?!https://)[^)]*\)", r"\1", text)


def data_files_below(folder: str) -> list[tuple[str, list[str]]]:
    """One entry per subfolder: (where it is installed, the files in it)."""
    folders: dict[str, list[str]] = {}
    for path in sorted(Path(folder).rglob("*")):
        if path.is_file():
            folders.setdefault(path.parent.as_posix(), []).append(path.as_posix())
    return [(f"share/{NAME}/{parent}", files) for parent, files in folders.items()]


setup(
    # The nodes are files of the top-level folder nodes/; they are imported as siren_nodes. A mapping to siren_ros.nodes
    # would fail under `colcon build --symlink-install`.
    packages=[*find_packages(include=[NAME, f"{NAME}.*"]), "siren_nodes"],
    package_dir={"siren_nodes": "nodes"},
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(str(path) for path in Path("launch").glob("*.launch.py"))),
        *data_files_below("params"),
        *(
            (f"share/{NAME}/interfaces/{package}/msg", sorted(str(path) for path in Path(folder).glob("*.msg")))
            for package, folder in INTERFACES.items()
        ),
    ],
    long_description=long_description(),
    long_description_content_type="text/markdown",
    zip_safe=False,
    python_requires=">=3.11,<3.13",
    entry_points={"console_scripts": executables(sys.argv)},
)
