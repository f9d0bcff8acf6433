"""Compares episodes with left-hand traffic with their mirror images: ``python -m siren_ros.benchmarks.left_hand``.

Every episode runs on a map and on its mirror image, where traffic keeps left. Prints for each template how far
positions are from those of the mirror image, and in how many episodes events differ.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from siren_ros.base.processes.process_pool import ProcessPool, side_by_side
from siren_ros.lab.benchmarks.templates import seeds_of_option
from siren_ros.lab.reproduction.results import add_json, write_json
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop
from siren_ros.running.generation.episode_setup import plan_length, set_up_episode
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.map_formats import mirrored_net
from siren_ros.simulation.roads.road_network import mirror_image
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES


@dataclass(frozen=True)
class Comparison:
    """An episode and its mirror image."""

    apart_m: float
    """Largest difference of positions of an actor at a step; infinite if the actors differ."""
    events_differ: bool


def compare(first: Sequence[LoopStep], second: Sequence[LoopStep]) -> Comparison:
    """Compare two episodes of equal length; the second has left-hand traffic."""
    apart_m, events_differ = 0.0, False
    for own, other in zip(first, second, strict=True):
        image = mirror_image(other.states)
        if not np.array_equal(own.states.actor_id, image.actor_id):
            return Comparison(float("inf"), events_differ=True)
        distance_m = np.hypot(own.states.x_m - image.x_m, own.states.y_m - image.y_m)
        apart_m = max(apart_m, float(distance_m.max(initial=0.0)))
        events_differ |= tuple(map(mirror_image, other.events)) != own.events
    return Comparison(apart_m, events_differ)


def _steps(template: str, seed: int, map_file: str) -> list[LoopStep]:
    request = EpisodeRequest(template, seed=seed, map=map_file, sensors="none")
    return list(closed_loop(set_up_episode(request), plan_length(request)))


def measure(template: str, seed: int, maps: tuple[str, str]) -> Comparison:
    """Compare one seed on two map files; the second is the mirror image."""
    return compare(*(_steps(template, seed, map_file) for map_file in maps))


def main(argv: Sequence[str] | None = None) -> int:
    """Print a row for each template."""
    options = _parser().parse_args(argv)
    net = compile_map(Path(options.map) if options.map else None).read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        right, left = Path(folder) / "right.net.xml", Path(folder) / "left.net.xml"
        right.write_bytes(net)
        left.write_bytes(mirrored_net(net))
        asked = [(template, seed) for template in options.templates for seed in options.seeds]
        with ProcessPool(options.workers, preload="siren_ros.lab.benchmarks.left_hand") as pool:
            calls = {key: partial(pool.call, measure, *key, (str(right), str(left))) for key in asked}
            found = side_by_side(calls, options.workers, pool.stop)
    figures = {}
    print("     episodes  positions apart, at most m  episodes with other events")
    for template in options.templates:
        rows = [found[template, seed] for seed in options.seeds]
        row = figures[template] = {
            "episodes": len(rows),
            "apart_m": max(comparison.apart_m for comparison in rows),
            "other_events": sum(comparison.events_differ for comparison in rows),
        }
        print(f"{template:<5}{row['episodes']:8d}{row['apart_m']:28.3g}{row['other_events']:28d}")
    write_json(options.json, figures)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--templates", nargs="+", default=list(TEMPLATES), metavar="ID")
    parser.add_argument("--seeds", type=seeds_of_option, default=range(2), help="first:last, the last not included")
    parser.add_argument("--map", default="", help="map file; the built-in town by default")
    parser.add_argument("--workers", "--jobs", type=int, default=2, help="processes")
    add_json(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
