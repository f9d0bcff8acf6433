"""Makes a set of risk videos: searches every template for its classes, draws what was found, writes labels and card."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError, writing
from siren_ros.evaluation.risk.labels import RiskThresholds
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.side_by_side import side_by_side
from siren_ros.evaluation.risk.video_set import VIDEO_FRAMES, RiskVideo, VideoSet, write_set
from siren_ros.roads.maps.map_compiler import name_of_map
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.scenario.templates import Template, load_template
from siren_ros.studies.risk_set.balance import Balance, Counts, Finding, quotas, settled, shifted
from siren_ros.studies.risk_set.candidate import Candidate, Rejected
from siren_ros.studies.risk_set.journal import Journal
from siren_ros.studies.risk_set.render import Rendered
from siren_ros.studies.risk_set.retried import in_own_process
from siren_ros.studies.risk_set.search import PATIENCE, Outcome, Search, Trial, continue_search
from siren_ros.studies.risk_set.set_card import write_set_card
from siren_ros.studies.risk_set.variation import candidate_request
from siren_ros.studies.risk_set.video_file import (
    UNSEEN,
    VideoPlace,
    is_seen,
    made_before,
    make_video,
    remove_others,
    try_candidate,
)

_FIRST_PATIENCE: Final = 10
"""Candidates without a find after which a template first hands its share of a class on to the others."""


@dataclass(frozen=True)
class RiskSetRequest:
    """What set is to be made."""

    templates: tuple[str, ...]
    balance: Balance
    seed: int = 0
    map_file: str = ""
    budget: int = 90
    """Most candidates of each template."""
    retries: int = 2
    """Further attempts at a candidate or a video whose process died."""
    thresholds: RiskThresholds = field(default_factory=RiskThresholds)


class Progress:
    """Who is told how it goes."""

    def tried(self, template: str, search: Search) -> None:
        """A template's search after one more candidate."""

    def drawn(self, video_id: str, videos: int) -> None:
        """A video is there, one of so many."""


@dataclass(frozen=True)
class MadeSet:
    """A finished set and how it was found."""

    videos: VideoSet
    searches: Mapping[str, Search]


Chosen = Mapping[str, Candidate]
"""Candidates that become videos, by the video's id."""


def make_set(request: RiskSetRequest, out: Path, workers: int, progress: Progress | None = None) -> MadeSet:
    """Makes the set, or goes on with one that was interrupted.

    The set depends on the request alone: not on the number of workers and not on interruptions.

    Args:
        request: What is asked for.
        out: Folder of the set, new or of the same request.
        workers: Processes at once.
        progress: Who is told.

    Raises:
        InputError: A request that cannot be used, or the folder of another set.
        EpisodeError: A process died again and again.
    """
    teller = progress or Progress()
    wanted = quotas(request.balance, request.templates)
    _claim(request, out)
    work = {name: _TemplateSearch(request, load_template(name), name, out, teller) for name in request.templates}
    while True:
        searches = _all_searched(request.balance, wanted, work, workers)
        found = {name: search.found for name, search in searches.items()}
        counts = settled(wanted, found, request.balance.per_template)
        numbers = {
            video_id(name, number): (name, number, candidate)
            for name, search in searches.items()
            for number, candidate in search.chosen(counts[name]).items()
        }
        chosen = {key: candidate for key, (_, _, candidate) in numbers.items()}
        rendered = _drawn(request, out, chosen, workers, teller)
        unseen = [key for key, seen in rendered.items() if not is_seen(chosen[key], seen)]
        if not unseen:
            break
        for key in unseen:
            name, number, candidate = numbers[key]
            looking_for = searches[name].trials[number].looking_for
            work[name].journal.note(number, Trial(looking_for, Rejected(candidate.request, UNSEEN)))
    remove_others(out, chosen)
    videos = _as_set(request, out, chosen)
    write_set(videos)
    write_set_card(videos, searches, request.balance, name_of_map(Path(request.map_file) if request.map_file else None))
    return MadeSet(videos, searches)


def _all_searched(
    balance: Balance, wanted: Mapping[str, Counts], work: "Mapping[str, _TemplateSearch]", workers: int
) -> Mapping[str, Search]:
    """Searches with little patience, so that templates that find a class take over early; then with all of it."""
    searches: Mapping[str, Search] = {}
    for patience in (_FIRST_PATIENCE, PATIENCE):
        searches = _searched_in_rounds(balance, wanted, patience, work, workers)
        counts = settled(wanted, {name: one.found for name, one in searches.items()}, balance.per_template)
        if all(sum(one[risk] for one in counts.values()) >= balance.total[risk] for risk in RiskClass):
            break
    return searches


def _searched_in_rounds(
    balance: Balance,
    wanted: Mapping[str, Counts],
    patience: int,
    work: "Mapping[str, _TemplateSearch]",
    workers: int,
) -> Mapping[str, Search]:
    """Searches in rounds, until nothing is lacking or nobody can find it."""
    tried = [wanted]
    while True:
        tasks = {name: partial(one.run, wanted[name], patience) for name, one in work.items()}
        searches = side_by_side(tasks, workers)
        exhausted = {name for name, search in searches.items() if len(search.trials) >= search.budget}
        findings = {
            name: Finding(search.found, frozenset(RiskClass) if name in exhausted else search.given_up)
            for name, search in searches.items()
        }
        again = shifted(wanted, findings, balance)
        if again in tried:
            return searches
        tried.append(again)
        wanted = again


def video_id(template: str, number: int) -> str:
    """Of the candidate of a number: S4_012. It stays the same whatever else is found."""
    return f"{template}_{number:03d}"


class _TemplateSearch:
    """One template's search, and its journal."""

    def __init__(self, request: RiskSetRequest, template: Template, name: str, out: Path, progress: Progress) -> None:
        self.journal = Journal(out / "search" / f"{name}.jsonl")
        self._out = out
        self._request = request
        self._template = template
        self._name = name
        self._progress = progress

    def run(self, wanted: Counts, patience: int) -> Search:
        """Goes on until the search is finished."""
        search = Search(wanted, self._request.budget, patience)
        for trial in self.journal.read():
            search = search.with_trial(trial)
        return continue_search(search, self._candidate, self._run, self._told)

    def _candidate(self, looking_for: RiskClass, number: int) -> EpisodeRequest:
        request = self._request
        return candidate_request(self._template, self._name, looking_for, request.seed, number, request.map_file)

    def _run(self, search: Search, request: EpisodeRequest) -> Outcome:
        place = VideoPlace(self._out, video_id(self._name, len(search.trials)))
        retries, thresholds = self._request.retries, self._request.thresholds
        return in_own_process(retries, try_candidate, request, thresholds, place, search.short_of)

    def _told(self, search: Search) -> None:
        self.journal.note(len(search.trials) - 1, search.trials[-1])
        self._progress.tried(self._name, search)


def _claim(request: RiskSetRequest, out: Path) -> None:
    """Notes in the folder whose it is; InputError where it is another request's."""
    path = out / "search" / "request.json"
    text = json.dumps(asdict(replace(request, retries=0)), indent=1) + "\n"
    with writing(out, "folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file() and path.read_text(encoding="utf-8") != text:
            raise InputError("out", str(out), "a new folder, or one of the same request")
        path.write_text(text, encoding="utf-8")


def _drawn(
    request: RiskSetRequest, out: Path, chosen: Chosen, workers: int, progress: Progress
) -> Mapping[str, Rendered]:
    def draw(key: str, candidate: Candidate) -> Rendered:
        place = VideoPlace(out, key)
        rendered = made_before(place, candidate)
        if rendered is None:
            rendered = in_own_process(request.retries, make_video, place, candidate, request.thresholds)
        progress.drawn(key, len(chosen))
        return rendered

    tasks: dict[str, Callable[[], Rendered]] = {key: partial(draw, key, candidate) for key, candidate in chosen.items()}
    return side_by_side(tasks, workers)


def _as_set(request: RiskSetRequest, out: Path, chosen: Chosen) -> VideoSet:
    videos = {
        key: RiskVideo(
            video_id=key,
            template=load_template(candidate.request.template).template_id,
            file=VideoPlace(out, key).video.relative_to(out).as_posix(),
            frames=VIDEO_FRAMES,
            first_step=candidate.first_step,
            label=candidate.label,
            evidence=candidate.evidence,
            request=candidate.request.to_json(),
        )
        for key, candidate in sorted(chosen.items())
    }
    return VideoSet(out, videos, request.thresholds)
