"""An episode whose background is the user's own traffic."""

from dataclasses import replace
from pathlib import Path

import libsumo
import pytest
from defusedxml.ElementTree import fromstring
from made_crossing import made_net

from siren_ros.data.interfaces.conversions import EpisodeClosing
from siren_ros.errors import InputError
from siren_ros.running.generation.closed_loop import closed_loop, record_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.generation.replay_check import notes_on, repeat_episode
from siren_ros.scoring.judging.outcome import demand_measures
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeOutcome, EpisodeRequest
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.world.actors import ActorClass

NODES = {"c": (0, 0), "n": (0, 300), "e": (300, 0), "s": (0, -300), "w": (-300, 0)}
STEPS = 60
OWN = """<routes>
<vType id="car" vClass="passenger" guiShape="passenger/wagon" tau="1.7" length="4.4" color="10,20,30"/>
<vType id="line" vClass="bus" length="11"/>
<flow id="f" type="car" begin="3600" end="7200" period="2" from="e_c" to="c_w" departLane="best"/>
<vehicle id="bus" type="line" depart="3601"><route edges="s_c c_n"/><stop busStop="halt" duration="500"/></vehicle>
<trip id="late" depart="3631.5" from="n_c" to="c_s"/>
</routes>"""
THINGS = '<additional><busStop id="halt" lane="s_c_0" startPos="100" endPos="120"/></additional>'
NAMED = (
    '<configuration><route-files value="own.rou.xml"/><additional-files value="things.xml"/>'
    '<begin value="3600"/></configuration>'
)


@pytest.fixture(scope="module", name="request_")
def _request(tmp_path_factory):
    folder: Path = tmp_path_factory.mktemp("own")
    net = made_net(folder, NODES, ("n c", "e c", "s c", "w c"), "--tls.default-type", "actuated")
    for name, content in {"own.rou.xml": OWN, "things.xml": THINGS, "own.sumocfg": NAMED}.items():
        (folder / name).write_text(content)
    (folder / "made.net.xml").write_bytes(net)
    files = {"map": str(folder / "made.net.xml"), "demand": str(folder / "own.sumocfg")}
    return EpisodeRequest("S2", sensors="none", site="w_c", duration_s=STEPS * 0.05, **files)


@pytest.fixture(scope="module", name="episode")
def _episode(request_):
    setup = set_up_episode(request_)
    steps = list(closed_loop(setup, STEPS))
    return setup, steps, record_of(setup, steps)


def test_the_users_vehicles_are_the_background_and_the_templates_own_come_on_top(request_, episode):
    setup, steps, record = episode
    usual = set_up_episode(replace(request_, demand=""))
    assert (setup.plan.emvs, setup.plan.groups) == (usual.plan.emvs, usual.plan.groups)
    names = {actor.name: actor for actor in record.actors.values()}
    planned = {vehicle.name for vehicle in (*setup.plan.emvs, *setup.plan.groups)}
    assert names.keys() - planned == {name for name in names if name.startswith("demand.")}
    assert names.keys() >= planned | {"demand.bus", "demand.f.5", "demand.late"}
    flown, bus = names["demand.f.5"], names["demand.bus"]
    assert (flown.actor_class, flown.length_m, flown.colour_rgb) == (ActorClass.ESTATE, 4.4, (10, 20, 30))
    assert (bus.actor_class, bus.length_m) == (ActorClass.BUS, 11.0)
    entered = [actor.name for step in steps[1:] for actor in step.traffic.spawned]
    assert "demand.late" in entered


def test_a_bus_goes_on_to_its_stop_and_a_driver_keeps_the_headway_of_its_type(episode):
    setup, _, _ = episode
    with SumoSimulation(setup.compiled_map, setup.network, setup.plan, setup.level) as simulation:
        state = simulation.step(0, None)
        own = [actor.name for actor in state.spawned if actor.name.startswith("demand.")]
        assert libsumo.vehicle.getTau("demand.f.1") == 1.7
        stops = libsumo.vehicle.getStops("demand.bus")
        assert [stop.stoppingPlaceID for stop in stops] == ["halt"]
        programme = libsumo.trafficlight.getAllProgramLogics("c")[0]
        assert programme.type == 3  # SUMO's number of an actuated programme
        assert libsumo.simulation.getTime() == pytest.approx(3600.0 + setup.template.warm_up_s + 0.05)
        assert len(state) == len(own) + len(setup.plan.emvs) + len(setup.plan.groups)


def test_the_record_holds_all_to_make_it_again(episode, tmp_path):
    _, _, record = episode
    stored = record.description.parameters["demand"]
    assert stored["source"] == "own.sumocfg"
    assert fromstring(f"<a>{stored['xml']}</a>").find("flow") is not None
    gone = {**record.description.parameters["request"], "demand": str(tmp_path / "gone.rou.xml")}
    parameters = {**record.description.parameters, "request": gone}
    assert repeat_episode(replace(record, description=replace(record.description, parameters=parameters))) is None
    assert not [note for note in notes_on(record) if "traffic" in note]
    moved = replace(record, description=replace(record.description, parameters=parameters))
    assert [note for note in notes_on(moved) if "traffic" in note] == [
        f"{tmp_path / 'gone.rou.xml'} is not as it was; the recorded traffic was used"
    ]


def test_the_outcome_names_the_source_and_says_where_nobody_came_near(episode):
    setup, _, record = episode
    measures = demand_measures(record)
    sha256 = setup.description.parameters["demand"]["sha256"]
    own = sum(actor.name.startswith("demand.") for actor in record.actors.values())
    assert measures["demand.source"] == f"own.sumocfg (SHA-256 {sha256})"
    assert (measures["demand.vehicles"], measures["demand.left_out"]) == (own, "nothing")
    assert 0 <= measures["demand.near_emv"] <= own
    assert demand_measures(replace(record, description=replace(record.description, parameters={}))) == {}
    closing = EpisodeClosing(STEPS, EpisodeEnd.COMPLETE, "")
    near = EpisodeOutcome(closing.end, "", STEPS, True, {"demand.near_emv": 1})
    assert near.shortcomings == ()
    assert replace(near, measures={"demand.near_emv": 0}).shortcomings == (
        "no vehicle of the own demand came near an EMV",
    )


def test_sumos_refusal_names_the_demand(request_, tmp_path):
    file = tmp_path / "own.rou.xml"
    file.write_text('<routes><trip id="a" depart="0" from="e_c" to="c_w" departSpeed="quick"/></routes>')
    setup = set_up_episode(replace(request_, demand=str(file)))
    with pytest.raises(InputError, match=r"own\.rou\.xml"):
        next(closed_loop(setup, 1))
