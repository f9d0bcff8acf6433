"""The commands that make a page's numbers again."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from shlex import quote
from typing import Any


def generate_command(asked: Mapping[str, Any], folder: Path) -> str:
    """The call of ``siren generate`` that makes a study, from its ``study.json``."""
    return " ".join(["./env siren generate", *_matrix(asked), *_draws(asked.get("draws")), f"--out {quoted(folder)}"])


def command(verb: str, folder: Path, *more: str) -> str:
    """A call of ``siren`` on the study's folder."""
    return " ".join(["./env siren", verb, quoted(folder), *more])


def quoted(path: Path) -> str:
    """A path as a shell reads it."""
    return quote(str(path))


def _matrix(asked: Mapping[str, Any]) -> Iterator[str]:
    for name in ("templates", "levels", "seeds", "maps"):
        if asked.get(name):
            yield f"--{name} {' '.join(quote(str(value)) for value in asked[name])}"
    for name in ("preset", "sensors", "look"):
        if asked.get(name):
            yield f"--{name} {quote(str(asked[name]))}"
    if asked.get("duration_s"):
        yield f"--duration-s {asked['duration_s']:g}"
    if asked.get("risk_videos"):
        yield f"--risk-videos {asked['risk_videos']}"


def _draws(asked: Mapping[str, Any] | None) -> Iterator[str]:
    if not asked:
        return
    if asked.get("values"):
        words = (f"{path}={','.join(map(str, values))}" for path, values in asked["values"].items())
        yield f"--grid {' '.join(map(quote, words))}"
        return
    yield f"--{'random' if asked['method'] == 'random' else 'lhs'} {asked['samples']}"
    if asked.get("ranges"):
        yield f"--range {' '.join(quote(f'{path}={low:g}:{high:g}') for path, (low, high) in asked['ranges'].items())}"
    yield f"--draw-seed {asked['seed']}"
