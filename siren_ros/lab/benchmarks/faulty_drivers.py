"""Tests the library's drivers against rulebooks: lawful ones must pass, faulty ones must break the expected clauses.

``python -m siren_ros.benchmarks.faulty_drivers`` judges all of them in the scenes of ``params/faulty_drivers.yaml`` and
prints a line for each; the exit code is 1 where one breaks other clauses.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.parameters import read_strict_yaml
from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.lab.benchmarks.drivers import record_with
from siren_ros.reports.exam.examinee import PAPER
from siren_ros.reports.exam.grading import examine, load_rulebook
from siren_ros.running.seat.drivers.lawful import FAULTS, HABITS
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.templates import load_template

LAWFUL: Final = "lawful"
JAM: Final = "jam"
"""Name of the scene on a road with a rescue lane, which only the German rulebook knows."""


@dataclass(frozen=True)
class Case:
    """A driver, the place whose law applies, and the scenes in which it is judged."""

    fault: str
    place: str
    scenes: tuple[str, ...]
    breaks: frozenset[str]
    """Clauses that the driver is expected to break."""
    paired: bool = False
    """Whether the paper's driver is made to drive, too, to compare."""

    @property
    def driver(self) -> str:
        """Name of the driver."""
        return f"{self.fault}-{self.place}"


def written_down() -> tuple[Mapping[str, str], tuple[Case, ...]]:
    """Read the scenes by name, and all cases, lawful drivers first.

    Raises:
        InputError: The file cannot be used.
    """
    root = read_strict_yaml(params_dir() / "faulty_drivers.yaml")
    listed = root.mapping("scenes")
    scenes = {name: listed.text(name) for name in listed.values}
    faults = root.mapping("faults")
    cases = [Case(LAWFUL, place, _shown(scenes, place), frozenset()) for place in HABITS]
    for fault in FAULTS:
        entry = faults.mapping(fault)
        names, paired = entry.words("scenes"), entry.flag("paired", default=False)
        for place in HABITS:
            breaks = frozenset(entry.words(place) if entry.has(place) else ())
            cases.append(Case(fault, place, _shown(names, place), breaks, paired))
        entry.finish()
    for part in (listed, faults, root):
        part.finish()
    return scenes, tuple(cases)


def _shown(names: Sequence[str] | Mapping[str, str], place: str) -> tuple[str, ...]:
    return tuple(name for name in names if name != JAM or place == "germany")


def broken_by(driver: str, place: str, scene: str, paired: bool) -> frozenset[str]:
    """Clauses of a place's rulebook that a driver breaks in a scene, given by template, level, seed and values."""
    template, level, seed, *values = scene.split()
    map_name = load_template(template).map_name
    request = EpisodeRequest(template, level, int(seed), map_name, sensors="none", values="".join(values))
    paper = record_with(PAPER, request) if paired else None
    return frozenset(examine(*record_with(driver, request), rulebook=load_rulebook(place), paper=paper).violated)


def judged(cases: Sequence[Case], scenes: Mapping[str, str], jobs: int) -> Iterator[tuple[Case, frozenset[str]]]:
    """Judge the cases: the clauses that each driver breaks in any of its scenes."""
    calls = [(case.driver, case.place, scenes[name], case.paired) for case in cases for name in case.scenes]
    with ProcessPool(jobs) as pool:
        found = iter(pool.map(broken_by, calls))
    for case in cases:
        yield case, frozenset().union(*(next(found) for _ in case.scenes))


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser: Any = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", "--jobs", type=int, default=2, help="processes")
    options = parser.parse_args(argv)
    scenes, cases = written_down()
    differ = 0
    for case, broken in judged(cases, scenes, options.workers):
        differ += broken != case.breaks
        said = "as written" if broken == case.breaks else f"DIFFERS, written {sorted(case.breaks)}"
        print(f"{case.driver:<36}{', '.join(sorted(broken)) or 'nothing':<40}{said}", flush=True)
    print(f"{len(cases) - differ} of {len(cases)} as written")
    return EXIT_FAILED if differ else EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
