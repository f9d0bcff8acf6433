"""The matrix of a study: templates × levels × seeds × maps × draws, each cell an episode with a name of its own."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError
from siren_ros.generation.episode_setup import level_of, present_versions
from siren_ros.generation.request_files import files_of_request
from siren_ros.params.parameter_field import check_fields
from siren_ros.roads.maps.map_compiler import name_of_map, source_sha256_of
from siren_ros.scenario.request import EpisodeRequest, text_of_values, values_of
from siren_ros.scenario.templates import load_template
from siren_ros.studies.draws import DrawPlan, draws_of

OWN_LEVEL: Final = "own"
"""Stands for the level in the template's file."""
TOWN: Final = "town"
"""Stands for the built-in map."""


@dataclass(frozen=True)
class Study:
    """What is asked for."""

    templates: tuple[str, ...]
    levels: tuple[str, ...] = (OWN_LEVEL,)
    seeds: tuple[int, ...] = (0,)
    maps: tuple[str, ...] = (TOWN,)
    preset: str = "paper"
    sensors: str = "none"
    look: str = "clear"
    duration_s: float = 0.0
    """Of every episode; 0: the template's own."""
    values: str = ""
    """Of the templates' parameters in place of the seeds' own, as ``EpisodeRequest.values``."""
    draws: DrawPlan | None = None
    """None: each seed has the values that it draws by itself."""
    risk_videos: int = 0
    """Front-camera videos of each template with risk labels besides the episodes, the classes in the paper's shares."""

    def to_json(self) -> dict[str, Any]:
        """The study as JSON types."""
        return dict(json.loads(json.dumps(asdict(self))))


@dataclass(frozen=True)
class PlannedEpisode:
    """One cell of the matrix."""

    name: str
    group: str
    """Folder of the episodes that share template, level and map."""
    request: EpisodeRequest
    draw: int
    """Number of the draw; −1 where the study draws nothing."""
    inputs_sha256: str
    """Of everything that the episode is made from."""


def plan_study(study: Study) -> tuple[PlannedEpisode, ...]:
    """All episodes of a study. Template changes last, so that an early look at the results has some of each.

    Raises:
        InputError: A template, level, map, preset, suite or draw that cannot be used; two maps of one name.
    """
    for field in ("templates", "levels", "seeds", "maps"):
        repeated = [value for value, count in Counter(getattr(study, field)).items() if count > 1]
        if repeated or not getattr(study, field):
            raise InputError(field, repeated[0] if repeated else "", "one or more, each of them once")
    inputs = _Inputs()
    planned = tuple(_named(request, template, draw, inputs) for request, template, draw in _cells(study))
    counts = Counter(episode.name for episode in planned)
    for episode in planned:
        if counts[episode.name] > 1:
            raise InputError("maps", episode.request.map, f"files of different names; {episode.name} comes twice")
    return planned


def _cells(study: Study) -> Iterator[tuple[EpisodeRequest, str, int]]:
    """The requests, each with the id of its template and the number of its draw."""
    base = EpisodeRequest(
        preset=study.preset,
        sensors=study.sensors,
        look=study.look,
        duration_s=study.duration_s,
        values=study.values,
    )
    check_fields(base)
    fixed = values_of(study.values)
    templates = {name: load_template(name).with_values(fixed) for name in study.templates}
    draws: dict[str, Sequence[tuple[int, str]]] = {name: [(-1, study.values)] for name in templates}
    if study.draws is not None:
        for name, template in templates.items():
            drawn = draws_of(study.draws, template)
            draws[name] = [(number, _with_draw(fixed, values)) for number, values in enumerate(drawn)]
    longest = max(len(one) for one in draws.values())
    for seed in study.seeds:
        for number in range(longest):
            for map_ in study.maps:
                for level in study.levels:
                    for name, template in templates.items():
                        if number < len(draws[name]):
                            draw, values = draws[name][number]
                            asked = replace(base, template=name, level="" if level == OWN_LEVEL else level, seed=seed)
                            asked = replace(asked, map="" if map_ == TOWN else map_, values=values)
                            yield replace(asked, level=level_of(asked, template).name), template.template_id, draw


def _with_draw(fixed: Mapping[str, float], drawn: Mapping[str, float]) -> str:
    """The values of a draw and those that all episodes share, as text.

    Raises:
        InputError: A parameter is in both.
    """
    if both := sorted(fixed.keys() & drawn.keys()):
        raise InputError("values", f"{both[0]}={fixed[both[0]]:g}", "parameters that the study does not draw")
    return text_of_values({**fixed, **drawn})


def _named(request: EpisodeRequest, template_id: str, draw: int, inputs: "_Inputs") -> PlannedEpisode:
    group = f"{template_id}_{request.level}"
    if request.map:
        group += f"_{name_of_map(Path(request.map))}"
    name = f"{group}_seed{request.seed}" + (f"_draw{draw}" if draw >= 0 else "")
    return PlannedEpisode(name, group, request, draw, inputs.sha256_of(request))


class _Inputs:
    """Hashes of what requests read; each file is read once."""

    def __init__(self) -> None:
        self._files: dict[tuple[str, ...], str] = {}
        self._maps: dict[str, str] = {}

    @cached_property
    def _versions(self) -> dict[str, str]:
        return dict(present_versions())

    def sha256_of(self, request: EpisodeRequest) -> str:
        key = (request.template, request.preset, request.sensors, request.av_sensors, request.look)
        if key not in self._files:
            files = [(file.folder, file.name, file.sha256) for file in files_of_request(request)]
            self._files[key] = _sha256(files)
        if request.map not in self._maps:
            self._maps[request.map] = source_sha256_of(Path(request.map) if request.map else None)
        return _sha256([request.to_json(), self._files[key], self._maps[request.map], self._versions])


def _sha256(content: object) -> str:
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
