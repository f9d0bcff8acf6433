"""``siren exam``: its exit codes and files."""

import json

import pytest
from defusedxml import ElementTree
from recorded_episode import tracked_recording

from siren_ros.recording.bag_reader import read_episode


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return tracked_recording(tmp_path_factory)


@pytest.fixture(scope="module")
def driver(bag):
    record = read_episode(bag)
    return str(next(key for key, actor in record.actors.items() if not actor.is_emv))


def test_a_driver_of_a_recorded_episode_gets_a_certificate(siren, bag, driver, tmp_path):
    out = tmp_path / "exam"
    words = ["exam", str(bag), "--actor", driver, "--rulebook", "california", "--out", str(out), "--jobs", "1"]
    printed = siren(words).out
    assert "Touches nobody" in printed
    first = (out / "certificate.json").read_bytes()
    content = json.loads(first)
    assert content["passed"]
    assert content["driver"] == f"actor {driver}"
    assert ElementTree.parse(out / "certificate.xml").getroot().tag == "testsuites"
    assert "Exam: California" in (out / "certificate.html").read_text(encoding="utf-8")
    siren(words)
    assert (out / "certificate.json").read_bytes() == first


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "an AV under test, or --actor"),
        (["--actor", "1"], "a civilian vehicle"),
        (["--rulebook", "atlantis"], "one of california, germany, international"),
    ],
)
def test_what_cannot_be_graded_is_refused(siren, bag, words, said):
    assert said in siren(["exam", str(bag), "--jobs", "1", *words], code=2).err
