"""A study as a YAML file, and the words by which files and the command line say the same."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError
from siren_ros.params.strict_yaml import StrictMapping, read_strict_yaml
from siren_ros.scenario.levels import EmergencyLevel
from siren_ros.scenario.request import MAX_SEED
from siren_ros.studies.draws import DrawPlan, Method
from siren_ros.studies.matrix import OWN_LEVEL, TOWN, Study

LEVELS: Final = (OWN_LEVEL, *EmergencyLevel.__members__)
MOST_SAMPLES: Final = 10_000_000


def read_study(file: Path) -> Study:
    """A study from its file.

    Raises:
        InputError: An unknown or missing key, or a value that is not allowed; names file, line and key.
    """
    top = read_strict_yaml(file)
    study = Study(
        templates=top.words("templates"),
        levels=levels_of(top.words("levels")) if top.has("levels") else (OWN_LEVEL,),
        seeds=seeds_of(top.words("seeds")) if top.has("seeds") else (0,),
        maps=top.words("maps") if top.has("maps") else (TOWN,),
        preset=top.text("preset") if top.has("preset") else "paper",
        sensors=top.text("sensors") if top.has("sensors") else "none",
        look=top.text("look") if top.has("look") else "clear",
        duration_s=top.number("duration_s", 0.0, 3600.0) if top.has("duration_s") else 0.0,
        values=top.text("values") if top.has("values") else "",
        draws=_draws(top.mapping("draw")) if top.has("draw") else None,
        risk_videos=top.integer("risk_videos", 0, MOST_SAMPLES) if top.has("risk_videos") else 0,
    )
    top.finish()
    return study


def _draws(section: StrictMapping) -> DrawPlan:
    method = Method(section.text("method", [one.value for one in Method]))
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
    """Levels by name, or ``own``.

    Raises:
        InputError: Another word.
    """
    for word in words:
        if word not in LEVELS:
            raise InputError("levels", word, f"of {', '.join(LEVELS)}")
    return tuple(words)


def seeds_of(words: Sequence[str]) -> tuple[int, ...]:
    """Seeds from words: ``3``, or ``0:5`` for 0 to 4.

    Raises:
        InputError: Another word.
    """
    found: list[int] = []
    for word in words:
        first, colon, end = word.partition(":")
        try:
            seeds = range(int(first), int(end) if colon else int(first) + 1)
        except ValueError as error:
            raise InputError("seeds", word, "a seed, or FIRST:END for FIRST to END − 1") from error
        if not seeds or seeds[0] < 0 or seeds[-1] > MAX_SEED:
            raise InputError("seeds", word, f"seeds from 0 to {MAX_SEED}, at least one")
        found.extend(seeds)
    return tuple(found)


def grid_of(words: Sequence[str]) -> DrawPlan:
    """A grid from words ``PATH=VALUE,VALUE,…``.

    Raises:
        InputError: Another word.
    """
    values: dict[str, tuple[float, ...]] = {}
    for word in words:
        path, _, texts = word.partition("=")
        if not texts or path in values:
            raise InputError("grid", word, "PATH=VALUE,VALUE,…, each path once")
        values[path] = tuple(_number(path, text) for text in texts.split(","))
    return DrawPlan(Method.GRID, values=values)


def range_of(path: str, words: Sequence[str]) -> tuple[float, float]:
    """Two numbers, least first.

    Raises:
        InputError: Something else.
    """
    if len(words) != 2:
        raise InputError(path, " ".join(words), "two numbers, the least first")
    return _number(path, words[0]), _number(path, words[1])


def ranges_of(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ranges from words ``PATH=LOW:HIGH``.

    Raises:
        InputError: Another word.
    """
    found: dict[str, tuple[float, float]] = {}
    for word in words:
        path, _, limits = word.partition("=")
        if path in found:
            raise InputError("range", word, "each path once")
        found[path] = range_of(path, limits.split(":"))
    return found


def _number(path: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(path, text, "a number") from error
