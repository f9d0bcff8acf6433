"""Which exports an episode brings, and what is told of one that it cannot bring."""

from pathlib import Path

import pytest

from siren_ros.data.lockstep import LockstepState
from siren_ros.errors import InputError
from siren_ros.running.ros.node_configs import CosimConfig
from siren_ros.running.ros.programs.composition import plan_episode
from siren_ros.running.ros.programs.progress import closing_summary


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


def test_a_suite_that_lacks_the_camera_is_told_at_the_end(tmp_path: Path) -> None:
    plan = plan_episode(CosimConfig(template="S2", sensors="lidar", bag=str(tmp_path / "bag")))
    lines = closing_summary(plan, LockstepState(), None, 0.0)
    (told,) = [line for line in lines if "KITTI" in line]
    assert "no camera_front" in told
    assert "-p sensors:=front" in told
