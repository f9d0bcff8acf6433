"""TTC and DRAC held against SUMO's own device: ``python -m siren_ros.benchmarks.surrogate_safety --vehicles 80``.

Lets impatient drivers go their ways through a map under SUMO alone, and compares both measures where both apply: one
vehicle follows another on its lane, and SUMO's TTC is below 3 s. Prints how far they are apart, moment by moment and in
each pair's extremes.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from siren_ros.benchmarks.ssm_device import LENGTH_M, WIDTH_M, Conflict, DeviceRun, run_device
from siren_ros.errors import EXIT_OK
from siren_ros.evaluation.surrogate_safety.encounters import Encounters
from siren_ros.evaluation.surrogate_safety.time_to_collision import HORIZON_S, predicted_contacts
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S
from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.net_parser import parse_road_network


@dataclass(frozen=True)
class Compared:
    """One pair: SUMO's measures and ours at the same moments, shape ``(N,)`` each."""

    sumo_ttc_s: Floats
    own_ttc_s: Floats
    """Infinite where the footprints miss each other."""
    sumo_drac_mps2: Floats
    own_drac_mps2: Floats


@dataclass(frozen=True)
class Agreement:
    """How far the two are apart."""

    pairs: int
    moments: int
    missed: int
    """Moments at which SUMO sees a conflict, and the swept footprints miss each other."""
    ttc_s: Floats
    """Distances of the moments that both see, shape ``(M,)``."""
    drac_mps2: Floats
    least_ttc_s: Floats
    """Distances of each pair's least TTC, shape ``(P,)``."""
    most_drac_mps2: Floats


def compare(run: DeviceRun) -> tuple[Compared, ...]:
    """All pairs with a moment below the horizon of TTC."""
    pairs = (_pair(run, conflict) for conflict in run.conflicts)
    return tuple(pair for pair in pairs if len(pair.sumo_ttc_s))


def _pair(run: DeviceRun, conflict: Conflict) -> Compared:
    follower, leader = run.tracks[conflict.follower], run.tracks[conflict.leader]
    steps = np.rint(conflict.time_s / STEP_S).astype(np.int64)
    known = conflict.time_to_collision_s < HORIZON_S
    known &= np.isin(steps, follower.step) & np.isin(steps, leader.step)
    mine, theirs = (np.searchsorted(track.step, steps[known]) for track in (follower, leader))
    size = (LENGTH_M, WIDTH_M)
    encounters = Encounters(follower.select(mine), leader.select(theirs), size, np.tile(size, (len(mine), 1)))
    contacts = predicted_contacts(encounters)
    return Compared(
        conflict.time_to_collision_s[known],
        contacts.time_s,
        conflict.required_deceleration_mps2[known],
        contacts.required_deceleration_mps2,
    )


def agreement_of(pairs: Sequence[Compared]) -> Agreement:
    """Distances over all moments and over each pair's extremes; pairs that ours never sees count as missed only."""
    seen = [np.isfinite(pair.own_ttc_s) for pair in pairs]
    both = [pair for pair, known in zip(pairs, seen, strict=True) if known.any()]
    return Agreement(
        len(pairs),
        sum(len(known) for known in seen),
        sum(int(np.count_nonzero(~known)) for known in seen),
        _joined([np.abs(pair.own_ttc_s - pair.sumo_ttc_s)[known] for pair, known in zip(pairs, seen, strict=True)]),
        _joined(
            [np.abs(pair.own_drac_mps2 - pair.sumo_drac_mps2)[known] for pair, known in zip(pairs, seen, strict=True)]
        ),
        np.array([abs(pair.own_ttc_s.min() - pair.sumo_ttc_s.min()) for pair in both]),
        np.array([abs(pair.own_drac_mps2.max() - np.nanmax(pair.sumo_drac_mps2)) for pair in both]),
    )


def _joined(parts: Sequence[Floats]) -> Floats:
    values = np.concatenate([np.empty(0), *parts])
    return values[np.isfinite(values)]


def lines_of(agreement: Agreement) -> list[str]:
    """The printed text."""
    count = f"{agreement.pairs} pairs that follow each other, {agreement.moments} moments with SUMO's TTC below "
    lines = [f"{count}{HORIZON_S:g} s; at {agreement.missed} the swept footprints miss each other"]
    for what, unit, values in (
        ("TTC", "s", agreement.ttc_s),
        ("DRAC", "m/s²", agreement.drac_mps2),
        ("least TTC of a pair", "s", agreement.least_ttc_s),
        ("greatest DRAC of a pair", "m/s²", agreement.most_drac_mps2),
    ):
        if len(values):
            middle, late, most = np.percentile(values, (50.0, 99.0, 100.0))
            lines.append(
                f"{what}: apart by {middle:.2g} {unit} (median), {late:.2g} (99th percentile), {most:.2g} (most)"
            )
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs SUMO and prints the agreement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--map", type=Path, help="map file (default: the town)")
    parser.add_argument("--vehicles", type=int, default=80, help="(default %(default)s)")
    parser.add_argument("--duration-s", type=float, default=90.0, help="(default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="(default %(default)s)")
    given = parser.parse_args(arguments)
    compiled = compile_map(given.map)
    network = parse_road_network(compiled.net_path.read_bytes())
    run = run_device(compiled.net_path, network, given.vehicles, given.duration_s, given.seed)
    print("\n".join(lines_of(agreement_of(compare(run)))))
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
