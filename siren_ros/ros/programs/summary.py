"""What the user reads when an episode is over."""

from pathlib import Path

from siren_ros.errors import EXIT_FAILED, EXIT_OK
from siren_ros.lockstep.lockstep import LockstepState
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.bag_folder import read_message_counts, working_path
from siren_ros.ros.programs.episode_plan import EpisodePlan
from siren_ros.ros.programs.progress import time_table
from siren_ros.scenario.episode import EpisodeEnd, EpisodeOutcome

_MEGABYTE = 1_000_000.0


def closing_summary(
    plan: EpisodePlan, state: LockstepState, outcome: EpisodeOutcome | None, wall_s: float
) -> list[str]:
    """Lines about the end of the episode, its files and its wall time.

    Args:
        plan: With the final folder of the bag; an episode that did not complete has its partial bag next to it.
        state: The lockstep at the end.
        outcome: The recorder's judgement; None where there is none.
        wall_s: Wall time from the first step to the last.
    """
    steps = state.steps_closed
    lines = [f"episode {state.end.value} after {steps * STEP_S:.2f} s ({steps} steps)" + _because(state.reason)]
    lines += _bag_lines(plan.bag, state.end)
    if plan.kitti is not None and state.end is EpisodeEnd.COMPLETE:
        lines.append(f"KITTI export: {plan.kitti}")
    if plan.no_kitti:
        lines.append(f"no KITTI export: {plan.no_kitti}")
    lines += _outcome_lines(outcome, _cut_short(plan) if state.end is EpisodeEnd.COMPLETE else "")
    if wall_s and steps:
        lines.append(f"real-time factor {steps * STEP_S / wall_s:.2f} ({wall_s:.1f} s of wall time)")
        lines += time_table(state.busy_s, wall_s)
    return lines


def _because(reason: str) -> str:
    return f": {reason}" if reason else ""


def _bag_lines(bag: Path, end: EpisodeEnd) -> list[str]:
    if end is not EpisodeEnd.COMPLETE:
        partial = sorted(bag.parent.glob(f"{bag.name}.partial*"), key=lambda path: path.stat().st_mtime)
        if working_path(bag).is_dir():
            return [f"cut-off bag: {working_path(bag)} (`siren recover {working_path(bag)}` completes it)"]
        return [f"partial bag: {partial[-1]}"] if partial else []
    if not bag.is_dir():
        return []
    size_mb = sum(file.stat().st_size for file in bag.iterdir()) / _MEGABYTE
    counts = read_message_counts(bag)
    return [f"bag: {bag} ({size_mb:.1f} MB)"] + [f"  {name:<44}{count:6d}" for name, count in sorted(counts.items())]


def _cut_short(plan: EpisodePlan) -> str:
    if not plan.is_cut_short:
        return ""
    return f"cut short by duration_s to {plan.steps * STEP_S:g} of {plan.own_steps * STEP_S:g} s"


def _outcome_lines(outcome: EpisodeOutcome | None, cut_short: str) -> list[str]:
    if outcome is None or not outcome.measures:
        return ["interaction: not judged"]
    word = {True: "verified", False: "did not happen", None: "could not be judged"}[outcome.predicate_holds]
    if cut_short and not outcome.predicate_holds:
        word += f", {cut_short}"
    measures = outcome.measures
    lines = [f"interaction: {word} ({measures.get('predicate', '')})"]
    if "actors" in measures:
        lines.append(
            f"  {measures['actors']} actors, {measures['yields_started']} yields started, "
            f"{measures['yields_completed']} completed, {measures['collisions']} collisions, "
            f"residual p99 {float(measures['residual_p99_m']):.2f} m"
        )
    return lines


def verdict(
    end: EpisodeEnd, outcome: EpisodeOutcome | None, *, strict: bool, failed: int = EXIT_FAILED
) -> tuple[int, str]:
    """The exit code of an episode, and the line that says what it stands for.

    Args:
        end: Whether the episode was made.
        outcome: The recorder's judgement; None where there is none.
        strict: Whether the interaction and collisions count.
        failed: Exit code of an episode that was not made.
    """
    if end is not EpisodeEnd.COMPLETE:
        code, told = failed, f"the episode {'was interrupted' if end is EpisodeEnd.INTERRUPTED else 'failed'}"
        return code, f"exit code {code}: {told}"
    lacking = ("its interaction was not judged",) if outcome is None else outcome.shortcomings
    if not lacking:
        return EXIT_OK, f"exit code {EXIT_OK}: the episode was made, its interaction happened, nothing collided"
    if strict:
        return EXIT_FAILED, f"exit code {EXIT_FAILED}: the episode was made, but {' and '.join(lacking)} (strict)"
    told = f"({' and '.join(lacking)}; strict:=true makes this count)"
    return EXIT_OK, f"exit code {EXIT_OK}: the episode was made {told}"
