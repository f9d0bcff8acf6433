"""The command ``tools/mutants.sh``; docs: CONTRIBUTING.md."""

import argparse
import json
import os
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from mutants.baseline import SLOW_S, Baseline
from mutants.mutations import Mutant, changed_lines, mutants_below, sample
from mutants.places import Folder, changed_lines_since, files_below, folder_of, mirror_of
from mutants.report import Finding, finding, score_table
from mutants.runner import START_S, Fate, Runner, Task


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="tools/mutants.sh",
        description="Changes the code in small ways, one at a time, and runs the folder's tests for each change. "
        "Prints the changes that no test noticed, and the share that was noticed.",
    )
    parser.add_argument("files", nargs="*", help="files or folders to change")
    parser.add_argument("--since", metavar="REVISION", help="only lines that differ from this revision of git")
    parser.add_argument("--sample", type=int, metavar="N", help="a random sample of N changes; all by default")
    parser.add_argument("--seed", type=int, default=1, help="of the sample (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument(
        "--start",
        type=float,
        default=START_S,
        metavar="SECONDS",
        help="processor time for loading a changed program; five times the tests' own is added (default: %(default)s)",
    )
    parser.add_argument("--tests", nargs="+", metavar="PATH", help="other tests than those of the folder")
    parser.add_argument(
        "--slow", type=float, default=SLOW_S, metavar="SECONDS", help="leaves slower tests out (default: %(default)s)"
    )
    parser.add_argument("--results", type=Path, metavar="FILE", help="writes all results as JSON")
    parser.add_argument("--again", type=Path, metavar="FILE", help="only what survived in these results")
    parser.add_argument("--root", type=Path, default=Path.cwd(), help="the repository (default: this folder)")
    chosen = parser.parse_args(arguments)
    if not chosen.files and not chosen.since and not chosen.again:
        parser.error("name files, --since REVISION or --again FILE")
    return chosen


def choose(root: Path, chosen: argparse.Namespace) -> list[Mutant]:
    """The mutants that the command line asks for."""
    if chosen.again:
        return _survivors(root, json.loads(chosen.again.read_text()))
    changed = changed_lines_since(root, chosen.since) if chosen.since else None
    files = files_below(root, chosen.files) if chosen.files else sorted(changed or {})
    if changed is None:
        return sample(mutants_below(root, [(file, None) for file in files]), chosen.sample, chosen.seed)
    code = [file for file in files if file in changed and not file.startswith("test/")]
    return sample(mutants_below(root, [(file, changed[file]) for file in code]), chosen.sample, chosen.seed)


def _survivors(root: Path, results: list[dict[str, str]]) -> list[Mutant]:
    """Those of earlier results that can still be made: lines may have moved meanwhile."""
    wanted: dict[str, set[tuple[str, str]]] = defaultdict(set)
    for result in results:
        if result["verdict"] == "survived":
            wanted[result["file"]].add((result["was"], result["becomes"]))
    found = []
    for file in sorted(wanted):
        if (root / file).exists():
            source = (root / file).read_text(encoding="utf-8")
            found += [m for m in mutants_below(root, [(file, None)]) if changed_lines(m, source) in wanted[file]]
    return sample(found, None, 0)


def run_folder(
    runner: Runner, folder: Folder, mutants: Sequence[Mutant], chosen: argparse.Namespace, root: Path
) -> list[Finding]:
    """Run the mutants of one folder and print the survivors as they are found."""
    print(f"{folder.package}: {len(mutants)} changes; running its tests over the unchanged code", file=sys.stderr)
    baseline = runner.baseline(chosen.tests or [folder.tests], folder.package, chosen.slow)
    for name in baseline.left_out:
        print(f"  left out, since it is slow or fails in a copy: {name}", file=sys.stderr)
    found: list[Finding] = []

    def report(fate: Fate) -> None:
        source = (root / fate.mutant.file).read_text(encoding="utf-8")
        found.append(finding(fate, source))
        if fate.outcome == "survived":
            print(found[-1].text(), flush=True)

    runner.run([task_of(mutant, baseline) for mutant in mutants], report)
    return found


def task_of(mutant: Mutant, baseline: Baseline) -> Task:
    """A mutant with the tests that can notice it."""
    tests = baseline.tests_for(mutant.file, mutant.line, mirror_of(mutant.file))
    return Task(mutant, tests, sum(baseline.seconds[name] for name in tests))


def main(arguments: Sequence[str]) -> int:
    """Run the command; 2 where the command line is wrong."""
    chosen = parse(arguments)
    root = chosen.root.resolve()
    try:
        mutants = choose(root, chosen)
    except FileNotFoundError as error:
        print(f"mutants: there is no file {error}", file=sys.stderr)
        return 2
    except ValueError as error:
        print(f"mutants: --since: {error}", file=sys.stderr)
        return 2
    folders: dict[Folder, list[Mutant]] = defaultdict(list)
    for mutant in mutants:
        folders[folder_of(mutant.file)].append(mutant)
    findings: list[Finding] = []
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        runner = Runner(root, Path(scratch).resolve(), chosen.jobs, chosen.start)
        for folder, own in folders.items():
            findings += run_folder(runner, folder, own, chosen, root)
            if chosen.results:
                chosen.results.write_text(json.dumps([found.to_json() for found in findings], indent=1))
    print(score_table(findings))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
