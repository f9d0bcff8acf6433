"""Fixtures that several folders of tests share: messages without ROS, and a synthetic episode; who runs the tests."""

import siren_ros  # noqa: F401 - the arithmetic of the library, before numpy is loaded

# isort: split
import gc
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import hypothesis
import pytest
from browser_pages import PageBrowser, running_browser
from recorded_episode import sensed_recording
from rosbags.typesys.store import Typestore
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces import messages
from siren_ros.data.recording.bag_writer import EpisodeBagWriter
from siren_ros.data.recording.episode_record import EpisodeRecord, RecordBuilder

# A shell ignores Ctrl-C for background jobs, nohup ignores SIGHUP, and what the tests start would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

hypothesis.settings.register_profile("siren", deadline=None)  # no test asserts wall time
hypothesis.settings.load_profile("siren")

WORKERS = 4
"""Processes that share the tests, two more than processors: many tests wait for programs that keep their own time."""


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Folders are shared between workers where there are processors for it; single files run in this process."""
    folders = all(Path(argument).is_dir() for argument in config.args)
    return min(WORKERS, len(os.sched_getaffinity(0)) + 2) if folders else 0


_FIRST = ThreadPoolExecutor(1)
"""Records what a run of all tests begins with."""


def pytest_xdist_setupnodes(config: pytest.Config) -> None:
    """A run of all tests begins with an episode that several folders read, while the workers collect.

    Where nothing is compiled yet, this one process compiles the loops that most tests run; otherwise each of a dozen
    processes would, which takes each of them a minute.
    """
    if config.args_source is pytest.Config.ArgsSource.TESTPATHS:
        folders: pytest.TempPathFactory = config._tmp_path_factory  # type: ignore[attr-defined] # xdist's way to it
        _FIRST.submit(sensed_recording, folders)


def pytest_xdist_node_collection_finished() -> None:
    """No test begins before that; if it fails, the tests that read it say why."""
    _FIRST.shutdown()


LONG_FOLDERS = {"nodes", "guides", "studies", "training", "cli"}
"""Files in them take up to minutes, each in one worker: they begin first, so that no worker is left over with one."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Workers take files in this order: those of the long folders, then those with many tests."""
    if hasattr(config, "workerinput"):
        sizes = Counter(item.path for item in items)
        gc.freeze()  # ten thousand items stay for the whole run, and need not be looked through again and again
        items.sort(key=lambda item: (LONG_FOLDERS.isdisjoint(item.path.parts), -sizes[item.path]))


@pytest.fixture(scope="session")
def typestore() -> Typestore:
    """All message types of the node graph."""
    return messages.typestore()


@pytest.fixture(scope="session")
def round_trip(typestore: Typestore) -> Callable[..., object]:
    """Serialises a message and reads it back; of finished CDR the type's name must be given."""

    def through_cdr(message: object, name: str = "") -> object:
        if isinstance(message, bytes):
            read = typestore.deserialize_cdr(message, name)
            again = bytes(typestore.serialize_cdr(read, name))
            assert message == again + bytes(-len(again) % 4), "the bytes are the store's own, filled up to whole words"
            return read
        name = message.__msgtype__  # type: ignore[attr-defined] # rosbags' generated classes
        return typestore.deserialize_cdr(typestore.serialize_cdr(message, name), name)

    return through_cdr


@pytest.fixture(scope="session")
def record_of() -> Callable[..., EpisodeRecord]:
    """The record of a synthetic episode, straight from its messages; arguments are those of ``Scene``."""

    def build(**scene: object) -> EpisodeRecord:
        builder = RecordBuilder()
        for topic, _, message in SyntheticEpisode(Scene(**scene)).messages():  # type: ignore[arg-type] # forwarded
            builder.add(topic.name, message)
        return builder.build()

    return build


@pytest.fixture(scope="session")
def write_bag(typestore: Typestore) -> Callable[..., Path]:
    """Writes the bag of a synthetic episode; further arguments are those of ``Scene``."""

    def write(path: Path, **scene: object) -> Path:
        episode = SyntheticEpisode(Scene(**scene))  # type: ignore[arg-type] # forwarded
        latched = [topic.name for topic in episode.recorded_topics() if topic.latched]
        writer = EpisodeBagWriter(path, typestore, latched)
        for topic, step, message in episode.messages():
            cdr = bytes(typestore.serialize_cdr(message, topic.type_name))
            writer.write(topic.name, topic.type_name, cdr, time_ns_of_step(step))
        return writer.finish().path

    return write


@pytest.fixture(scope="module")
def browser() -> Iterator[PageBrowser]:
    """Chromium without display and network; for one module, because its event loop would hinder asyncio elsewhere."""
    with running_browser() as running:
        yield running
