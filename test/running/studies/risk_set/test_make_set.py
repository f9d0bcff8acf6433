"""A set is searched, drawn and written, and goes on after an interruption; episodes and pictures are stood in for."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_video_sets import evidence
from processes.stand_in import processes_of

from siren_ros.errors import EpisodeError, InputError
from siren_ros.running.studies.risk_set import make_set as making
from siren_ros.running.studies.risk_set.candidate import Candidate, Rendered, try_candidate
from siren_ros.running.studies.risk_set.make_set import RiskSetRequest, SetObserver, make_set
from siren_ros.running.studies.risk_set.search import Balance
from siren_ros.scoring.evaluation.risk.labels import Evidence, Moments, Reason, RiskClass, RiskLabel, RiskThresholds
from siren_ros.scoring.evaluation.risk.video_set import read_set

NONE = np.zeros(0)
EVIDENCE = Evidence(Moments(NONE.astype(np.int64), NONE.astype(np.uint32), NONE, NONE, NONE, NONE, NONE), (), ())
REQUEST = RiskSetRequest(("S2", "S6"), Balance((3, 2, 1), 3), seed=4, thresholds=RiskThresholds())
RISKS = (RiskClass.NEAR_MISS, RiskClass.NORMAL, RiskClass.COLLISION)
"""What the candidates of each template are, in turn."""


@dataclass
class Seen(SetObserver):
    """What was tried and drawn, in which order."""

    tries: list[tuple[str, int]] = field(default_factory=list)
    videos: list[tuple[str, int]] = field(default_factory=list)

    def tried(self, template: str, search: Any) -> None:
        self.tries.append((template, len(search.trials)))

    def drawn(self, video_id: str, videos: int) -> None:
        self.videos.append((video_id, videos))


@dataclass
class Processes:
    """Answers as the processes of a set would, and keeps what they were asked."""

    ends_at: str = ""
    harmless: str = ""
    """A template without collisions."""
    tried: list[str] = field(default_factory=list)
    short_of: dict[str, frozenset[RiskClass]] = field(default_factory=dict)

    def __call__(self, retries: int, function: Callable[..., Any], *arguments: Any) -> Any:
        assert retries == 2
        if function is not try_candidate:
            place, *_ = arguments
            return Rendered(190, 0 if place.video_id == "S2_000" else 60)
        request, _, place, short_of = arguments
        if place.video_id == self.ends_at:
            raise EpisodeError("interrupted")
        self.tried.append(place.video_id)
        self.short_of[place.video_id] = short_of
        template, number = place.video_id.split("_")
        risk = RISKS[int(number) % (2 if template == self.harmless else 3)]
        label = RiskLabel(risk) if risk is RiskClass.NORMAL else RiskLabel(risk, Reason.TIME_TO_COLLISION, 2, 27, 1.2)
        found = evidence("Near-Miss") if risk is RiskClass.NEAR_MISS else EVIDENCE
        if template == "S6":
            found = replace(found, moments=replace(found.moments, braked_mps2=found.moments.braked_mps2 + 4.0))
        return Candidate(request, 20, label, found)


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> Processes:
    given = Processes()
    monkeypatch.setattr(making, "attempt_processes", processes_of(given))
    return given


def risks_of(folder: Path) -> dict[str, str]:
    return {key: video.label.risk.name for key, video in read_set(folder).videos.items()}


CHOSEN = {"S2_001": "NORMAL", "S2_002": "COLLISION", "S2_003": "NEAR_MISS"}
CHOSEN |= {"S6_000": "NEAR_MISS", "S6_001": "NORMAL", "S6_004": "NORMAL"}
"""The first near-miss of S2 is not seen, and S6 is to have no collision."""


def test_a_set_has_the_first_of_each_class_and_another_one_for_what_is_not_seen(processes, tmp_path) -> None:
    seen = Seen()
    _, searches = make_set(REQUEST, tmp_path, 1, seen)
    assert risks_of(tmp_path) == CHOSEN
    assert [len(searches[name].trials) for name in ("S2", "S6")] == [4, 5]
    assert seen.tries == [("S2", 1), ("S2", 2), ("S2", 3), *[("S6", count) for count in range(1, 6)], ("S2", 4)]
    assert seen.videos == [(key, 6) for key in sorted({*CHOSEN, "S2_000"} - {"S2_003"})] + [(key, 6) for key in CHOSEN]
    assert processes.short_of["S2_000"] == set(RiskClass)
    assert processes.short_of["S2_002"] == {RiskClass.COLLISION}
    assert processes.short_of["S6_000"] == {RiskClass.NORMAL, RiskClass.NEAR_MISS}
    assert processes.short_of["S2_003"] == {RiskClass.NEAR_MISS}
    noted = [json.loads(line) for line in (tmp_path / "search/S2.jsonl").read_text().splitlines()]
    assert [entry["looking_for"] for entry in noted[:3]] == ["Collision"] * 3
    assert noted[3]["rejected"] == "the camera does not see the vehicle that decides the label"
    assert [entry["number"] for entry in noted] == [0, 1, 2, 0, 3]


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(("map_file", "name"), [("", "town"), ("maps/Town10HD_Opt.xodr", "Town10HD_Opt")])
def test_the_card_of_a_set_names_its_map(tmp_path: Path, map_file: str, name: str) -> None:
    make_set(replace(REQUEST, map_file=map_file), tmp_path, 1)
    told = json.loads((tmp_path / "dataset.json").read_text(encoding="utf-8"))
    assert told["map"] == name
    assert told["near_misses_by_definition"] == {"paper": 2, "near_crash": 1}, "in one of the two somebody braked"
    card = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert f"190 frames each at 10 Hz, on the map {name}. Classes" in card


@pytest.mark.parametrize(("harmless", "shares"), [("", {"S2": 6, "S6": 6}), ("S6", {"S2": 12})])
def test_one_template_finds_all_that_another_one_cannot(processes, tmp_path, harmless, shares) -> None:
    """Each template has the classes in the same proportions, and the set has all that was asked for."""
    processes.harmless = harmless
    for _ in range(2):  # the second time everything is there already
        make_set(RiskSetRequest(("S2", "S6"), Balance((6, 4, 2), 6, within=True)), tmp_path, 1)
        risks = risks_of(tmp_path)
        assert sorted(risks.values()) == ["COLLISION"] * 2 + ["NEAR_MISS"] * 4 + ["NORMAL"] * 6
        assert {name: sum(key.startswith(name) for key in risks) for name in shares} == shares
    assert len(processes.tried) == len(set(processes.tried))


@pytest.mark.parametrize("ends_at", ["S2_002", "S6_003", "S2_003"])
def test_an_interrupted_set_goes_on_where_it_stopped(processes: Processes, tmp_path: Path, ends_at: str) -> None:
    processes.ends_at = ends_at
    with pytest.raises(EpisodeError, match="interrupted"):
        make_set(REQUEST, tmp_path, 1)
    processes.ends_at = ""
    make_set(replace(REQUEST, retries=2), tmp_path, 1)
    assert risks_of(tmp_path) == CHOSEN
    assert len(processes.tried) == len(set(processes.tried)) == 9, "nothing was tried twice"


def test_the_folder_of_another_set_is_refused(processes: Processes, tmp_path: Path) -> None:
    processes.ends_at = "S2_000"
    for _ in range(2):
        with pytest.raises(EpisodeError, match="interrupted"):
            make_set(REQUEST, tmp_path, 1)
    with pytest.raises(InputError, match="a new folder, or one of the same request"):
        make_set(replace(REQUEST, seed=5), tmp_path, 1)


@pytest.mark.parametrize(("budget", "patience"), [(20, 25), (90, 25), (104, 26), (600, 150)])
def test_a_large_budget_is_not_given_up_after_a_few_candidates(budget: int, patience: int) -> None:
    assert replace(REQUEST, budget=budget).patience == patience
