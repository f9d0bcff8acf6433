"""``siren fit-drivers``: a preset of drivers that is fitted to half of the published figures."""

import argparse
from pathlib import Path

import numpy as np

from siren_ros.base.tables import Row, Table
from siren_ros.cli.options import add_processes, check_numbers, processes_of
from siren_ros.errors import EXIT_OK, write_text
from siren_ros.lab.calibration.ledger_fit import (
    CANDIDATES,
    LEAST_TRIES,
    PRIORS,
    TEMPLATES_OF_A_TRY,
    draw_of,
    fit_to_ledger,
    halves,
    preset_text,
    simulated_tries,
)
from siren_ros.scoring.evaluation.realism.ledger import read_ledger
from siren_ros.simulation.scenario.episode import MAX_SEED
from siren_ros.simulation.scenario.presets import load_preset


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Fits drivers to every other published figure of the ledger by approximate Bayesian computation: tries from "
        "wide priors are simulated, an emulator learns from them what the values do to each figure, and values drawn "
        "by their likelihood become the draws of a preset. `siren evaluate realism` then says how far episodes with it "
        f"are from the figures that were held out. A try takes {2 * len(TEMPLATES_OF_A_TRY)} episodes."
    )
    verb.add_argument("--base", default="realistic", metavar="PRESET", help="what is not fitted (default realistic)")
    verb.add_argument("--tries", type=int, default=100, metavar="N", help="tries to simulate (default 100)")
    verb.add_argument("--draws", type=int, default=24, metavar="N", help="draws of the preset (default 24)")
    verb.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the search (default 0)")
    verb.add_argument("--out", type=Path, required=True, metavar="FILE.yaml", help="write the preset to this file")
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fits, prints the values that are left, and writes the preset."""
    ranges = {"tries": (LEAST_TRIES, 10_000), "draws": (2, 10_000), "seed": (0, MAX_SEED)}
    check_numbers(arguments, ranges)
    fitted, others = halves(read_ledger())
    of_base = load_preset(arguments.base).fitted_to
    held_out = [line for line in others if line.line_id not in of_base]
    with simulated_tries(arguments.base, processes_of(arguments)) as simulate:
        numbers = arguments.tries, arguments.draws, arguments.seed
        draws, effective = fit_to_ledger(fitted, simulate, *numbers)
    names = [line.line_id for line in fitted]
    text = preset_text(f"{arguments.base}, fitted to published figures", [*map(draw_of, draws)], arguments.base, names)
    how = f"siren fit-drivers --base {arguments.base} --tries {arguments.tries}"
    head = (
        f"# Made by `./env --with realism {how} --draws {arguments.draws} --seed {arguments.seed}`; do not edit.\n"
        f"# Fitted to {len(fitted)} lines of params/realism/ledger.yaml; {len(held_out)} are held out. "
        f"{arguments.base} is of {len(of_base)}.\n"
        f"# What is not under `draws` is of the preset {arguments.base}, with its sources and assumptions.\n"
    )
    write_text(arguments.out, head + text)
    quantiles = {name: np.percentile([draw[name] for draw in draws], (5, 50, 95)) for name in PRIORS}
    rows: tuple[Row, ...] = tuple((name, *PRIORS[name], *map(float, quantiles[name])) for name in PRIORS)
    table = Table("fit", "", ("value", "prior from", "to", "5 %", "median", "95 %"), rows, spec=".2f")
    print("\n".join([*table.text(), f"{effective:.0f} of {CANDIDATES} candidates are about as likely as the draws"]))
    return EXIT_OK
