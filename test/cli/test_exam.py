"""``siren exam``: its exit codes and files."""

import html
import json
import os
import shutil
from pathlib import Path

import pytest
from defusedxml import ElementTree
from recorded_episode import quick_template, tracked_recording
from signing_keys import made_keys

from siren_ros.base.params.folders import params_dir
from siren_ros.data.recording.bag_reader import read_episode


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return tracked_recording(tmp_path_factory)


@pytest.fixture(scope="module")
def driver(bag):
    record = read_episode(bag)
    return str(next(key for key, actor in record.actors.items() if not actor.is_emv))


def test_a_driver_of_a_recorded_episode_gets_a_certificate(siren, bag, driver, tmp_path):
    out = tmp_path / "exam"
    words = ["exam", str(bag), "--actor", driver, "--rulebook", "california", "--out", str(out), "--workers", "1"]
    printed = siren(words, code=1)
    assert "Touches nobody" in printed.out
    assert "no certificate: traffic: applied in 1 episodes, at least 30 are needed" in printed.err
    first = (out / "certificate.json").read_bytes()
    content = json.loads(first)
    assert not content["passed"]
    assert {"base"} == content["included_sha256"].keys()
    assert content["driver"] == f"actor {driver}"
    assert ElementTree.parse(out / "certificate.xml").getroot().tag == "testsuites"
    assert "Exam: California" in (out / "certificate.html").read_text(encoding="utf-8")
    siren(words, code=1)
    assert (out / "certificate.json").read_bytes() == first


def test_names_of_others_reach_neither_a_terminal_nor_a_file_as_they_are(siren, bag, driver, tmp_path):
    """A folder's name that is no UTF-8, with an escape code in it; and a rulebook's that a shell would run."""
    named, out = tmp_path / os.fsdecode(b"S2\x1b[31m_\xe9"), tmp_path / "exam"
    named.symlink_to(bag)
    book = tmp_path / "$(touch ran).yaml"
    shutil.copy(params_dir() / "rulebooks" / "california.yaml", book)
    words = ["exam", str(named), "--actor", driver, "--out", str(out), "--workers", "1", "--driver", "a\x1b"]
    printed = siren([*words, "--rulebook", str(book)], code=1)
    files = [(out / f"certificate.{kind}").read_text(encoding="utf-8") for kind in ("json", "xml", "html")]
    for text in (printed.out, *files):
        assert text.replace("\n", "").isprintable()
    assert f"--rulebook '{book}'" in html.unescape(files[2])
    (episode,) = json.loads(files[0])["episodes"]
    assert episode["bag"] == f"{tmp_path}/S2\\x1b[31m_\\udce9"


EPISODES = ["--levels", "L3", "--seeds", "0:2", "--duration-s", "2", "--workers", "1"]
MATRIX = ["--templates", quick_template("S2"), *EPISODES]


def test_an_exam_makes_its_own_episodes_and_goes_on_where_it_was_stopped(siren, tmp_path):
    out = tmp_path / "exam"
    words = ["exam", "--driver", "lawful-california", "--rulebook", "california", *MATRIX, "--out", str(out)]
    private, public = made_keys(tmp_path, "examiner")
    words += ["--sign", str(private)]
    printed = siren(words, code=1).out
    assert "at the wheel; number of episodes: 2" in printed
    certificate = (out / "certificate.json").read_bytes()
    content = json.loads(certificate)
    assert content["grade"] == "pass"
    assert content["driver"] == "lawful-california"
    assert [sorted(one["others"]) for one in content["episodes"]] == [["braked_hard", "emv_delay_s"]] * 2
    made = {path: path.stat().st_mtime_ns for path in out.rglob("*.mcap")}
    assert len(made) == 4  # two with the driver, two with the paper's
    verify = ["exam", "verify", str(out / "certificate.json"), "--workers", "1"]
    assert "2 episodes, 0 differences" in siren([*verify, str(out)]).out
    signed = ["--public-key", str(public)]
    assert "2 episodes, 0 differences" in siren([*verify, str(out), *signed]).out
    assert content["matrix"]["seeds"] == [0, 1]
    assert content["matrix"]["seat"]["driver"] == content["driver"]
    assert content["versions"]["siren_ros"]
    assert len({one["map_sha256"] for one in content["episodes"]}) == 1
    fewer = tmp_path / "fewer.json"
    fewer.write_text(json.dumps({**content, "episodes": content["episodes"][1:]}), encoding="utf-8")
    (tmp_path / "fewer.json.sig").write_bytes((out / "certificate.json.sig").read_bytes())
    dropped = siren(["exam", "verify", str(fewer), str(out), "--workers", "1", *signed], code=1).out
    assert "2 episodes in the matrix, 1 on the certificate" in dropped
    assert "fewer.json is not what the owner of examiner_public.pem signed" in dropped
    siren(words, code=1)
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*.mcap")} == made
    assert (out / "certificate.json").read_bytes() == certificate


def test_two_certificates_are_compared_and_the_papers_driver_is_graded_where_the_av_would_be(siren, tmp_path):
    for driver, alone in (("siren", []), ("idm", ["--alone"])):
        siren(["exam", "--driver", driver, *MATRIX, *alone, "--out", str(tmp_path / driver)], code=1)
    files = [str(tmp_path / driver / "certificate.json") for driver in ("siren", "idm")]
    verify = ["exam", "verify", files[1], str(tmp_path / "idm"), "--workers", "1"]
    assert "2 episodes, 0 differences" in siren(verify).out, "made alone, without the paper's driver"
    episode = json.loads(Path(files[0]).read_bytes())["episodes"][0]
    assert read_episode(Path(episode["bag"])).actors[episode["actor_id"]].name == "platoon0"
    assert episode["others"] == {}
    printed = siren(["exam", "compare", *files]).out
    assert "siren and idm, by the rulebook international" in printed
    assert "violated: Touches nobody" in printed


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["BAG"], "an AV under test, or --actor"),
        (["BAG", "--actor", "1"], "a civilian vehicle"),
        (["BAG", "--rulebook", "atlantis"], "one of base, california, germany, international"),
        ([], "bags, --driver or --av"),
        (["--driver", "nobody", "--out", "x"], "lawful-california"),
        (["--driver", "idm"], "a folder for the episodes"),
        (["--driver", "idm", "--av", "true", "--out", "x"], "no --driver with it"),
    ],
)
def test_an_exam_that_cannot_be_made_is_refused(siren, bag, words, said):
    assert said in siren(["exam", *(str(bag) if word == "BAG" else word for word in words)], code=2).err


def test_a_program_that_cannot_be_started_is_an_episode_without_a_result(siren, tmp_path):
    words = ["--av", "./no/such/program", "--templates", "S2", *EPISODES, "--alone"]
    run = siren(["exam", *words, "--out", str(tmp_path / "exam")], code=1)
    assert "S2_L3_seed0_town: no result" in run.err
    assert "./no/such/program" in run.err
    assert "--av ./no/such/program " in (tmp_path / "exam" / "certificate.html").read_text(), (
        "the command as it was given"
    )
    root = ElementTree.parse(tmp_path / "exam" / "certificate.xml").getroot()
    assert root[0].get("errors") == "1"
