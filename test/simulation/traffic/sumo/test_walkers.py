"""People on foot in SUMO: where they walk, and how they come into the state of a step."""

from collections import Counter
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import libsumo
import numpy as np
import pytest
import shapely
from hand_made_record import actor_states, traffic_of
from traffic_helpers import load_map

from siren_ros.base.numerics.units import STEP_S
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.traffic import simulation as simulation_module
from siren_ros.simulation.traffic.demand.plan import PlannedWalker
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo import walkers as walkers_module
from siren_ros.simulation.traffic.sumo.walkers import PeopleTable, Walkers, poses_of, steps_into, with_people
from siren_ros.simulation.world.actors import TRAFFIC_STATE_DTYPES, ActorClass, ActorStates, Owner

PEOPLE = 40
CITY = load_map(Path("city"))[1]


def steps_with(people: int, steps: int) -> Any:
    values = f"demand.people.pedestrians={people}"
    return list(closed_loop(set_up_episode(EpisodeRequest("S2", map="city", sensors="none", values=values)), steps))


@pytest.fixture(scope="module")
def loops() -> Any:
    """The first step without people, and some with them."""
    return {0: steps_with(0, 1), PEOPLE: steps_with(PEOPLE, 200)}


def walkers_of(steps: Any) -> dict[int, Any]:
    found = (actor for step in steps for actor in step.traffic.spawned)
    return {actor.actor_id: actor for actor in found if actor.actor_class is ActorClass.PEDESTRIAN}


def test_there_are_as_many_as_asked_for_and_sumo_owns_them(loops: Any) -> None:
    people = walkers_of(loops[PEOPLE])
    assert not walkers_of(loops[0])
    for step in loops[PEOPLE]:
        walks = np.isin(step.traffic.actor_id, list(people))
        assert PEOPLE - 3 <= walks.sum() <= PEOPLE, "others enter every two seconds"
        assert (step.traffic.lane[walks] == NO_LANE).all()
        assert (step.states.owner[walks] == Owner.SUMO).all()
        assert (np.diff(step.traffic.route_offset)[walks] == 0).all()
        assert (np.diff(step.traffic.actor_id.astype(np.int64)) > 0).all()


def test_they_have_the_ids_after_everybody_who_was_there_before_and_others_drive_as_without_them(loops: Any) -> None:
    first = [loops[count][0].traffic.spawned for count in (0, PEOPLE)]
    assert first[1][: len(first[0])] == first[0]
    assert {actor.actor_class for actor in first[1][len(first[0]) :]} == {ActorClass.PEDESTRIAN}
    alone, together = (loops[count][0].states for count in (0, PEOPLE))
    shared = np.isin(together.actor_id, alone.actor_id)
    np.testing.assert_array_equal(together.x_m[shared], alone.x_m)


def test_people_walk_and_follow_sumo(loops: Any) -> None:
    """At the paces of people, without jumps, near SUMO's places."""
    people, way, before = walkers_of(loops[PEOPLE]), Counter[int](), None
    for step in loops[PEOPLE]:
        states = step.states.select(np.isin(step.states.actor_id, list(people)))
        assert states.residual_m.max() < 2.0
        if before is not None and np.array_equal(before.actor_id, states.actor_id):
            moved = np.hypot(states.x_m - before.x_m, states.y_m - before.y_m)
            assert moved.max() <= 3.0 * STEP_S
            way.update(dict(zip(states.actor_id.tolist(), moved.tolist(), strict=True)))
        before = states
    assert np.median(list(way.values())) > 5.0  # 10 s at 1.3 m/s, some wait at signals


def test_people_keep_off_the_road_but_for_crossings(loops: Any) -> None:
    lanes = [lane for lane in CITY.lanes if lane.kind in {LaneKind.DRIVING, LaneKind.CYCLE, LaneKind.SHOULDER}]
    road = shapely.union_all([shapely.LineString(x.centre.points).buffer(x.width_m / 2, cap_style=2) for x in lanes])
    crossings = shapely.union_all([shapely.Polygon(outline).buffer(1.0) for outline in CITY.crossings])
    road = road.buffer(0.2).difference(crossings)
    people = walkers_of(loops[PEOPLE])
    for step in loops[PEOPLE][20::10]:
        states = step.states.select(np.isin(step.states.actor_id, list(people)))
        assert not shapely.contains_xy(road, states.x_m, states.y_m).any()


@pytest.mark.parametrize(
    ("place", "speed_mps", "blocked"),
    [
        *[((1.4, 0.0), 0.0, True), ((3.5, 0.0), 0.0, False), ((1.4, 1.5), 0.0, False), ((-3.0, 0.0), 0.0, False)],
        *[((2.3, 0.0), 1.8, True), ((2.3, 0.0), 0.0, False)],
    ],
)
def test_nobody_steps_into_a_vehicle_ahead(place: tuple[float, float], speed_mps: float, blocked: bool) -> None:
    """A vehicle of 4 m by 1.8 m across the way, its middle at a place before somebody who looks east.

    1.8 m/s take 0.65 m: a side that is 1.4 m ahead stops them.
    """
    poses = np.array([0.0, place[0]]), np.array([0.0, 2.0 * place[1]]), np.array([0.0, np.pi / 2.0])
    sizes = np.array([0.0, 4.0]), np.array([0.0, 1.8])
    found, comes = steps_into(np.array([0, -1]), (poses, sizes), np.array([speed_mps, 0.0]))
    assert found.tolist() == [blocked, False]
    assert not comes.any()


@pytest.mark.parametrize(
    ("ahead_m", "beside_m", "speed_mps", "yaw_rad", "walks_mps", "comes"),
    [
        (10.0, 2.5, 9.0, 0.5 * np.pi, 1.2, True),
        (10.0, 2.5, 9.0, -0.5 * np.pi, 1.2, False),
        (10.0, 3.0, 9.0, 0.5 * np.pi, 1.2, False),
        (10.0, 0.4, 9.0, 0.5 * np.pi, 1.2, False),
        (17.0, 2.5, 9.0, 0.5 * np.pi, 1.2, False),
        (-3.5, 2.5, 9.0, 0.5 * np.pi, 1.2, True),
        (-6.5, 2.5, 9.0, 0.5 * np.pi, 1.2, False),
        (3.0, 2.5, 1.8, 0.5 * np.pi, 1.2, False),
        (10.0, 3.0, 9.0, 0.5 * np.pi, 0.0, True),
        (10.0, 5.0, 9.0, 0.5 * np.pi, 0.0, False),
        (24.0, 3.0, 9.0, 0.5 * np.pi, 0.0, True),
        (26.0, 3.0, 9.0, 0.5 * np.pi, 0.0, False),
        (3.0, 1.0, 1.2, 0.5 * np.pi, 0.0, True),
        (3.0, 1.0, 0.2, 0.5 * np.pi, 0.0, False),
    ],
    ids=[
        *("comes nearer", "goes away", "far enough", "in the way", "it can stop", "it leaves", "behind it"),
        *("walking pace", "stands and does not set off", "stands far enough", "stands, and its driver has to see it"),
        *("stands, and its driver has the time", "stands until it has rolled past", "stands, and so does the vehicle"),
    ],
)
def test_people_keep_away_from_a_vehicle_that_cannot_stop(
    ahead_m: float, beside_m: float, speed_mps: float, yaw_rad: float, walks_mps: float, *, comes: bool
) -> None:
    """A vehicle of 4 m by 2 m goes east: 9 m/s take 13.5 m, and 9 m until it brakes; somebody is right of its way."""
    poses = np.array([0.0, ahead_m]), np.array([0.0, -1.0 - beside_m]), np.array([0.0, yaw_rad])
    sizes = np.array([4.0, 0.0]), np.array([2.0, 0.0])
    _, found = steps_into(np.array([1]), (poses, sizes), np.array([speed_mps, walks_mps]))
    assert found.tolist() == [comes]


def test_nobody_leaves_a_street_at_the_end_where_they_came_in() -> None:
    values = f"demand.people.pedestrians={PEOPLE}"
    steps = closed_loop(set_up_episode(EpisodeRequest("S2", map="city", sensors="none", values=values)), 2)
    next(steps)

    def between(before: str, after: str) -> set[str]:
        ends = [{edge.from_junction, edge.to_junction} for edge in map(CITY.edge_by_id.__getitem__, (before, after))]
        return ends[0] & ends[1]

    goals = 0
    for name in libsumo.person.getIDList():
        stages = range(libsumo.person.getRemainingStages(name))
        walks = [edges for stage in stages if len(edges := libsumo.person.getStage(name, stage).edges) > 1]
        for came, goes in pairwise(walks):
            entry, exit_ = between(*came[-2:]), between(*goes[:2])
            assert entry != exit_ or len(entry) > 1
            goals += 1
    steps.close()
    assert goals > PEOPLE


def test_those_who_stand_stay_where_they_stood_first() -> None:
    walker = PlannedWalker("w", 0.6, 0.6, 1.75, (0, 0, 0), 1.3, "oak_e_0", 60.0, ())
    table = PeopleTable.of({"a": 1, "b": 2}, {"a": walker, "b": walker}, None)
    table.stands[1] = True
    for at_m in (5.0, 6.0):
        poses = np.array([[at_m, at_m], [1.0, 2.0 * at_m]])
        table.hold(poses)
        assert poses.tolist() == [[at_m, 5.0], [1.0, 10.0]]
        table = PeopleTable.of(
            {"b": 2, "c": 3, "a": 1}, {"a": walker, "b": walker}, table
        )  # others have entered or left


def test_rows_are_merged_by_id() -> None:
    state = traffic_of(0, actor_id=[1, 5], lane=[3, 4], route_offset=[0, 2, 3], route_edges=[7, 8, 9])
    one = np.full((4, 1), 4.0)
    merged = with_people(state, np.array([3], np.uint32), one, 2.0 * one)
    assert merged.actor_id.tolist() == [1, 3, 5]
    assert merged.lane.tolist() == [3, NO_LANE, 4]
    assert merged.sumo_x_m.tolist() == [0.0, 4.0, 0.0]
    assert merged.x_m.tolist() == [0.0, 8.0, 0.0]
    assert merged.route_offset.tolist() == [0, 2, 2, 3]
    assert [merged.route_of_row(row).tolist() for row in range(3)] == [[7, 8], [], [9]]
    for name, kind in TRAFFIC_STATE_DTYPES.items():
        assert getattr(merged, name).dtype == kind, name


@pytest.mark.parametrize(
    ("angle_deg", "speed_mps", "pose"),
    [
        (270.0, 0.0, (4.5, 2.0, 0.0)),
        (0.0, 0.0, (4.5, 2.0, 0.0)),
        (270.0, 0.2, (5.5, 2.0, np.pi)),
        (0.0, 0.2, (5.0, 1.5, 0.5 * np.pi)),
        (60.0, 0.0, (5.0 - 0.5 * np.sqrt(0.75), 1.75, np.pi / 6.0)),
    ],
    ids=["stands, reversed", "stands, aside", "walks back", "walks aside", "stands, a little aside"],
)
def test_those_who_stand_do_not_swing_round_their_toes(
    angle_deg: float, speed_mps: float, pose: tuple[float, float, float]
) -> None:
    """SUMO's place is that of the toes; 90 degrees is east, to which they looked before."""
    walks, ids = np.array([[5.0, 2.0, angle_deg, speed_mps]]), np.array([-1])
    facing, nobody = np.zeros(1), tuple(np.empty(0) for _ in range(4))
    sumo, _ = poses_of(walks, (0.0, 0.0), ids, nobody, facing)
    assert sumo[:, 0] == pytest.approx([*pose, speed_mps])
    assert facing == pytest.approx([pose[2]])


def test_people_of_the_last_state_are_known_with_their_crossings(monkeypatch: pytest.MonkeyPatch) -> None:
    setup = set_up_episode(EpisodeRequest("S2", map="city", sensors="none", values="demand.people.pedestrians=60"))
    outlines, crossed = [shapely.Polygon(outline) for outline in CITY.crossings], 0
    made: list[Walkers] = []
    monkeypatch.setattr(simulation_module, "Walkers", lambda *given: made.append(Walkers(*given)) or made[0])
    with SumoSimulation(setup.compiled_map, setup.network, setup.plan, setup.level, seed=0) as simulation:
        simulation.step(0, None)
        (walkers,) = made
        for step in range(1, 150):
            state, people = simulation.step(step, ActorStates.empty(step - 1)), walkers.people
            rows = np.searchsorted(state.actor_id, people[6])
            np.testing.assert_array_equal(people[:2], (state.x_m[rows], state.y_m[rows]))
            across = people[:, people[5] > 0.0]
            for x_m, y_m, crossing in across[[0, 1, 4]].T.tolist():
                assert shapely.contains_xy(outlines[int(crossing)], x_m, y_m)
            crossed = max(crossed, across.shape[1])
    assert 0 < crossed < 60


class SumoPeople:
    """A stand-in for SUMO: where the people are that it got, and the speeds that it was told."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.results: dict[str, dict[int, Any]] = {}
        self.told_mps: dict[str, float] = {}
        person = SimpleNamespace(
            add=lambda *_, **__: None,
            appendWalkingStage=lambda *_: None,
            subscribe=lambda *_: None,
            getAllSubscriptionResults=lambda: self.results,
            setSpeed=self.told_mps.__setitem__,
        )
        names = ("VAR_POSITION", "VAR_ANGLE", "VAR_SPEED", "VAR_ROAD_ID")
        lane = SimpleNamespace(getLength=lambda _: 100.0)
        codes = {name: getattr(libsumo, name) for name in names}
        monkeypatch.setattr(walkers_module, "libsumo", SimpleNamespace(person=person, lane=lane, **codes))
        monkeypatch.setattr(walkers_module, "Corners", lambda *_: SimpleNamespace(walks=lambda *_: []))


@pytest.fixture
def sumo(monkeypatch: pytest.MonkeyPatch) -> SumoPeople:
    return SumoPeople(monkeypatch)


def at_a_crossing(
    sumo: SumoPeople, distance_m: float, notice_m: float, speed_mps: float, *, behind: bool = False
) -> Any:
    """Somebody at a kerb who looks at the road, and somebody on a crossing, with an EMV near."""
    lane = next(
        lane for lane in CITY.lanes if lane.kind is LaneKind.DRIVING and CITY.edges[lane.edge].edge_id == "oak_e_0"
    )
    middle, heading = lane.centre.at(60.0), float(lane.centre.heading_rad(60.0))
    ahead, right = np.array([np.cos(heading), np.sin(heading)]), np.array([np.sin(heading), -np.cos(heading)])
    kerb = middle + (lane.width_m / 2.0 + 0.6) * right
    places = np.array([middle + (distance_m if behind else -distance_m) * ahead, kerb, middle])
    people = [
        PlannedWalker(name, 0.6, 0.6, 1.75, (0, 0, 0), 1.3, "oak_e_0", 60.0, (), notice_m)
        for name in ("kerb", "crosses")
    ]
    plan: Any = SimpleNamespace(walkers_kept=2, uncrossed="", walkers=tuple(people))
    walkers = Walkers(CITY, plan)
    walkers.exchange([tuple(kerb.tolist())], 0.0)
    looks_deg = 90.0 - float(np.degrees(heading + np.pi / 2.0))
    x_m, y_m = (kerb + CITY.sumo_offset_m).tolist()
    for name, road in (("kerb", "oak_e_0"), ("crosses", ":oak_c0")):  # for SUMO the second one is about to set off
        sumo.results[name] = {
            libsumo.VAR_POSITION: (x_m, y_m),
            libsumo.VAR_ANGLE: looks_deg,
            libsumo.VAR_SPEED: 0.0,
            libsumo.VAR_ROAD_ID: road,
        }
    numbers = count(2)
    there = walkers.joined(traffic_of(0), ActorStates.empty(0), numbers)
    assert there.actor_id.tolist() == [2, 3]
    told = {"x_m": places[:, 0], "y_m": places[:, 1], "yaw_rad": heading + np.array([0.0, np.pi / 2.0, np.pi / 2.0])}
    return walkers, actor_states(0, actor_id=[1, 2, 3], vx_mps=[speed_mps, 0.0, 0.0], **told)


@pytest.mark.parametrize(
    ("distance_m", "notice_m", "speed_mps", "behind", "paces"),
    [
        (30.0, 40.0, 10.0, False, {"kerb": 0.01, "crosses": 1.95}),
        (50.0, 40.0, 10.0, False, {}),
        (50.0, 40.0, 2.0, False, {"kerb": 0.01, "crosses": 1.95}),  # held up: heard as far as in a queue
        (90.0, 40.0, 2.0, False, {}),
        (30.0, 40.0, 10.0, True, {}),
        (30.0, 0.0, 2.0, False, {}),
    ],
)
def test_people_wait_or_hurry_where_a_siren_comes(
    sumo: SumoPeople,
    distance_m: float,
    notice_m: float,
    speed_mps: float,
    behind: bool,
    paces: dict[str, float],
) -> None:
    walkers, states = at_a_crossing(sumo, distance_m, notice_m, speed_mps, behind=behind)
    walkers.heed(states, {}, np.array([1], np.uint32))
    assert sumo.told_mps == pytest.approx(paces)
    assert walkers.waiting == (("kerb",) if paces else ()), "for whom SUMO's drivers do not wait, else both would"
    sumo.told_mps.clear()
    walkers.heed(states, {}, np.empty(0, np.uint32))  # the siren is off
    assert sumo.told_mps == dict.fromkeys(paces, 1.3)
    assert walkers.waiting == ()


@pytest.mark.parametrize("turned", [0.0, np.pi])
def test_who_walks_along_the_road_goes_on_where_a_siren_comes(sumo: SumoPeople, turned: float) -> None:
    walkers, states = at_a_crossing(sumo, 30.0, 40.0, 10.0)
    walkers.heed(replace(states, yaw_rad=states.yaw_rad[[0, 0, 2]] + [0.0, turned, 0.0]), {}, np.array([1], np.uint32))
    assert (sumo.told_mps, walkers.waiting) == ({"crosses": pytest.approx(1.95)}, ())


@pytest.mark.parametrize(("behind_m", "paces"), [(0.25, {}), (0.35, {"kerb": 0.3 * 1.3, "crosses": 0.3 * 1.3})])
def test_sumo_waits_for_those_whom_it_has_left_behind(
    sumo: SumoPeople, behind_m: float, paces: dict[str, float]
) -> None:
    walkers, states = at_a_crossing(sumo, 90.0, 0.0, 2.0, behind=False)
    walkers.heed(replace(states, residual_m=np.full(3, behind_m)), {}, np.empty(0, np.uint32))
    assert sumo.told_mps == pytest.approx(paces)


def test_who_stands_again_is_kept_at_the_new_place(sumo: SumoPeople) -> None:
    walkers, states = at_a_crossing(sumo, 30.0, 40.0, 10.0)

    def place_after(moved_m: float, *sirens: int) -> float:
        """Where SUMO's person is taken to be, once it has moved in SUMO; it stands while a siren sounds."""
        for result in sumo.results.values():
            result[libsumo.VAR_POSITION] = (result[libsumo.VAR_POSITION][0] + moved_m, result[libsumo.VAR_POSITION][1])
        x_m = float(walkers.joined(traffic_of(0, ""), ActorStates.empty(0), count(4)).sumo_x_m[0])
        walkers.heed(states, {}, np.array(sirens, np.uint32))
        return x_m

    first_m = place_after(0.0, 1)
    assert [place_after(0.5, 1), place_after(0.5)] == pytest.approx([first_m + 0.5] * 2)
    assert place_after(2.0, 1) == pytest.approx(first_m + 3.0)
    assert [place_after(0.5, 1), place_after(0.5, 1)] == pytest.approx([first_m + 3.5] * 2)
