"""Bags of real episodes that the tests of the formats share."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest
from datasets.made_bag import BagSpec, Export, write_made_bag
from recorded_episode import sensed_recording, tracked_recording
from rosbags.typesys.store import Typestore
from synthetic_episode import NET_XML

from siren_ros.cli.main import main
from siren_ros.data.datasets import export_job
from siren_ros.data.episode_source import open_source
from siren_ros.data.tracks import Track, tracks_of
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import Split


@pytest.fixture(scope="session")
def straight_road_of_two_lanes() -> RoadNetwork:
    """Two lanes eastwards and two westwards."""
    return parse_road_network(NET_XML.encode())


@pytest.fixture(scope="session")
def sensed_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds with LiDAR and four cameras: 20 sweeps, 4 keyframes."""
    return sensed_recording(tmp_path_factory)


@pytest.fixture(scope="session")
def tracked_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fourteen seconds without sensors, at a junction with signals."""
    return tracked_recording(tmp_path_factory)


@pytest.fixture(scope="session")
def tracked_tracks(tracked_bag: Path) -> list[Track]:
    """The tracks of that episode with more than one frame."""
    with open_source(tracked_bag) as source:
        return [track for track in tracks_of(source.record()) if len(track) > 1]


@pytest.fixture(scope="session")
def made_bags(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> list[Path]:
    """Three episodes of formulas with sensors, of three seeds: 19, 10 and 10 sweeps."""
    folder = tmp_path_factory.mktemp("made")
    return [
        write_made_bag(folder / f"seed{seed}", typestore, BagSpec(steps=42 if seed == 0 else 24, seed=seed))
        for seed in (0, 1, 2)
    ]


@contextmanager
def one_seed_in_each_split() -> Iterator[None]:
    """Datasets of three seeds have three splits; how the project splits them is no matter of the formats."""
    of_seed = {0: Split.TRAIN, 1: Split.VAL, 2: Split.TEST_SEED}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export_job, "split_of", lambda identity: of_seed.get(identity.seed, Split.TRAIN))
        yield


@pytest.fixture(autouse=True)
def split_by_seed() -> Iterator[None]:
    """Ends with each test: other folders' tests in this process have the project's own splits."""
    with one_seed_in_each_split():
        yield


@pytest.fixture(scope="session")
def first_made_bag(made_bags: list[Path]) -> Path:
    """The longest of them."""
    return made_bags[0]


@pytest.fixture(scope="session")
def made_drive(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> Path:
    """An episode of formulas of 13.1 s without sensors."""
    return write_made_bag(tmp_path_factory.mktemp("made") / "drive", typestore, BagSpec(steps=262, sensed=False))


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Export:
    """Exports bags as a user does; the same arguments give the dataset that is there already."""

    @cache
    def export(name: str, *words: str) -> Path:
        out = tmp_path_factory.mktemp(name) / "out"
        with one_seed_in_each_split():  # fixtures of modules begin before those of a test
            assert main(["export", name, *words, "--out", str(out)]) == 0
        return out

    def exported(name: str, bags: Path | list[Path], *options: str) -> Path:
        if isinstance(bags, Path):
            return export(name, str(bags), *options)
        return export(name, *map(str, bags), *options, "--workers", "1")

    return exported


@pytest.fixture(scope="module")
def dataset(request: pytest.FixtureRequest, exported: Export) -> Path:
    """The dataset that a module's ``DATASET`` names: format, fixture of the recorded bag, options."""
    name, bag, *options = request.module.DATASET
    return exported(name, request.getfixturevalue(bag), *options)


@pytest.fixture(scope="module")
def made_dataset(request: pytest.FixtureRequest, exported: Export) -> Path:
    """The same of ``MADE_DATASET``, with a bag of formulas."""
    name, bag, *options = request.module.MADE_DATASET
    return exported(name, request.getfixturevalue(bag), *options)
