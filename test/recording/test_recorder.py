from pathlib import Path

import pytest
from synthetic_episode import SyntheticEpisode

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.lockstep_reports import EpisodeClosing
from siren_ros.interfaces.messages import typestore
from siren_ros.interfaces.topics import EPISODE, EPISODE_END, OUTCOME
from siren_ros.recording.bag_reader import open_bag
from siren_ros.recording.record_builder import RecordBuilder
from siren_ros.recording.recorder import EpisodeRecorder
from siren_ros.scenario.episode import EpisodeEnd, EpisodeOutcome


def judge(_record: RecordBuilder, closing: EpisodeClosing) -> EpisodeOutcome:
    return EpisodeOutcome(closing.end, closing.reason, closing.steps, None)


def recorded(path: Path | None, expected_path: Path) -> dict[str, bytes]:
    """The messages in the bag of an episode whose recorder got a path at its start, at the description, or both."""
    episode = SyntheticEpisode()
    wanted = tuple(episode.recorded_topics())
    recorder = EpisodeRecorder(path, typestore(), frozenset(topic.name for topic in wanted if topic.latched), judge)
    messages = [
        (topic, step, bytes(typestore().serialize_cdr(message, topic.type_name)))
        for topic, step, message in episode.messages()
        if topic != OUTCOME
    ]
    recorder.take(messages[0][0], messages[0][2])
    recorder.expect(wanted, expected_path)
    for topic, _, cdr in messages[1:]:
        recorder.take(topic, cdr)
    recorder.close(EpisodeClosing(recorder.steps_recorded, EpisodeEnd.COMPLETE, ""))
    with open_bag(path or expected_path) as bag:
        messages = list(bag.messages())
        assert [message.topic for message in messages[-2:]] == [EPISODE_END.name, OUTCOME.name]
        return {f"{message.topic}@{message.time_ns}": bytes(message.cdr) for message in messages}


def test_a_place_that_the_description_gives_serves_as_well(tmp_path: Path) -> None:
    at_once = recorded(tmp_path / "given", tmp_path / "unused")
    later = recorded(None, tmp_path / "bags" / "described")
    assert at_once == later
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bags", "given"]


def test_without_a_description_there_is_no_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recorder = EpisodeRecorder(None, typestore(), frozenset(), judge)
    recorder.take(EPISODE, b"")
    with pytest.raises(EpisodeError, match="description"):
        recorder.close(EpisodeClosing(1, EpisodeEnd.COMPLETE, ""))
    recorder.discard()
    assert not list(tmp_path.iterdir())
