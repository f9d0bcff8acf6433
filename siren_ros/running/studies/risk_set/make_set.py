"""Makes a set of risk videos: searches each template for the classes, records videos, writes labels and card."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from siren_ros import __version__
from siren_ros.base.processes.process_pool import ProcessPool, Result, side_by_side
from siren_ros.data.datasets.publication import datasheet, write_croissant
from siren_ros.data.episode_source import LICENCE, licence_of_map
from siren_ros.errors import InputError, write_text, writing
from siren_ros.running.generation.episode_setup import present_versions
from siren_ros.running.studies.risk_set.candidate import (
    UNSEEN,
    Candidate,
    Outcome,
    Rejected,
    Rendered,
    VideoPlace,
    candidate_request,
    is_seen,
    made_before,
    make_video,
    remove_others,
    try_candidate,
)
from siren_ros.running.studies.risk_set.search import (
    PATIENCE,
    Balance,
    Counts,
    Journal,
    Search,
    Trial,
    balanced,
    continue_search,
    enlarged,
    quotas,
    settled,
    shifted,
)
from siren_ros.running.studies.run_study import attempt_processes
from siren_ros.scoring.evaluation.risk.labels import DEFINITIONS, NEW_SETS, TITLES, RiskClass, RiskThresholds
from siren_ros.scoring.evaluation.risk.video_set import (
    EVIDENCE_FILE,
    SET_FILE,
    VIDEO_FRAMES,
    RiskVideo,
    VideoSet,
    write_set,
)
from siren_ros.simulation.roads.maps.map_compiler import name_of_map
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.templates import load_template


def _card(videos: VideoSet, searches: Mapping[str, Search], balance: Balance, map_file: str) -> dict[str, Any]:
    """The card of the set as JSON types; counts are Normal, Near-Miss, Collision."""
    counts = {name: [0, 0, 0] for name in searches}
    map_name = name_of_map(Path(map_file) if map_file else None)
    for video in videos.videos.values():
        counts[video.template][video.label.risk] += 1
    return {
        "name": "SIREN risk videos",
        "what": "Videos of the front camera of an emergency vehicle: Normal, Near-Miss or Collision",
        "videos": len(videos.videos),
        "frames": VIDEO_FRAMES,
        "rate_hz": 10,
        "map": map_name,
        "map_licence": licence_of_map(map_name, map_file),
        "classes": list(TITLES),
        "asked_for": list(balance.total),
        "counts": [sum(row[risk] for row in counts.values()) for risk in RiskClass],
        "by_template": {
            name: {"counts": counts[name], "candidates": len(search.trials), "found": list(search.found)}
            for name, search in searches.items()
        },
        "near_misses_by_definition": {
            name: sum(video.label.risk is RiskClass.NEAR_MISS for video in videos.relabelled(limits).videos.values())
            for name, limits in DEFINITIONS.items()
        },
        "thresholds": asdict(videos.thresholds),
        "versions": dict(present_versions()),
        "licence": LICENCE,
    }


def _readme(content: Mapping[str, Any]) -> str:
    rows = []
    for name, row in content["by_template"].items():
        found = " / ".join(map(str, row["found"]))
        rows.append(f"| {name} | {' | '.join(map(str, row['counts']))} | {row['candidates']} | {found} |")
    limits = [f"| `{name}` | {value:g} |" for name, value in content["thresholds"].items()]
    counts, asked = (" / ".join(map(str, content[key])) for key in ("counts", "asked_for"))
    about = (
        f"{content['videos']} videos of the EMV's front camera, {content['frames']} frames each at 10 Hz, on the map "
        f"{content['map']}. Classes {', '.join(content['classes'])}: {counts}; asked for: {asked}. Near-misses "
        f"by definition: {', '.join(f'{name} {n}' for name, n in content['near_misses_by_definition'].items())}."
    )
    made = (
        "Nothing is scripted. Candidates were simulated without sensors, with drawn parameters (speed of the EMV, "
        "density, compliance, reaction, attention of the drivers), until each class had its videos; the label of each "
        "was then derived from its record. The window of 19 s lies so that the decisive moment is at a drawn place "
        "between 40 and 80 % of the video."
    )
    files = (
        f"`{SET_FILE}` has each video's label, what decided it and when, and the request that makes its episode again. "
        f"`{EVIDENCE_FILE}` has every moment of a collision course with a civilian in view, so that other thresholds "
        "can be tried: `siren label`. `masks/` has the actor of each pixel of the nine key frames."
    )
    table = ["| template | Normal | Near-Miss | Collision | candidates | found |", "|---|---|---|---|---|---|", *rows]
    values = ["| threshold | value |", "|---|---|", *limits]
    parts = [[f"# {content['name']}"], [about], [made], table, [files], values, [f"Licence: {content['licence']}."]]
    parts.append([datasheet(content)])
    return "\n\n".join("\n".join(part) for part in parts) + "\n"


_FIRST_PATIENCE: Final = 10
"""Number of candidates without success after which a template first passes its share of a class to others."""


@dataclass(frozen=True)
class RiskSetRequest:
    """Description of a set."""

    templates: tuple[str, ...]
    balance: Balance
    seed: int = 0
    map_file: str = ""
    budget: int = 90
    """Largest number of candidates per template."""
    retries: int = 2
    """Number of further attempts if the process of a candidate or video died."""
    thresholds: RiskThresholds = NEW_SETS

    @property
    def patience(self) -> int:
        """Candidates without success before a template gives up a class: 25, or a quarter of a large budget."""
        return max(PATIENCE, self.budget // 4)


class SetObserver:
    """Observes the making of a set; commands show it as bars."""

    def tried(self, template: str, search: Search) -> None:
        """Called after each candidate with its template's search."""

    def drawn(self, video_id: str, videos: int) -> None:
        """Called after each finished video, with their total number."""


MadeSet = tuple[VideoSet, Mapping[str, Search]]
"""A finished set, with the search of each template."""


def make_set(request: RiskSetRequest, out: Path, workers: int, observer: SetObserver | None = None) -> MadeSet:
    """Make the set in a new folder, or continue an interrupted set of the same request.

    The set depends on the request alone: not on the number of workers and not on interruptions.

    Raises:
        InputError: A request that cannot be used, or the folder of another set.
        SirenError: An episode failed, or a process died again and again.
    """
    shares = quotas(request.balance, request.templates)
    _claim(request, out)
    with attempt_processes(workers) as pool:
        return _SetMaker(request, out, shares, workers, pool, observer or SetObserver()).make()


def video_id(template: str, number: int) -> str:
    """Id of the video of a candidate: S4_012. It does not depend on other finds."""
    return f"{template}_{number:03d}"


@dataclass(frozen=True)
class _SetMaker:
    """Work on one set: many searches and videos in parallel processes."""

    request: RiskSetRequest
    out: Path
    quotas: Mapping[str, Counts]
    workers: int
    pool: ProcessPool
    observer: SetObserver

    def make(self) -> MadeSet:
        while True:
            searches, counts = self._all_searched()
            numbers = {
                video_id(name, number): (name, number, candidate)
                for name, search in searches.items()
                for number, candidate in search.chosen(counts[name]).items()
            }
            chosen = {key: candidate for key, (_, _, candidate) in numbers.items()}
            drawn = self._side_by_side(
                {key: partial(self._draw, key, candidate, len(chosen)) for key, candidate in chosen.items()}
            )
            unseen = [key for key, rendered in drawn.items() if not is_seen(chosen[key], rendered)]
            if not unseen:
                break
            for key in unseen:
                name, number, candidate = numbers[key]
                looking_for = searches[name].trials[number].looking_for
                self._journal(name).note(number, Trial(looking_for, Rejected(candidate.request, UNSEEN)))
        remove_others(self.out, chosen)
        entries = {key: self._as_video(key, candidate) for key, candidate in sorted(chosen.items())}
        videos = VideoSet(self.out, entries, self.request.thresholds)
        write_set(videos)
        card = _card(videos, searches, self.request.balance, self.request.map_file)
        write_text(self.out / "dataset.json", json.dumps(card, indent=1, sort_keys=True) + "\n")
        write_text(self.out / "README.md", _readme(card))
        write_croissant(self.out, card, __version__)
        return videos, searches

    def _settled(self, searches: Mapping[str, Search], shares: Mapping[str, Counts]) -> Mapping[str, Counts]:
        found = {name: search.found for name, search in searches.items()}
        if self.request.balance.within:
            return balanced(shares, found)
        return settled(self.quotas, found, self.request.balance.per_template)

    def _side_by_side(self, tasks: Mapping[str, Callable[[], Result]]) -> dict[str, Result]:
        return side_by_side(tasks, self.workers, self.pool.stop)

    def _all_searched(self) -> tuple[Mapping[str, Search], Mapping[str, Counts]]:
        """Search with little patience first, so that successful templates take over early, then with full patience.

        It returns the searches, and how many videos of each class each template contributes.
        """
        balance, searches, counts = self.request.balance, dict[str, Search](), self.quotas
        for patience in (_FIRST_PATIENCE, self.request.patience):
            searches, shares = self._searched_in_rounds(patience)
            counts = self._settled(searches, shares)
            if all(sum(share[risk] for share in counts.values()) >= balance.total[risk] for risk in RiskClass):
                break
        return searches, counts

    def _searched_in_rounds(self, patience: int) -> tuple[dict[str, Search], Mapping[str, Counts]]:
        """Search in rounds until nothing is missing or no template can find it; with the final quotas."""
        balance, shares, tried = self.request.balance, self.quotas, [self.quotas]
        last_pass = patience == self.request.patience
        while True:
            searches = self._side_by_side(
                {name: partial(self._search, name, counts, patience) for name, counts in shares.items()}
            )
            findings = {
                name: (search.found, frozenset(RiskClass) if len(search.trials) >= search.budget else search.given_up)
                for name, search in searches.items()
            }
            if balance.within and not last_pass:  # templates stay equal while each may find its share itself
                return searches, shares
            changed = (enlarged if balance.within else shifted)(shares, findings, balance)
            if changed in tried:
                return searches, changed
            shares = changed
            tried.append(shares)

    def _journal(self, template: str) -> Journal:
        return Journal(self.out / "search" / f"{template}.jsonl")

    def _search(self, name: str, counts: Counts, patience: int) -> Search:
        """Continue a template's search until it is finished."""
        asked, template, journal = self.request, load_template(name), self._journal(name)

        def run(search: Search, request: EpisodeRequest) -> Outcome:
            place = VideoPlace(self.out, video_id(name, len(search.trials)))
            return self.pool.call_with_retries(
                asked.retries, try_candidate, request, asked.thresholds, place, search.short_of
            )

        def note(search: Search) -> None:
            journal.note(len(search.trials) - 1, search.trials[-1])
            self.observer.tried(name, search)

        return continue_search(
            Search(counts, asked.budget, patience, tuple(journal.read())),
            lambda risk, number: candidate_request(template, name, risk, asked.seed, number, asked.map_file),
            run,
            note,
        )

    def _draw(self, key: str, candidate: Candidate, videos: int) -> Rendered:
        place = VideoPlace(self.out, key)
        rendered = made_before(place, candidate) or self.pool.call_with_retries(
            self.request.retries, make_video, place, candidate, self.request.thresholds
        )
        self.observer.drawn(key, videos)
        return rendered

    def _as_video(self, key: str, candidate: Candidate) -> RiskVideo:
        return RiskVideo(
            video_id=key,
            template=load_template(candidate.request.template).template_id,
            file=VideoPlace(self.out, key).video.relative_to(self.out).as_posix(),
            frames=VIDEO_FRAMES,
            first_step=candidate.first_step,
            label=candidate.label,
            evidence=candidate.evidence,
            request=candidate.request.to_json(),
        )


def _claim(request: RiskSetRequest, out: Path) -> None:
    """Mark the folder with the request; InputError if it belongs to another one."""
    path = out / "search" / "request.json"
    text = json.dumps(asdict(replace(request, retries=0)), indent=1) + "\n"
    with writing(out, "folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_file() and path.read_text(encoding="utf-8") != text:
            raise InputError("out", str(out), "a new folder, or one of the same request")
        path.write_text(text, encoding="utf-8")
