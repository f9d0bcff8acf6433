"""Compares the library's drivers in the same episodes: ``python -m siren_ros.benchmarks.drivers idm``.

For each driver it prints means over the episodes with 95 % intervals: the clauses of a rulebook that it violates, and
what it does to others, less what the paper's driver does in its place (as ``siren exam``, without bags).
"""

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import EXIT_OK, SirenError
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.reports.exam.certificate import Certificate
from siren_ros.reports.exam.examinee import PAPER, actor_in_seat, compared_with_paper
from siren_ros.reports.exam.grading import Rulebook, Sitting, examine, load_rulebook
from siren_ros.running.generation.closed_loop import closed_loop, driven, record_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.seated import answers_of
from siren_ros.running.studies.matrix import levels_of, seeds_of
from siren_ros.simulation.scenario.episode import EpisodeRequest


def record_with(driver: str, request: EpisodeRequest) -> tuple[EpisodeRecord, int]:
    """Record an episode with a driver of the AV; returns it with the AV's id. The paper's driver needs no AV.

    Raises:
        InputError: The request cannot be used.
        EpisodeError: The episode failed.
    """
    setup = set_up_episode(replace(request, av="" if driver == PAPER else "civilian"))
    loop = closed_loop(setup, setup.steps)
    if driver == PAPER:
        record = record_of(setup, list(loop))
        return record, actor_in_seat(record)
    steps = driven(loop, answers_of(setup, driver_of(driver)))
    return record_of(setup, [step for step, _ in steps]), setup.description.av_id


def sittings_in(request: EpisodeRequest, drivers: Sequence[str], rulebook: Rulebook) -> Mapping[str, Sitting]:
    """Grade drivers in one episode; empty if the seed has no such episode."""
    try:
        paper, paper_id = record_with(PAPER, request)
    except SirenError:
        return {}
    sittings = {PAPER: examine(paper, paper_id, rulebook)}
    for driver in drivers:
        record, actor_id = record_with(driver, request)
        others = compared_with_paper(record, actor_id, paper, paper_id)
        sittings[driver] = replace(examine(record, actor_id, rulebook), others=others)
    return sittings


def requests_of(
    templates: Iterable[str], levels: Iterable[str], seeds: Iterable[int], maps: Iterable[str], duration_s: float
) -> list[EpisodeRequest]:
    """Requests for all combinations of the arguments."""
    return [
        EpisodeRequest(template, level, seed, "" if place == "town" else place, sensors="none", duration_s=duration_s)
        for place, template, level, seed in product(maps, templates, levels, seeds)
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Print a row for each driver."""
    parser: Any = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drivers", nargs="+", metavar="DRIVER", help="names of drivers, or ONNX files")
    parser.add_argument("--rulebook", default="international", metavar="NAME")
    parser.add_argument("--templates", nargs="+", default=["S1", "S2", "S7"], metavar="ID")
    parser.add_argument("--levels", nargs="+", default=["L2", "L3"], metavar="L")
    parser.add_argument("--seeds", nargs="+", default=["0:10"], metavar="N|A:B")
    parser.add_argument("--maps", nargs="+", default=["town"], metavar="FILE")
    parser.add_argument("--duration-s", type=float, default=0.0, metavar="S", help="of an episode (default: its own)")
    parser.add_argument("--workers", "--jobs", type=int, default=2, metavar="N", help="processes")
    add_json(parser)
    options = parser.parse_args(argv)
    rulebook = load_rulebook(options.rulebook)
    cells = options.templates, levels_of(options.levels), seeds_of(options.seeds), options.maps
    requests = requests_of(*cells, options.duration_s)
    with ProcessPool(options.workers) as pool:
        found = pool.map(sittings_in, [(request, options.drivers, rulebook) for request in requests])
    there = [sittings for sittings in found if sittings]
    print(f"{len(there)} of {len(requests)} episodes; rulebook {rulebook.name}")
    figures: dict[str, Any] = {"episodes": len(there)}
    for driver in (PAPER, *options.drivers):
        certificate = Certificate(driver, rulebook, tuple(one[driver] for one in there))
        means = certificate.means()
        figures[driver.replace("-", "_")] = {name: mean.json() for name, mean in means.items()}
        print(f"{driver:<28}" + "".join(f"  {name} {mean:+.2f}" for name, mean in means.items()))
    write_json(options.json, figures)
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
