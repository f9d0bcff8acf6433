"""The page of an episode in a browser: its content, other episodes beside it, its speed."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser_pages import VIEWPORT, OpenedPage, PageBrowser
from episode_page.looked_at import moment, pictures, until
from episode_page.made_decisions import NO_GAP, decision
from episode_page.unpacked import unpacked

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.reports.episode_page.build import episode_data, episode_page, title_of
from siren_ros.reports.episode_page.columns import measures_of_emvs
from siren_ros.scoring.judging.outcome import evaluate_predicate
from siren_ros.simulation.behaviour.driving.navigator import SpeedLimit
from siren_ros.simulation.world.actors import ActorClass, Event, EventKind, Mode, Owner

RecordOf = Callable[..., EpisodeRecord]
HOSTILE = "</script><img src=x onerror=\"document.title='taken'\"><b>"
WHY = [
    (100, {2: decision(5.0, (NO_GAP,), path=SpeedLimit(9.0), leader=SpeedLimit(5.0, blocker_id=3))}),
    (101, {2: decision(5.0, leader=SpeedLimit(5.0, blocker_id=1))}),
    (102, {1: decision(np.nan), 2: decision(np.nan)}),
]


@pytest.fixture(scope="module")
def record(record_of: RecordOf) -> EpisodeRecord:
    """Twelve seconds; names and map try to be markup."""
    made = record_of(duration_s=12.0)
    actors = {key: replace(actor, name=f"{actor.name}{HOSTILE}") for key, actor in made.actors.items()}
    return replace(made, actors=actors, description=replace(made.description, map_name=HOSTILE))


@pytest.fixture(scope="module")
def content(record: EpisodeRecord) -> str:
    return episode_page(record, WHY)


@pytest.fixture(scope="module")
def file(content: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "episode.html"
    path.write_text(content, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def shared(file: Path, browser: PageBrowser) -> Iterator[OpenedPage]:
    with browser.opened(file) as page:
        until(page, "window.episodePage !== undefined")
        yield page


@pytest.fixture
def opened(shared: OpenedPage) -> OpenedPage:
    """The page at its begin, with the EMV selected, from behind it, paused."""
    shared.page.set_viewport_size(VIEWPORT)
    shared.page.evaluate(
        "() => { const p = episodePage; p.play(false); p.seek(0); p.select(1); p.useCamera('follow'); }"
    )
    shared.page.locator("#scene").focus()
    return shared


def test_wheels_have_rolled_the_way_and_steer_as_recorded(opened: OpenedPage, record: EpisodeRecord) -> None:
    drawn = opened.page.evaluate("() => { episodePage.seek(5.0); return episodePage.drawn(); }")
    rows = {row["id"]: row for row in drawn}
    mine = record.rows_of(1)[:101]
    way_m = np.hypot(np.diff(record.rows.x_m[mine]), np.diff(record.rows.y_m[mine])).sum()
    assert rows[1]["rolled"] == pytest.approx(way_m, abs=0.05)
    assert rows[1]["steer"] == pytest.approx(record.rows.steer_rad[mine[-1]], abs=0.003)


def test_the_page_draws_little_and_neither_complains_nor_asks_for_anything(opened: OpenedPage, content: str) -> None:
    for camera in ("follow", "orbit", "above", "driver"):
        opened.page.click(f"#camera-{camera}")
        pictures(opened)
    counted = opened.page.evaluate("episodePage.statistics()")
    assert 0 < counted["calls"] <= 150
    assert 0 < counted["triangles"] <= 300_000
    assert len(content.encode()) < 5_000_000
    assert opened.problems == []
    assert opened.requests == []
    codes = opened.page.locator("#colours code").all_text_contents()
    assert set(codes) == {mode.name.lower() for mode in Mode}


def test_names_stay_text(opened: OpenedPage, content: str, record: EpisodeRecord) -> None:
    assert HOSTILE not in content
    assert opened.page.title() == title_of(record)
    assert opened.page.locator("img").count() == 0
    assert opened.page.locator("#actor option").first.inner_text().endswith(HOSTILE)
    assert HOSTILE[:20] in opened.page.locator("#facts").inner_text()


def test_scripts_that_are_not_the_pages_own_do_not_run(file: Path, browser: PageBrowser, tmp_path: Path) -> None:
    text = file.read_text(encoding="utf-8")
    path = tmp_path / "added.html"
    path.write_text(text.replace("</body>", "<script>document.title = 'taken'</script></body>"), encoding="utf-8")
    with browser.opened(path) as page:
        assert page.page.title() != "taken"
        assert any("Content Security Policy" in problem for problem in page.problems)


def test_calm_readers_see_no_flashing(opened: OpenedPage) -> None:
    script = "t => { episodePage.seek(t); episodePage.drawn(); return episodePage.stage.fleet.beacon.value; }"
    for motion, levels in (("reduce", 1), ("no-preference", 2)):
        opened.page.emulate_media(reduced_motion=motion)
        assert len({opened.page.evaluate(script, time_s) for time_s in (0.0, 0.1, 0.2, 0.3, 0.4)}) == levels


@pytest.mark.parametrize("camera", ["above", "follow"])
def test_a_click_selects_the_vehicle_that_is_there(opened: OpenedPage, record: EpisodeRecord, camera: str) -> None:
    opened.page.evaluate("camera => { episodePage.seek(0.5); episodePage.useCamera(camera); }", camera)
    x, y = opened.page.evaluate("episodePage.onScreen(2)")
    opened.page.mouse.click(x, y)
    pictures(opened)
    assert moment(opened)["actor"] == 2
    speed = record.states[10].speed_mps[record.states[10].actor_id.tolist().index(2)]
    cells = opened.page.locator("#facts-of-actor dd").all_inner_texts()
    assert cells[0] == "sedan"
    assert cells[2] == f"{3.6 * speed:.1f} km/h"
    opened.page.evaluate("episodePage.useCamera('above')")
    opened.page.touchscreen.tap(*opened.page.evaluate("episodePage.onScreen(3)"))
    pictures(opened)
    assert moment(opened)["actor"] == 3
    x, y = opened.page.evaluate("episodePage.onScreen(3)")
    opened.page.mouse.click(x, y + 150)
    assert moment(opened)["actor"] == 3, "there is no vehicle"


def test_what_a_ray_hits_comes_before_what_it_almost_hits(opened: OpenedPage, record: EpisodeRecord) -> None:
    opened.page.evaluate("() => episodePage.seek(0.5)")
    ids, *place = (getattr(record.states[10], name).tolist() for name in ("actor_id", "x_m", "y_m", "yaw_rad"))
    poses = dict(zip(ids, zip(*place, strict=True), strict=True))
    (x, y, yaw), (far_x, far_y, _) = poses[2], poses[3]
    side_m = -record.actors[2].width_m / 2 - 0.24
    beside = (x - np.sin(yaw) * side_m, y + np.cos(yaw) * side_m)
    assert np.hypot(far_x - x, far_y - y) > 10.0
    way = (far_x - beside[0], far_y - beside[1])
    ray = {
        "origin": {"x": beside[0] - 0.1 * way[0], "y": beside[1] - 0.1 * way[1], "z": 0.7},
        "direction": {"x": way[0], "y": way[1], "z": 1e-6},
    }
    hit = "ray => episodePage.tracks.actors[episodePage.stage.fleet.hit(ray)]?.id"
    assert opened.page.evaluate(hit, ray) == 3
    ray = {"origin": {"x": beside[0], "y": beside[1], "z": 10.0}, "direction": {"x": 1e-6, "y": 1e-6, "z": -1.0}}
    assert opened.page.evaluate(hit, ray) == 2


def test_keys_move_through_time_vehicles_and_cameras(opened: OpenedPage) -> None:
    press = opened.page.keyboard.press
    press("ArrowRight")
    press("ArrowRight")
    press("ArrowLeft")
    assert moment(opened)["time"] == pytest.approx(0.05)
    press("Shift+ArrowRight")
    assert moment(opened)["time"] == pytest.approx(1.05)
    press("n")
    assert moment(opened)["actor"] == 2
    press("p")
    assert moment(opened)["actor"] == 1
    press("3")
    assert moment(opened)["camera"] == "above"
    press("Space")
    assert moment(opened)["playing"]
    until(opened, "episodePage.moment.time > 1.1")
    press("Space")
    assert not moment(opened)["playing"]
    press("End")
    assert moment(opened)["time"] == pytest.approx(11.95)
    press("Home")
    assert moment(opened)["time"] == 0.0


@pytest.mark.parametrize("camera", ["follow", "above"])
def test_keys_turn_the_camera_and_bring_it_nearer(opened: OpenedPage, camera: str) -> None:
    opened.page.evaluate("camera => episodePage.useCamera(camera)", camera)
    pictures(opened)
    begin = opened.page.evaluate("episodePage.cameras.distance")
    opened.page.keyboard.press("w")
    opened.page.keyboard.press("a")
    pictures(opened)
    assert opened.page.evaluate("episodePage.cameras.distance") == pytest.approx(0.9 * begin, rel=0.02)


def test_the_chart_reads_what_is_chosen(opened: OpenedPage, record: EpisodeRecord) -> None:
    ttc_s, gap_m, delay_s = (values[record.rows_of(1)][40] for values in measures_of_emvs(record))
    assert ttc_s < 3.0 < gap_m
    opened.page.evaluate("episodePage.seek(2.0)")
    readings = {}
    for metric in ("gap of the EMV", "time to collision of the EMV", "delay of the EMV", "speed"):
        opened.page.select_option("#metric", metric)
        pictures(opened)
        readings[metric] = opened.page.locator("#reading").inner_text()
    assert list(readings.values()) == [f"{gap_m:.1f} m", f"{ttc_s:.2f} s", f"{delay_s:.1f} s", "50 km/h"]


def test_an_event_and_the_line_of_time_lead_to_their_moment(opened: OpenedPage, record: EpisodeRecord) -> None:
    event = next(event for event in record.events if event.kind.value == "yield_started")
    opened.page.locator("#all-events").evaluate("list => { list.parentElement.open = true; }")
    opened.page.locator("#all-events button").first.click()
    assert moment(opened)["time"] == pytest.approx(event.step * STEP_S)
    assert moment(opened)["actor"] == event.actor_id
    box = opened.page.locator("#chart").bounding_box()
    opened.page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 50)
    assert moment(opened)["time"] == pytest.approx(0.25 * 11.95, abs=0.05)


def test_the_predicates_moments_are_marked_and_lead_there(opened: OpenedPage, record: EpisodeRecord) -> None:
    changes = evaluate_predicate(record).parts[0]
    moments = [[moment.step, moment.actor_id] for moment in changes.moments]
    script = (
        "episodePage.episode.head.events.filter(e => e[1] === 'predicate.lane_changes' && e[5]).map(e => [e[0], e[2]])"
    )
    assert opened.page.evaluate(script) == moments
    assert changes.decisive is not None
    opened.page.locator("#verdict-details").evaluate("details => { details.open = true; }")
    opened.page.locator("#verdict-parts button").first.click()
    now = moment(opened)
    assert (now["time"], now["actor"]) == (pytest.approx(changes.decisive.step * STEP_S), changes.decisive.actor_id)
    assert "predicate: lane changes · 3 (needs >= 3)" in opened.page.locator("#own-events").inner_text()


def test_marks_and_texts_of_events_and_without_states_there_is_no_page(record: EpisodeRecord) -> None:
    kinds = (EventKind.COLLISION, EventKind.YIELD_RELEASED, EventKind.YIELD_REQUESTED)
    happened = tuple(Event(20 + step, kind, 2, 3) for step, kind in enumerate(kinds))
    head, _ = unpacked(episode_data(replace(record, events=happened)))
    marks = {kind: colour for _, kind, _, _, _, colour in head["events"]}
    assert [bool(marks[kind]) for kind in kinds] == [True, True, False]
    with pytest.raises(InputError, match="at least one recorded actor state"):
        episode_page(replace(record, states=()))
    event = Event(
        3, EventKind.LANE_CHANGE_STARTED, 1, detail={"reason": "a\u202eb\n", "signal_state": "", "way_m": 2.0}
    )
    actors = {key: replace(actor, name="\u202ecar") for key, actor in record.actors.items()}
    head, _ = unpacked(episode_data(replace(record, events=(event,), actors=actors)))
    bus = record.actors | {9: replace(record.actors[2], actor_id=9, actor_class=ActorClass.BUS)}
    _, columns = unpacked(episode_data(record, against=(record, replace(record, actors=bus))))
    assert {"shape.BUS.xyz", "shape.SEDAN.xyz"} <= columns.keys(), "shapes of actors of all episodes"
    assert (
        next(row[4] for row in head["events"] if row[1] == "lane_change_started") == "reason a\\u202eb\\n, distance 2 m"
    )
    assert {actor["name"] for actor in head["actors"]} == {"\\u202ecar"}


def test_a_link_carries_time_vehicle_and_camera(opened: OpenedPage) -> None:
    opened.page.evaluate("location.hash = '#t=4.5&v=3&c=orbit'")
    until(opened, "episodePage.moment.camera === 'orbit'")
    now = moment(opened)
    assert (now["time"], now["actor"]) == (4.5, 3)
    opened.page.keyboard.press("ArrowRight")
    assert opened.page.evaluate("location.hash") == "#t=4.55&v=3&c=orbit"
    opened.page.evaluate("location.hash = '#t=nonsense&v=99&c=moon'")
    assert moment(opened) == {**now, "time": 4.55}
    opened.page.keyboard.press("End")
    until(opened, "location.hash.startsWith('#t=11.95&')")


def test_reasons_stand_there_and_who_drives_without_them(opened: OpenedPage, record: EpisodeRecord) -> None:
    opened.page.evaluate("() => { episodePage.select(2); episodePage.seek(5.0); }")
    pictures(opened)
    assert not opened.page.locator("#why-not").is_visible()
    rows = opened.page.locator("#why-limits tr").all_inner_texts()
    assert [row.split("\t") for row in rows] == [["leader", "18.0 km/h", "sedan 3"], ["path", "32.4 km/h", ""]]
    assert opened.page.locator("#why-guards li").all_inner_texts() == ["– gap\nnone is free"]
    opened.page.locator("#why-limits button").click()
    pictures(opened)
    assert moment(opened)["actor"] == 3
    assert not opened.page.locator("#why-known").is_visible()
    assert opened.page.locator("#why-not").inner_text().startswith("SIREN does not decide for it now")
    told = {Owner.ROS: "none: it holds the brake", Owner.SUMO: "none: SUMO drives"}
    state = record.states[102]
    owners = dict(zip(state.actor_id.tolist(), map(Owner, state.owner.tolist()), strict=True))
    assert {owners[1], owners[2]} == set(told)
    for actor in (1, 2):
        opened.page.evaluate("id => { episodePage.select(id); episodePage.seek(5.1); }", actor)
        pictures(opened)
        assert opened.page.locator("#why-target").inner_text() == told[owners[actor]]


BEGIN = """() => {
    const page = episodePage;
    page.play(false);
    page.seek(0);
    page.select(1);
    page.useCamera("above");
    page.showOthers(true);
    page.showBeside(true);
}"""


@pytest.fixture(scope="module")
def plain_record(record_of: RecordOf) -> EpisodeRecord:
    return record_of(duration_s=12.0)


@pytest.fixture(scope="module")
def other(record_of: RecordOf) -> EpisodeRecord:
    """Six seconds in which nobody changes lanes, with the same actors."""
    return record_of(duration_s=6.0, changing=0)


@pytest.fixture(scope="module")
def elsewhere(record_of: RecordOf) -> EpisodeRecord:
    """The same on another map, with one vehicle more."""
    made = record_of(duration_s=6.0, changing=0, civilians=5)
    return replace(made, description=replace(made.description, map_sha256="1" * 64, map_name="moon"))


@pytest.fixture(scope="module")
def side_by_side(
    plain_record: EpisodeRecord,
    other: EpisodeRecord,
    elsewhere: EpisodeRecord,
    browser: PageBrowser,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[OpenedPage]:
    path = tmp_path_factory.mktemp("compared") / "episode.html"
    path.write_text(episode_page(plain_record, against=(other, elsewhere)), encoding="utf-8")
    with browser.opened(path) as page:
        until(page, "window.episodePage !== undefined")
        yield page
        assert page.problems == []


@pytest.fixture
def compared(side_by_side: OpenedPage) -> OpenedPage:
    """The page of the record against one on its map and one on another, the EMV selected, side by side."""
    side_by_side.page.set_viewport_size(VIEWPORT)
    side_by_side.page.evaluate(BEGIN)
    side_by_side.page.locator("#scene").focus()
    return side_by_side


def test_another_episode_is_drawn_where_it_differs(
    compared: OpenedPage, plain_record: EpisodeRecord, other: EpisodeRecord
) -> None:
    for step in (0, 60, 100, 119):
        script = "time => { episodePage.seek(time); return episodePage.drawnOthers()[0]; }"
        drawn = {row["id"]: (row["x"], row["y"]) for row in compared.page.evaluate(script, step * STEP_S)}
        here, there = plain_record.states[step], other.states[step]
        apart = np.hypot(here.x_m - there.x_m, here.y_m - there.y_m) >= 0.5
        assert sorted(drawn) == there.actor_id[apart].tolist()
        for row in np.flatnonzero(apart):
            assert drawn[there.actor_id[row]] == pytest.approx((there.x_m[row], there.y_m[row]), abs=0.01)
    assert apart.any()
    assert compared.page.evaluate("() => { episodePage.seek(10); return episodePage.drawnOthers(); }") == [[]]


def test_each_episode_has_a_picture_of_its_own(
    compared: OpenedPage, plain_record: EpisodeRecord, other: EpisodeRecord, elsewhere: EpisodeRecord
) -> None:
    compared.page.evaluate("episodePage.seek(5.0)")
    for picture, each in enumerate((plain_record, other, elsewhere)):
        drawn = {row["id"]: row for row in compared.page.evaluate("k => episodePage.drawn(k)", picture)}
        state = each.states[100]
        assert sorted(drawn) == state.actor_id.tolist()
        for row, actor_id in enumerate(state.actor_id.tolist()):
            assert abs(drawn[actor_id]["x"] - state.x_m[row]) < 0.01
            assert abs(drawn[actor_id]["y"] - state.y_m[row]) < 0.01
            assert abs(np.angle(np.exp(1j * (drawn[actor_id]["yaw"] - state.yaw_rad[row])))) < 0.001
    counted = compared.page.evaluate("episodePage.statistics()")
    assert counted["calls"] <= 150
    assert counted["triangles"] <= 300_000


@pytest.mark.parametrize("camera", ["above", "follow", "orbit"])
def test_all_cameras_see_the_vehicle_of_the_same_name(compared: OpenedPage, camera: str) -> None:
    compared.page.evaluate(
        "name => { episodePage.seek(5.5); episodePage.select(2); episodePage.useCamera(name); }", camera
    )
    pictures(compared)
    canvas = compared.page.locator("#scene").bounding_box()
    places = [compared.page.evaluate("k => episodePage.onScreen(2, k)", k) for k in range(3)]
    for k in (1, 2):
        assert places[k][0] - places[0][0] == pytest.approx(k * canvas["width"] / 3, abs=1.0)
        assert places[k][1] == pytest.approx(places[0][1], abs=1.0)


@pytest.mark.parametrize("tap", [False, True])
def test_a_click_or_tap_into_another_picture_selects_the_vehicle_of_that_name(compared: OpenedPage, tap: bool) -> None:
    compared.page.evaluate("episodePage.seek(0.5)")
    pictures(compared)
    press = compared.page.touchscreen.tap if tap else compared.page.mouse.click
    press(*compared.page.evaluate("episodePage.onScreen(3, 1)"))
    assert moment(compared)["actor"] == 3


def test_keys_and_buttons_choose_how_episodes_are_compared(compared: OpenedPage) -> None:
    compared.page.evaluate("episodePage.seek(5.5)")
    compared.page.keyboard.press("o")
    assert compared.page.evaluate("episodePage.drawnOthers()") == [[]]
    compared.page.click("#overlay")
    assert compared.page.evaluate("episodePage.drawnOthers()[0].length") > 0
    assert compared.page.evaluate("location.hash").endswith("&b=1")
    compared.page.keyboard.press("b")
    assert not moment(compared)["beside"]
    assert compared.page.locator("#labels b:visible").count() == 0
    assert "b=" not in compared.page.evaluate("location.hash")
    compared.page.click("#side")
    assert moment(compared)["beside"]
    assert compared.page.locator("#labels b:visible").count() == 2


def test_the_panel_says_what_a_vehicle_does_in_the_other_episodes(
    compared: OpenedPage, plain_record: EpisodeRecord, other: EpisodeRecord
) -> None:
    compared.page.evaluate("() => { episodePage.select(2); episodePage.seek(5.5); }")
    compared.page.select_option("#metric", "distance to the other episodes")
    pictures(compared)
    here, there = plain_record.states[110], other.states[110]
    row = here.actor_id.tolist().index(2)
    aside = here.y_m[row] - there.y_m[row]
    assert aside > 1.0
    texts = compared.page.locator("#facts-of-actor .elsewhere").all_inner_texts()
    does = f"{3.6 * there.speed_mps[row]:.1f} km/h, driving in traffic"
    assert texts == [f"{does}, {aside:.1f} m to the right", does]
    assert compared.page.locator("#reading").inner_text() == f"{aside:.1f} m"


def test_the_first_difference(compared: OpenedPage, plain_record: EpisodeRecord, other: EpisodeRecord) -> None:
    pairs = zip(plain_record.states, other.states, strict=False)
    apart = [np.hypot(here.x_m - there.x_m, here.y_m - there.y_m) for here, there in pairs]
    step = next(step for step, each in enumerate(apart) if each.max() > 0.0015)
    assert step > 0
    compared.page.locator("#other-list button").click()
    assert moment(compared)["time"] == pytest.approx(step * STEP_S)
    assert moment(compared)["actor"] == plain_record.states[step].actor_id[int(np.argmax(apart[step] > 0.0015))]
    assert "on another map" in compared.page.locator("#other-list").inner_text()
