"""What an episode's setup makes of the map, and what all levels of a seed have in common."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_crossing import ARMS, CROSSING, made_net

from siren_ros.errors import InputError
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop
from siren_ros.running.generation.episode_setup import EpisodeSetup, behaviour_world, plan_length, set_up_episode
from siren_ros.simulation.behaviour.driving.driver_states import draw_driver
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.scenario.driver_parameters import DriverParameters
from siren_ros.simulation.scenario.episode import EpisodeRequest, values_of


def test_nobody_drives_on_shoulders_where_the_template_says_that_they_are_in_use() -> None:
    for name, free in (("S2", False), ("S7", True)):
        network = set_up_episode(EpisodeRequest(name, "", 0, sensors="none")).network
        assert any(lane.kind is LaneKind.SHOULDER and lane.emergency_allowed for lane in network.lanes) is free


def test_an_episode_lasts_until_the_last_emv_has_had_as_long_as_the_first() -> None:
    alone = plan_length(EpisodeRequest("S2", sensors="none"))
    several = EpisodeRequest("S2", sensors="none", values="emv.count=3,emv.headway_s=4")
    assert plan_length(several) == alone + 2 * 80
    assert plan_length(replace(several, duration_s=5.0)) == 100


def test_parameters_of_drivers_reach_the_controllers_and_the_record() -> None:
    usual = set_up_episode(EpisodeRequest("S2", sensors="none"))
    values = "emv_driver.corridor.speed_mps=6.0,civilian_driver.driving.headway_s=1.4,sumo.tau_s=2.0"
    setup = set_up_episode(EpisodeRequest("S2", sensors="none", values=values))
    assert setup.description.template_values == {**usual.description.template_values, **values_of(values)}
    world = behaviour_world(setup.description, setup.compiled_map.read_bytes())
    assert world.speeds.emv_copy_sumo_mps == 6.0
    assert world.config == DriverParameters().with_values(values_of(values))
    before, after = usual.plan.emvs[0].driver, setup.plan.emvs[0].driver
    assert after == replace(before, tau_s=2.0) != before
    assert replace(setup.plan, emvs=()) == replace(usual.plan, emvs=())
    with pytest.raises(InputError, match="tight_gap_m"):
        set_up_episode(EpisodeRequest("S2", sensors="none", values="emv_driver.corridor.tight_gap_m=0.9"))


def test_the_description_says_by_how_much_the_roads_of_the_route_were_prolonged(tmp_path: Path) -> None:
    file = tmp_path / "arms.net.xml"
    file.write_bytes(made_net(tmp_path, CROSSING, ARMS))
    setup = set_up_episode(EpisodeRequest("S3", sensors="none", map=str(file), site="n_c..c_s"))
    said = setup.description.site["prolonged_m"]
    assert said == {name: setup.network.edge_by_id[name].prolonged_m for name in ("n_c", "c_s")}
    assert said["n_c"] > 150.0
    assert "prolonged_m" not in set_up_episode(EpisodeRequest("S3", sensors="none")).description.site


LEVELS = ("L0", "L1", "L2", "L3")
PRIVILEGED_MPS = 10.0
"""Well above the limit of 30 km/h, well below the EMV's 45 km/h and more."""


@pytest.mark.parametrize(("level", "above_the_limit"), [("L0", False), ("L1", True)])
def test_an_emv_keeps_to_the_limit_unless_it_is_privileged(level: str, above_the_limit: bool) -> None:
    setup = set_up_episode(EpisodeRequest("S6", level=level, seed=2, sensors="none"))
    assert setup.plan.emvs[0].spot.speed_mps > setup.network.lanes[setup.plan.emvs[0].spot.lane].speed_limit_mps
    speeds = [float(step.states.speed_mps[0]) for step in closed_loop(setup, 120)]
    assert (np.max(speeds) > PRIVILEGED_MPS) == above_the_limit


@pytest.mark.parametrize("template", ["S4", "S7"])
def test_levels_of_a_seed_begin_alike(template: str) -> None:
    """All that is drawn is the same: values, site, plan, drivers, signals, who is where."""
    nominal, *others = (_beginning(EpisodeRequest(template, level, 3, sensors="none")) for level in LEVELS)
    for setup, first in others:
        assert setup.plan == nominal[0].plan
        assert setup.site == nominal[0].site
        assert setup.preset == nominal[0].preset
        assert setup.compiled_map.sha256 == nominal[0].compiled_map.sha256
        assert setup.description.parameters["template"] == nominal[0].description.parameters["template"]
        lower, higher = first.traffic, nominal[1].traffic
        assert lower.signals == higher.signals
        for name in ("actor_id", "sumo_x_m", "sumo_y_m", "sumo_yaw_rad", "lane", "lane_position_m", "route_edges"):
            np.testing.assert_array_equal(getattr(lower, name), getattr(higher, name), err_msg=name)
        civilian = lower.actor_id > len(setup.plan.emvs)
        np.testing.assert_array_equal(lower.sumo_speed_mps[civilian], higher.sumo_speed_mps[civilian])


@pytest.mark.parametrize("preset", ["paper", "realistic"])
def test_a_driver_responds_alike_at_all_levels(preset: str) -> None:
    """What a driver's response is drawn from knows the seed and the driver, and no level."""
    setups = [set_up_episode(EpisodeRequest("S1", level, 5, sensors="none", preset=preset)) for level in LEVELS]
    worlds = [behaviour_world(setup.description, setup.compiled_map.read_bytes()) for setup in setups]
    for actor_id in range(2, 30):
        drawn = {draw_driver(world.preset, world.seed, actor_id) for world in worlds}
        assert len(drawn) == 1


def _beginning(request: EpisodeRequest) -> tuple[EpisodeSetup, LoopStep]:
    setup = set_up_episode(request)
    with closing(closed_loop(setup, 1)) as steps:
        return setup, next(steps)
