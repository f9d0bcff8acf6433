"""``siren evaluate realism`` and ``sim-agents``: a study next to reality, and models of its civilians."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.tables import text_of
from siren_ros.cli.options import add_bags, add_processes, of_each_bag, processes_of
from siren_ros.data.recording.bag_reader import bags_among, read_episode
from siren_ros.errors import EXIT_FAILED, InputError, shown_text, write_text
from siren_ros.reports.study_report.page import html_of, quoted
from siren_ros.reports.study_report.realism import realism_page, realism_tables, summary_of
from siren_ros.scoring.evaluation.realism.distributions import distributions, distributions_as_json, samples_of_tracks
from siren_ros.scoring.evaluation.realism.ledger import LedgerResult, compare, read_ledger, verdict_counts
from siren_ros.scoring.evaluation.realism.quantities import RealismEpisode
from siren_ros.scoring.evaluation.realism.sim_agent_scenes import means_of_scenes, scores_of_episode, sim_agent_table
from siren_ros.scoring.evaluation.realism.track_files import read_tracks, track_files_in


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Compares episodes with what was measured on streets: each published figure of the ledger that a study can "
        "answer, with intervals and a verdict, and with --tracks the distributions of ordinary traffic. Episodes count "
        "at their template's own level; those at L0 of the same seeds give the time that siren and lights save."
    )
    add_bags(verb)
    verb.add_argument(
        "--tracks",
        type=Path,
        nargs="+",
        default=[],
        metavar="PATH",
        help="files or folders of real tracks: INTERACTION and TAF-BW, NGSIM, Argoverse 2, CommonRoad, trajectory.csv",
    )
    verb.add_argument("--html", type=Path, metavar="FILE.html", help="write a page with charts")
    verb.add_argument("--out", type=Path, metavar="FILE", help="write everything as JSON")
    add_processes(verb)
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Measures all bags and all tracks; what cannot be read does not keep the others from being measured."""
    if arguments.html is not None and arguments.html.suffix.lower() not in {".html", ".htm"}:
        raise InputError("html", str(arguments.html), "a file name that ends in .html")
    lines, jobs = read_ledger(), processes_of(arguments)
    episodes, worst = of_each_bag(measure_bag, bags_among(arguments.bags), jobs)
    if not episodes:
        return max(worst, EXIT_FAILED)
    recordings, of_tracks = of_each_bag(measure_tracks, track_files_in(arguments.tracks), jobs)
    results = compare(lines, episodes)
    words = [*arguments.bags, *(("--tracks", *arguments.tracks) if arguments.tracks else ())]
    found = distributions(episodes, recordings)
    command = f"./env siren evaluate realism {' '.join(quoted(Path(word)) for word in words)}"
    print("\n".join([*text_of(realism_tables(results, found, len(recordings))), "", summary_of(results)]))
    if arguments.html is not None:
        study = ", ".join(path.name for path in arguments.bags)
        write_text(arguments.html, html_of(realism_page(study, results, found, len(recordings), command)))
    if arguments.out is not None:
        unseen = [result for result in results if not result.fitted]
        content = {"task": "realism", "episodes": len(episodes), "counts": verdict_counts(results)}
        content |= {"held_out": verdict_counts(unseen), "lines": _lines(results)}
        content["distributions"] = distributions_as_json(found)
        write_text(arguments.out, json.dumps(content, indent=1, allow_nan=False) + "\n")
    return max(worst, of_tracks)


def measure_bag(bag: Path) -> RealismEpisode:
    """The samples of a bag."""
    return RealismEpisode.of(read_episode(bag))


def measure_tracks(file: Path) -> dict[str, Floats]:
    """The samples of a file of tracks."""
    return samples_of_tracks(read_tracks(file))


def _lines(results: Sequence[LedgerResult]) -> dict[str, Any]:
    return {
        one.line.line_id: {
            "about": one.line.about,
            "unit": one.line.unit,
            "published": {"value": one.line.value, "low": one.line.low, "high": one.line.high},
            "predicted": one.predicted.json(),
            "samples": one.samples,
            "verdict": one.verdict,
            "reason": one.reason,
            "fitted": one.fitted,
        }
        for one in results
    }


def add_sim_agents(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.formatter_class = argparse.RawDescriptionHelpFormatter
    verb.description = (
        "Scores models that simulate the civilians around an EMV again, by the terms of the Waymo Open Sim Agents\n"
        "Challenge of 2025: scenes of 8 s after 1.1 s of history, with the vehicles of the interaction region.\n"
        "The rows next to it: agents that jump, constant velocity, and the record earlier or later by up to 0.2 s."
    )
    verb.epilog = (
        "DIR/BAG/FRAME.npy has the futures of the scene whose history begins at that frame of 0.1 s: x, y and yaw,\n"
        "shape (rollouts, agents, 80, 3), with the agents of the present in the order of their ids. The scenes\n"
        "are those of siren_ros.scoring.evaluation.realism.sim_agent_scenes.scenes_of."
    )
    add_bags(verb)
    verb.add_argument("--rollouts", type=Path, metavar="DIR", help="futures of a model for all scenes of all bags")
    verb.add_argument("--out", type=Path, metavar="FILE", help="write the scores of each episode as JSON")
    add_processes(verb)
    verb.set_defaults(run=evaluate_sim_agents)


def evaluate_sim_agents(arguments: argparse.Namespace) -> int:
    """Scores every bag and prints the means."""
    bags = bags_among(arguments.bags)
    jobs = [(bag, None if arguments.rollouts is None else arguments.rollouts / bag.name) for bag in bags]
    scored, worst = of_each_bag(score_sim_agents_of, jobs, processes_of(arguments))
    print("\n".join(text_of([sim_agent_table([scores for _, scores in scored])])))
    if arguments.out is not None:
        rows = [{"bag": bag, "models": scores} for bag, scores in scored]
        write_text(arguments.out, json.dumps({"task": "sim_agents", "episodes": rows}, indent=1) + "\n")
    return worst


def score_sim_agents_of(job: tuple[Path, Path | None]) -> tuple[str, dict[str, dict[str, float]]]:
    """Name of a bag, and the means over its scenes by model."""
    bag, folder = job
    return shown_text(bag.name), means_of_scenes(scores_of_episode(read_episode(bag), folder))
