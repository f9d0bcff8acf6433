"""The exit code and the last lines of ``cosim``, and which exports an episode brings."""

from pathlib import Path

import pytest

from siren_ros.data.lockstep import LockstepState
from siren_ros.errors import InputError
from siren_ros.running.ros.node_configs import CosimConfig
from siren_ros.running.ros.programs.composition import plan_episode
from siren_ros.running.ros.programs.episode_program import closing_summary, verdict
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeOutcome

MEASURES = {"predicate": "0 passed", "actors": 21, "yields_started": 2, "yields_completed": 0, "residual_p99_m": 0.05}


def outcome(holds: bool | None, collisions: int = 0, end: EpisodeEnd = EpisodeEnd.COMPLETE) -> EpisodeOutcome:
    return EpisodeOutcome(end, "", 80, holds, {**MEASURES, "collisions": collisions})


@pytest.mark.parametrize(
    ("judged", "code", "told"),
    [
        (outcome(True), 0, "the episode was made, its interaction happened, nothing collided"),
        (outcome(False), 1, "the interaction did not happen"),
        (outcome(True, 1), 1, "1 collision"),
        (outcome(False, 2), 1, "the interaction did not happen and 2 collisions"),
        (outcome(None), 1, "whether the interaction happened could not be judged"),
        (None, 1, "its interaction was not judged"),
    ],
)
def test_of_a_complete_episode_only_strict_counts_what_happened(
    judged: EpisodeOutcome | None, code: int, told: str
) -> None:
    lenient = verdict(EpisodeEnd.COMPLETE, judged, strict=False)
    strict = verdict(EpisodeEnd.COMPLETE, judged, strict=True)
    if code == 0:
        assert lenient == strict == (0, f"exit code 0: {told}")
    else:
        assert lenient == (0, f"exit code 0: the episode was made ({told}; strict:=true makes this count)")
        assert strict == (1, f"exit code 1: the episode was made, but {told} (strict)")


@pytest.mark.parametrize("strict", [False, True])
def test_an_episode_that_was_not_made_never_ends_with_0(strict: bool) -> None:
    failed = verdict(EpisodeEnd.FAILED, outcome(True), strict=strict, failed=2)
    assert failed == (2, "exit code 2: the episode failed")
    interrupted = verdict(EpisodeEnd.INTERRUPTED, None, strict=strict)
    assert interrupted == (1, "exit code 1: the episode was interrupted")


def interaction(folder: Path, judged: EpisodeOutcome, state: LockstepState | None = None, **asked: float) -> str:
    plan = plan_episode(CosimConfig(template="S2", sensors="none", bag=str(folder / "bag"), **asked))  # type: ignore[arg-type] # forwarded
    lines = closing_summary(plan, state or LockstepState(steps_closed=plan.steps), judged, 1.0)
    (line,) = [line for line in lines if line.startswith("interaction: ")]
    return line


def test_an_episode_that_was_cut_short_says_so(tmp_path: Path) -> None:
    cut = interaction(tmp_path, outcome(False), duration_s=4.0)
    assert cut == "interaction: did not happen, cut short by duration_s to 4 of 45 s (0 passed)"
    assert interaction(tmp_path, outcome(True), duration_s=4.0) == "interaction: verified (0 passed)"
    assert interaction(tmp_path, outcome(False)) == "interaction: did not happen (0 passed)"
    assert interaction(tmp_path, outcome(False), duration_s=100.0) == "interaction: did not happen (0 passed)"
    failed = LockstepState(end=EpisodeEnd.FAILED)
    assert interaction(tmp_path, outcome(False), failed, duration_s=4.0) == "interaction: did not happen (0 passed)"
    nothing = EpisodeOutcome(EpisodeEnd.INTERRUPTED, "stopped by SIGINT", 0, None)
    assert interaction(tmp_path, nothing) == "interaction: not judged"


@pytest.mark.parametrize(
    ("suite", "more", "kitti"),
    [
        ("front", {}, True),
        ("lidar", {"kitti_layout": "paper"}, True),
        ("lidar", {}, False),
        ("front", {"kitti": False}, False),
        ("none", {}, False),
    ],
)
def test_kitti_is_written_where_its_sensors_are(
    tmp_path: Path, suite: str, more: dict[str, object], kitti: bool
) -> None:
    plan = plan_episode(CosimConfig(template="S2", sensors=suite, bag=str(tmp_path / "bag"), **more))  # type: ignore[arg-type] # forwarded
    assert ("kitti_exporter" in plan.nodes) == (plan.kitti is not None) == kitti
    assert bool(plan.no_kitti) == ((suite, more) == ("lidar", {}))


def test_places_that_are_taken_are_refused_before_anything_starts(tmp_path: Path) -> None:
    for name, parameter in (("bag", "bag"), ("bag_kitti", "out")):
        (tmp_path / name).symlink_to(tmp_path / "nowhere")
        with pytest.raises(InputError) as refused:
            plan_episode(CosimConfig(template="S2", sensors="front", bag=str(tmp_path / "bag")))
        assert refused.value.parameter == parameter
        (tmp_path / name).unlink()
