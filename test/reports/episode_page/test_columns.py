"""What an episode's page stores as columns: motion, measures, shapes, reasons, the parts of several episodes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from episode_page.made_decisions import GAP, decision
from episode_page.unpacked import unpacked

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.reports.episode_page import columns
from siren_ros.reports.episode_page.columns import (
    ABSENT,
    NOTHING,
    ColumnFile,
    add_motion,
    add_parts,
    add_reasons,
    check_motion,
    measures_of_emvs,
)
from siren_ros.scoring.evaluation.yielding.scoring import score_yielding
from siren_ros.sensing.meshes.mesh import Material, Mesh, StaticScene
from siren_ros.sensing.meshes.solids import box
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.behaviour.driving.navigator import SpeedLimit
from siren_ros.simulation.scenario.paper import PAPER_SPEEDS
from siren_ros.simulation.world.actors import ActorClass

RecordOf = Callable[..., EpisodeRecord]


@pytest.mark.parametrize("order", [0, 1, 2])
def test_columns_come_back_to_half_a_unit(order: int) -> None:
    values = np.array([0.0, -12.3456, 7.0, 2000000.0, -2000000.0, 0.0004, 1.0])
    file = ColumnFile()
    file.add("places", values, 0.001, order)
    file.add("narrow", [0.0, 327.67, -327.68, 5.0], 0.01, order, width=2)
    file.add_bytes("picture", b"\xff\xd8\x00")
    file.add("none", [], order=order)
    file.add("codes", [3, 255, 0, -1])
    head, columns = unpacked(file.packed({"title": "a"}))
    assert head["title"] == "a"
    assert [entry["name"] for entry in head["columns"]] == ["places", "narrow", "picture", "none", "codes"]
    assert np.abs(columns["places"] - values).max() <= 0.0005 + 1e-9
    assert columns["narrow"] == pytest.approx([0.0, 327.67, -327.68, 5.0])
    assert bytes(columns["picture"]) == b"\xff\xd8\x00"
    assert len(columns["none"]) == 0
    assert columns["codes"].tolist() == [3, 255, 0, -1]


def test_the_emv_closes_the_gap_to_the_vehicle_ahead(record_of: RecordOf) -> None:
    """The EMV (6.2 m, from x 10 m at 14 m/s) comes up behind a car (4.6 m, from x 40 m at 6 m/s) in its lane."""
    record = record_of(duration_s=4.0, changing=0)
    ttc_s, gap_m, _ = measures_of_emvs(record)
    (emv,) = record.emv_ids
    rows = record.rows_of(emv)
    step = record.rows.step[rows]
    expected_m = 30.0 - 8.0 * 0.05 * step - (6.2 + 4.6) / 2.0
    apart = expected_m > 0.0
    assert gap_m[rows][apart] == pytest.approx(expected_m[apart], abs=1e-3)
    soon = apart & (expected_m / 8.0 < 2.9)
    assert ttc_s[rows][soon] == pytest.approx(expected_m[soon] / 8.0, abs=1e-3)
    assert (ttc_s[rows][expected_m / 8.0 > 3.1] == NOTHING).all()
    others = np.setdiff1d(np.arange(len(record.rows)), rows)
    assert (ttc_s[others] == NOTHING).all()
    assert (gap_m[others] == NOTHING).all()


def test_the_delay_grows_with_the_share_that_is_lost(record_of: RecordOf) -> None:
    """The EMV drives 14 m/s where the template's target speed is the paper's."""
    record = record_of(duration_s=4.0)
    (emv,) = record.emv_ids
    _, _, delay_s = measures_of_emvs(record)
    rows = record.rows_of(emv)
    steps = np.arange(1, len(rows) + 1)
    assert delay_s[rows] == pytest.approx(steps * STEP_S * (1.0 - 14.0 / PAPER_SPEEDS.emv_route_follow_mps))
    assert delay_s[rows][-1] == pytest.approx(score_yielding(record).metrics["emv_delay_s"].value)
    assert (np.delete(delay_s, rows) == NOTHING).all()
    record = record_of(duration_s=1.0)
    parameters = {**record.description.parameters, "template": {"emv.speed_mps": 0.0}}
    record = replace(record, description=replace(record.description, parameters=parameters))
    assert (np.abs(measures_of_emvs(record)[2]) == NOTHING).all()


def test_the_columns_hold_the_record_to_a_millimetre(record_of: RecordOf) -> None:
    record = record_of(duration_s=6.0)
    file = ColumnFile()
    actors = add_motion(file, record)
    _, columns = unpacked(file.packed({}))
    assert [actor["id"] for actor in actors] == sorted(record.actors)
    assert sum(actor["frames"] for actor in actors) == len(record.rows)
    for name, most in (("x_m", 0.0005), ("y_m", 0.0005), ("yaw_rad", 0.0001), ("speed_mps", 0.005)):
        assert np.abs(columns[f"motion.{name}"] - getattr(record.rows, name)).max() <= most + 1e-9, name
    for name in ("mode", "owner", "lights"):
        assert np.array_equal(columns[f"motion.{name}"], getattr(record.rows, name))
    assert columns["frame.step"].tolist() == [state.step for state in record.states]


def test_an_actor_that_is_away_for_a_while_is_absent_and_not_elsewhere(record_of: RecordOf) -> None:
    record = record_of(duration_s=1.0)
    away = range(5, 8)
    states = tuple(state.select(state.actor_id != 2) if state.step in away else state for state in record.states)
    file = ColumnFile()
    actors = add_motion(file, replace(record, states=states))
    _, columns = unpacked(file.packed({}))
    place = [actor["id"] for actor in actors].index(2)
    first = sum(actor["frames"] for actor in actors[:place])
    modes = columns["motion.mode"][first : first + actors[place]["frames"]]
    assert np.flatnonzero(modes == ABSENT).tolist() == list(away)
    assert actors[place]["first"] == 0


def test_turns_through_west_do_not_jump(record_of: RecordOf) -> None:
    record = record_of(duration_s=1.0)
    turned = tuple(
        replace(state, yaw_rad=np.where(state.step < 10, 3.14, -3.14) + 0.0 * state.yaw_rad) for state in record.states
    )
    file = ColumnFile()
    add_motion(file, replace(record, states=turned))
    _, columns = unpacked(file.packed({}))
    assert np.abs(np.diff(columns["motion.yaw_rad"][: record.steps])).max() < 0.004


def test_records_that_cannot_be_shown_are_refused(record_of: RecordOf) -> None:
    record = record_of(duration_s=0.5)
    check_motion(record)
    for value in (np.nan, np.inf, 2.1e6):
        broken = replace(record.states[3], y_m=np.full(len(record.states[3]), value))
        with pytest.raises(InputError, match="numbers within 2,000 km"):
            check_motion(replace(record, states=(*record.states[:3], broken)))
    for actors in (
        {key: actor for key, actor in record.actors.items() if key != 2},
        {key: replace(actor, width_m=0.0 if key == 2 else 2.0) for key, actor in record.actors.items()},
        {key: replace(actor, width_m=np.nan if key == 2 else 2.0) for key, actor in record.actors.items()},
    ):
        with pytest.raises(InputError, match="numbers within 2,000 km"):
            check_motion(replace(record, actors=actors))


def corners_of(stored: dict[str, np.ndarray], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Place and colour at each corner of each triangle."""
    rows = stored[f"{name}.triangles"].astype(int)
    return stored[f"{name}.xyz"].reshape(3, -1).T[rows], stored[f"{name}.rgb"].astype(int)[rows]


def test_a_shape_keeps_its_triangles_colours_and_lamps() -> None:
    file = ColumnFile()
    columns.add_shapes(file, [ActorClass.AMBULANCE])
    _, stored = unpacked(file.packed({}))
    mesh = vehicle_shape(ActorClass.AMBULANCE).at_rest
    places, colours = corners_of(stored, "shape.AMBULANCE")
    assert np.abs(places - mesh.vertices_m[mesh.triangles.ravel()]).max() <= 0.0005 + 1e-6
    red, green, blue = mesh.colour_rgb.astype(int).T
    plain = ~np.isin(mesh.material, (Material.CAR_PAINT, Material.CLOTHING))
    wanted = (red << 16) + (green << 8) + blue
    assert np.array_equal(colours.reshape(-1, 3)[plain], np.repeat(wanted[:, None], 3, axis=1)[plain])
    surface = stored["shape.AMBULANCE.surface"].astype(int)[stored["shape.AMBULANCE.triangles"].astype(int)]
    lit = surface.reshape(-1, 3)[:, 0]
    assert np.array_equal(lit == 2, mesh.material == Material.BRAKE_LAMP)
    assert np.array_equal(lit == 5, mesh.material == Material.BEACON_BLUE)


def test_wheels_and_limbs_know_what_they_turn_about() -> None:
    file = ColumnFile()
    columns.add_shapes(file, [ActorClass.BICYCLE])
    _, stored = unpacked(file.packed({}))
    parts = vehicle_shape(ActorClass.BICYCLE).parts
    assert np.abs(stored["shape.BICYCLE.hubs"].reshape(-1, 4) - [hub for _, hub in parts]).max() <= 0.0005
    part, places = stored["shape.BICYCLE.part"].astype(int), stored["shape.BICYCLE.xyz"].reshape(3, -1).T
    for number, (mesh, _) in enumerate(parts):
        low, high = mesh.bounds_m
        assert places[part == number].min(axis=0) == pytest.approx(low, abs=0.001)
        assert places[part == number].max(axis=0) == pytest.approx(high, abs=0.001)


def boxes(count: int) -> Mesh:
    """Boxes of twelve triangles, each 10 m farther from the synthetic road's way."""
    return Mesh.joined(
        *(
            box((0.0, 20.0 + 10.0 * k, 0.0), (1.0, 21.0 + 10.0 * k, 1.0), Material.BUILDING_WALL, (9, 9, 9))
            for k in range(count)
        )
    )


def test_of_a_large_scene_the_triangles_near_the_emv_stay(record_of: RecordOf, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(columns, "STATIC_TRIANGLES", 36)
    file = ColumnFile()
    head = columns.add_static_scene(file, [record_of(duration_s=6.0)], StaticScene(boxes(5), ()))
    _, stored = unpacked(file.packed({}))
    places, _ = corners_of(stored, "static")
    assert len(places) == 3 * 36
    assert places[:, 1].max() == pytest.approx(41.0)
    assert head["lamps"] == []


def test_signals_keep_their_housings_and_poles_where_buildings_are_cut(record_of: RecordOf) -> None:
    file = ColumnFile()
    slender = box((0.0, 0.0, 3.0), (0.2, 0.2, 4.0), Material.SIGNAL_HOUSING, (7, 7, 7))
    columns.add_static_scene(file, [record_of(duration_s=1.0)], StaticScene(Mesh.joined(boxes(1), slender), ()))
    _, stored = unpacked(file.packed({}))
    heights = stored["static.xyz"].reshape(3, -1)[2]
    assert np.array_equal(stored["static.surface"] > 0, heights >= 3.0)
    assert len(stored["static.triangles"]) == 3 * 24, "of a small scene everything stays"


def test_reasons_are_sorted_by_actor_and_step_with_the_limits_that_limit() -> None:
    file = ColumnFile()
    limits = {"leader": SpeedLimit(5.0, blocker_id=7), "path": SpeedLimit(), "target": SpeedLimit(70.0)}
    head = add_reasons(
        file,
        [
            (3, {2: decision(6.0, path=SpeedLimit(6.0))}),
            (4, {2: decision(5.0, (GAP,), **limits)}),
            (9, {1: decision(np.nan)}),
        ],
    )
    _, columns = unpacked(file.packed({}))
    assert head == {"why": {"mechanisms": ["leader", "path"], "texts": ["gap", "is free"]}}
    assert columns["why.actor"].tolist() == [1, 2, 2]
    assert columns["why.step"].tolist() == [9, 3, 4]
    assert columns["why.limits"].tolist() == [0, 1, 1]
    assert columns["limit.mechanism"].tolist() == [1, 0]
    assert columns["limit.speed_mps"] == pytest.approx([6.0, 5.0])
    assert columns["limit.blocker"].tolist() == [0, 7]
    assert columns["why.target_mps"] == pytest.approx([-1.0, 6.0, 5.0])
    assert columns["why.guards"].tolist() == [0, 0, 1]
    assert columns["guard.name"].tolist() == [0]
    assert columns["guard.acts"].tolist() == [1]
    assert columns["guard.why"].tolist() == [1]
    assert add_reasons(empty := ColumnFile(), []) == {}
    assert unpacked(empty.packed({}))[0]["columns"] == []


@pytest.fixture(scope="module")
def episodes(record_of: RecordOf) -> tuple[EpisodeRecord, EpisodeRecord, EpisodeRecord]:
    """An episode, a shorter one on its map, and that on another map."""
    shorter = record_of(duration_s=1.0, civilians=2)
    elsewhere = replace(shorter, description=replace(shorter.description, map_sha256="1" * 64))
    return record_of(duration_s=2.0), shorter, elsewhere


def test_each_episode_has_its_motion_and_each_map_its_scene(episodes: tuple[EpisodeRecord, ...]) -> None:
    file = ColumnFile()
    head = add_parts(file, episodes[0], episodes[1:])
    _, stored = unpacked(file.packed({}))
    for prefix, record in zip(("", "1.", "2."), episodes, strict=True):
        assert stored[f"{prefix}motion.x_m"] == pytest.approx(
            np.concatenate([record.rows.x_m[record.rows_of(key)] for key in record.actors]), abs=0.0006
        )
    parts = (head, *head["against"])
    assert [part["prefix"] for part in parts] == ["", "1.", "2."]
    assert [part["scene"] for part in parts] == ["", "", "2."]
    assert [name for name in stored if name.endswith("static.xyz")] == ["static.xyz", "2.static.xyz"]
    assert [len(part["actors"]) for part in parts] == [5, 3, 3]


def test_only_so_many_pictures_share_the_triangles(
    episodes: tuple[EpisodeRecord, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(columns, "STATIC_TRIANGLES", 30)
    file = ColumnFile()
    add_parts(file, episodes[0], episodes[1:])
    _, stored = unpacked(file.packed({}))
    assert len(stored["static.triangles"]) == len(stored["2.static.triangles"]) == 3 * 10
    with pytest.raises(InputError, match="at most 3 other episodes"):
        add_parts(ColumnFile(), episodes[0], 4 * [episodes[1]])
