"""Description of a study, from a YAML file or options: templates × levels × seeds × maps × sites × draws."""

import itertools
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import cached_property, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Brief, random_stream
from siren_ros.base.params.parameters import StrictMapping, check_fields, read_strict_yaml
from siren_ros.errors import InputError
from siren_ros.running.generation.episode_setup import files_of_request, level_of, map_of, present_versions
from siren_ros.simulation.roads.maps.map_compiler import name_of_map, source_sha256_of
from siren_ros.simulation.scenario.episode import MAX_SEED, EpisodeRequest, text_of_values, values_of
from siren_ros.simulation.scenario.paper import EmergencyLevel, level_name
from siren_ros.simulation.scenario.scenario import DRAWN_BY_NAME, Template, ValueRange
from siren_ros.simulation.scenario.sealing import seed_of
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.own_demand import sha256_of_demand


class Method(StrEnum):
    """Method by which values are chosen."""

    GRID = "grid"
    RANDOM = "random"
    LATIN_HYPERCUBE = "latin_hypercube"


@dataclass(frozen=True)
class DrawPlan:
    """Values of a template's parameters that a study uses."""

    method: Method
    values: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """For a grid: the values of each parameter."""
    samples: int = 0
    """For other methods: the number of draws."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """For other methods: the parameters and their ranges; if empty, all parameters of the template with the ranges in
    its file."""
    seed: int = 0


def draws_of(plan: DrawPlan, template: Template) -> tuple[dict[str, float], ...]:
    """The values of each draw, in a fixed order.

    A template's draws do not depend on which other templates are in the study.

    Raises:
        InputError: A parameter that the template does not have, or a value outside its range.
    """
    if plan.method is Method.GRID:
        names = sorted(plan.values)
        combinations = itertools.product(*(plan.values[name] for name in names))
        draws = tuple(dict(zip(names, values, strict=True)) for values in combinations)
    else:
        draws = _sampled(plan, template)
    for values in draws:
        template.with_values(values)
    return draws


def _sampled(plan: DrawPlan, template: Template) -> tuple[dict[str, float], ...]:
    if plan.samples < 1:
        raise InputError("samples", plan.samples, "1 or more")
    ranges = _ranges(plan, template)
    rng = random_stream(plan.seed, f"study/{template.template_id}")
    if plan.method is Method.LATIN_HYPERCUBE:
        from scipy.stats import qmc  # noqa: PLC0415 - this import takes as long as all others of a study

        unit = qmc.LatinHypercube(len(ranges), seed=rng).random(plan.samples)
    else:
        unit = rng.random((plan.samples, len(ranges)))
    columns = {path: _scaled(unit[:, column], limits) for column, (path, limits) in enumerate(sorted(ranges.items()))}
    return tuple({path: float(values[row]) for path, values in columns.items()} for row in range(plan.samples))


def _ranges(plan: DrawPlan, template: Template) -> dict[str, ValueRange]:
    if not plan.ranges:
        return {path: limits for path, limits in template.ranges.items() if path not in DRAWN_BY_NAME}
    ranges = {}
    for path, (low, high) in plan.ranges.items():
        limits = template.range_of(path, f"[{low:g}, {high:g}]")
        if not limits.minimum <= low <= high <= limits.maximum:
            allowed = f"within [{limits.minimum:g}, {limits.maximum:g}], the range of {template.template_id}"
            raise InputError(path, f"[{low:g}, {high:g}]", f"[low, high] {allowed}")
        ranges[path] = ValueRange(low, high, limits.integer)
    return ranges


def _scaled(unit: npt.NDArray[np.float64], limits: ValueRange) -> npt.NDArray[np.float64]:
    """Scale numbers of [0, 1) to a range; whole numbers are equally likely."""
    if limits.integer:
        low, high = round(limits.minimum), round(limits.maximum)
        return np.floor(low + unit * (high - low + 1)).clip(low, high)
    return limits.minimum + unit * (limits.maximum - limits.minimum)


OWN_LEVEL: Final = "own"
"""Stands for the level in the template's file."""
TOWN: Final = "town"
"""Stands for the built-in map that a template happens on."""
DRAWN: Final = "drawn"
"""Stands for a site drawn by the seed."""


@dataclass(frozen=True)
class Seat:
    """Driver of the AV under test."""

    driver: str = ""
    """A name in ``siren_ros.running.seat.drivers.drivers.DRIVERS``; empty for none."""
    program: str = ""
    """Command line of a ROS program; empty for none."""
    real_time: bool = False
    """Whether episodes with the program run in real time, so that it has only the time that a vehicle would have."""

    def __bool__(self) -> bool:
        """Whether there is a driver."""
        return bool(self.driver or self.program)


@dataclass(frozen=True)
class Study(Brief):
    """The matrix of a study's episodes; every combination is one episode."""

    templates: tuple[str, ...]
    levels: tuple[str, ...] = (OWN_LEVEL,)
    seeds: tuple[int, ...] = (0,)
    maps: tuple[str, ...] = (TOWN,)
    sites: tuple[str, ...] = (DRAWN,)
    preset: str = "paper"
    sensors: str = "none"
    look: str = "clear"
    duration_s: float = 0.0
    """Duration of every episode; 0 for the template's own."""
    demand: str = ""
    """Own background traffic of every episode, as ``EpisodeRequest.demand``."""
    values: str = ""
    """Values of template parameters instead of those drawn by seeds, as ``EpisodeRequest.values``."""
    salt: str = ""
    """File with the secret that seals every episode, as ``EpisodeRequest.salt``."""
    draws: DrawPlan | None = None
    """Draws of parameters; None if each seed draws its own values."""
    risk_videos: int = 0
    """Number of risk videos per template in addition to the episodes, with the paper's shares of classes."""
    seat: Seat = Seat()
    """Driver of the AV under test in every episode; without one there is no AV."""

    def to_json(self) -> dict[str, Any]:
        """The study as JSON types."""
        content = dict(json.loads(json.dumps(asdict(self))))
        return {name: value for name, value in content.items() if value or name != "salt"}


@dataclass(frozen=True)
class PlannedEpisode:
    """One cell of the matrix."""

    name: str
    group: str
    """Folder of the episodes that share template, level, map and pinned site."""
    request: EpisodeRequest
    draw: int
    """Number of the draw; −1 where the study draws nothing."""
    inputs_sha256: str
    """Hash of all inputs of the episode."""
    seat: Seat = Seat()


def plan_study(study: Study) -> tuple[PlannedEpisode, ...]:
    """All episodes of a study. Template changes last, so that an early look at the results has some of each.

    Raises:
        InputError: A template, level, map, preset, suite or draw that cannot be used; two maps of one name.
    """
    for part in ("templates", "levels", "seeds", "maps", "sites"):
        repeated = [value for value, count in Counter(getattr(study, part)).items() if count > 1]
        if repeated or not getattr(study, part):
            raise InputError(part, repeated[0] if repeated else "", "one or more, each of them once")
    inputs = _Inputs()
    planned = tuple(_named(request, template, draw, study.seat, inputs) for request, template, draw in _cells(study))
    counts = Counter(episode.name for episode in planned)
    for episode in planned:
        if counts[episode.name] > 1:
            raise InputError("maps", episode.request.map, f"files of different names; {episode.name} comes twice")
    return planned


def _cells(study: Study) -> Iterator[tuple[EpisodeRequest, str, int]]:
    """Requests with the id of the template and the number of the draw."""
    base = EpisodeRequest(
        preset=study.preset,
        sensors=study.sensors,
        look=study.look,
        duration_s=study.duration_s,
        values=study.values,
        demand=study.demand,
        salt=study.salt,
        av="civilian" if study.seat else "",
    )
    check_fields(base)
    fixed = values_of(study.values)
    templates = {name: load_template(name).with_values(fixed) for name in study.templates}
    draws: dict[str, Sequence[tuple[int, str]]] = {name: [(-1, study.values)] for name in templates}
    if study.draws is not None:
        for name, template in templates.items():
            drawn = draws_of(study.draws, template)
            draws[name] = [(number, _with_draw(fixed, values)) for number, values in enumerate(drawn)]
    numbers = range(max(map(len, draws.values())))
    axes = (study.seeds, numbers, study.maps, study.sites, study.levels)
    for seed, number, map_, site, level in itertools.product(*axes):
        place = replace(base, seed=seed, map="" if map_ == TOWN else map_, level="" if level == OWN_LEVEL else level)
        place = replace(place, site="" if site == DRAWN else site)
        for name, template in templates.items():
            if number < len(draws[name]):
                draw, values = draws[name][number]
                own_map = place.map or template.map_name
                request = replace(place, template=name, values=values, map=own_map)
                yield replace(request, level=level_of(request, template).name), template.template_id, draw


def _with_draw(fixed: Mapping[str, float], drawn: Mapping[str, float]) -> str:
    """Text of a draw's values and of common values; InputError if a parameter is in both."""
    if both := sorted(fixed.keys() & drawn.keys()):
        raise InputError("values", f"{both[0]}={fixed[both[0]]:g}", "parameters that the study does not draw")
    return text_of_values({**fixed, **drawn})


_FOREIGN: Final = re.compile(r"[^\w.#-]")
"""Characters that names of folders must not have."""


def _named(request: EpisodeRequest, template_id: str, draw: int, seat: Seat, inputs: "_Inputs") -> PlannedEpisode:
    group = f"{template_id}_{request.level}" + (f"_{name_of_map(Path(request.map))}" if request.map else "")
    group += f"_{_FOREIGN.sub('-', request.site)}" if request.site else ""
    name = f"{group}_seed{request.seed}" + (f"_draw{draw}" if draw >= 0 else "")
    return PlannedEpisode(name, group, request, draw, inputs.sha256_of(request, seat), seat)


class _Inputs:
    """Hashes of the files of requests; each file is read once."""

    def __init__(self) -> None:
        self._files: dict[tuple[str, ...], str] = {}
        self._maps: dict[Path | None, str] = {}

    @cached_property
    def _versions(self) -> dict[str, str]:
        return dict(present_versions())

    def sha256_of(self, request: EpisodeRequest, seat: Seat) -> str:
        key = (request.template, request.preset, request.sensors, request.av_sensors, request.look)
        if key not in self._files:
            files = [(file.folder, file.name, file.sha256) for file in files_of_request(request)]
            self._files[key] = _sha256(files)
        source = map_of(request, load_template(request.template))
        if source not in self._maps:
            self._maps[source] = source_sha256_of(source)
        seated: list[object] = [asdict(seat)] if seat else []
        seated += [sha256_of_demand(Path(request.demand))] if request.demand else []
        seated += [seed_of(request)] if request.salt else []
        return _sha256([request.to_json(), self._files[key], self._maps[source], self._versions, *seated])


def _sha256(content: object) -> str:
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


LEVELS: Final = (OWN_LEVEL, *EmergencyLevel.__members__)
MOST_SAMPLES: Final = 10_000_000


def read_study(file: Path) -> Study:
    """A study from its file; InputError for an unknown or missing key or a wrong value, with file, line and key."""
    top = read_strict_yaml(file)
    readers: dict[str, Callable[[], Any]] = {
        "levels": lambda: levels_of(top.words("levels")),
        "seeds": lambda: seeds_of(top.words("seeds")),
        "maps": lambda: top.words("maps"),
        "sites": lambda: top.words("sites"),
        **{name: partial(top.text, name) for name in ("preset", "sensors", "look", "demand", "values")},
        "duration_s": lambda: top.number("duration_s", 0.0, 3600.0),
        "risk_videos": lambda: top.integer("risk_videos", 0, MOST_SAMPLES),
    }
    study = Study(top.words("templates"), **{name: read() for name, read in readers.items() if top.has(name)})
    study = replace(study, draws=_draws(top.mapping("draw")) if top.has("draw") else None)
    top.finish()
    return study


def _draws(section: StrictMapping) -> DrawPlan:
    method = Method(section.text("method", list(Method)))
    if method is Method.GRID:
        values = section.mapping("values")
        grid = {path: tuple(_number(path, word) for word in values.words(path)) for path in values.values}
        section.finish()
        return DrawPlan(method, values=grid)
    ranges = section.mapping("ranges").values if section.has("ranges") else {}
    limits = section.mapping("ranges") if ranges else section
    plan = DrawPlan(
        method,
        samples=section.integer("samples", 1, MOST_SAMPLES),
        ranges={path: range_of(path, limits.words(path)) for path in ranges},
        seed=section.integer("seed", 0, MAX_SEED) if section.has("seed") else 0,
    )
    section.finish()
    return plan


def levels_of(words: Sequence[str]) -> tuple[str, ...]:
    """Levels by name, or ``own``; InputError for another word."""
    names = tuple(level_name(word) for word in words)
    for name in names:
        if name not in LEVELS:
            raise InputError("levels", name, f"of {', '.join(LEVELS)}")
    return names


def seeds_of(words: Sequence[str]) -> tuple[int, ...]:
    """Seeds from words, ``3``, or ``0:5`` for 0 to 4; InputError for another word."""
    all_seeds: list[int] = []
    for word in words:
        first, colon, end = word.partition(":")
        try:
            seeds = range(int(first), int(end) if colon else int(first) + 1)
        except ValueError as error:
            raise InputError("seeds", word, "a seed, or FIRST:END for FIRST to END − 1") from error
        if not seeds or seeds[0] < 0 or seeds[-1] > MAX_SEED:
            raise InputError("seeds", word, f"seeds from 0 to {MAX_SEED}, at least one")
        all_seeds.extend(seeds)
    return tuple(all_seeds)


def grid_of(words: Sequence[str]) -> DrawPlan:
    """A grid from words ``PATH=VALUE,VALUE,…``; InputError for another word."""
    values: dict[str, tuple[float, ...]] = {}
    for word in words:
        path, _, texts = word.partition("=")
        if not texts or path in values:
            raise InputError("grid", word, "PATH=VALUE,VALUE,…, each path once")
        values[path] = tuple(_number(path, text) for text in texts.split(","))
    return DrawPlan(Method.GRID, values=values)


def range_of(path: str, words: Sequence[str]) -> tuple[float, float]:
    """Two numbers, least first; InputError for something else."""
    if len(words) != 2:
        raise InputError(path, " ".join(words), "two numbers, the least first")
    return _number(path, words[0]), _number(path, words[1])


def ranges_of(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ranges from words ``PATH=LOW:HIGH``; InputError for another word."""
    ranges: dict[str, tuple[float, float]] = {}
    for word in words:
        path, _, limits = word.partition("=")
        if path in ranges:
            raise InputError("range", word, "each path once")
        ranges[path] = range_of(path, limits.split(":"))
    return ranges


def _number(path: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(path, text, "a number") from error
