"""Several episodes on one clock in the browser: as bodies in one picture, side by side, and how they differ."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from browser_pages import VIEWPORT, OpenedPage, PageBrowser
from episode_page.looked_at import moment, pictures, until

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.reports.episode_page.build import episode_page

RecordOf = Callable[..., EpisodeRecord]
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
def record(record_of: RecordOf) -> EpisodeRecord:
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
    record: EpisodeRecord,
    other: EpisodeRecord,
    elsewhere: EpisodeRecord,
    browser: PageBrowser,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[OpenedPage]:
    path = tmp_path_factory.mktemp("compared") / "episode.html"
    path.write_text(episode_page(record, against=(other, elsewhere)), encoding="utf-8")
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
    compared: OpenedPage, record: EpisodeRecord, other: EpisodeRecord
) -> None:
    for step in (0, 60, 100, 119):
        script = "time => { episodePage.seek(time); return episodePage.drawnOthers()[0]; }"
        drawn = {row["id"]: (row["x"], row["y"]) for row in compared.page.evaluate(script, step * STEP_S)}
        here, there = record.states[step], other.states[step]
        apart = np.hypot(here.x_m - there.x_m, here.y_m - there.y_m) >= 0.5
        assert sorted(drawn) == there.actor_id[apart].tolist()
        for row in np.flatnonzero(apart):
            assert drawn[there.actor_id[row]] == pytest.approx((there.x_m[row], there.y_m[row]), abs=0.01)
    assert apart.any()
    assert compared.page.evaluate("() => { episodePage.seek(10); return episodePage.drawnOthers(); }") == [[]]


def test_each_episode_has_a_picture_of_its_own(
    compared: OpenedPage, record: EpisodeRecord, other: EpisodeRecord, elsewhere: EpisodeRecord
) -> None:
    compared.page.evaluate("episodePage.seek(5.0)")
    for picture, each in enumerate((record, other, elsewhere)):
        drawn = {row["id"]: row for row in compared.page.evaluate("k => episodePage.drawn(k)", picture)}
        state = each.states[100]
        assert sorted(drawn) == state.actor_id.tolist()
        for row, actor_id in enumerate(state.actor_id.tolist()):
            assert abs(drawn[actor_id]["x"] - state.x_m[row]) < 0.01
            assert abs(drawn[actor_id]["y"] - state.y_m[row]) < 0.01
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


def test_a_vehicle_of_another_episode_alone_is_followed_there(compared: OpenedPage) -> None:
    compared.page.evaluate("() => { episodePage.seek(0.5); episodePage.select(5); }")
    pictures(compared)
    before = compared.page.evaluate("episodePage.onScreen(5, 0)")
    compared.page.mouse.click(*compared.page.evaluate("episodePage.onScreen(6, 2)"))
    pictures(compared)
    assert moment(compared)["actor"] == 5
    assert compared.page.evaluate("episodePage.onScreen(5, 0)") == pytest.approx(before, abs=1.0)
    canvas = compared.page.locator("#scene").bounding_box()
    x, y = compared.page.evaluate("episodePage.onScreen(6, 2)")
    assert x - before[0] == pytest.approx(2.0 * canvas["width"] / 3.0, abs=1.0)
    assert y == pytest.approx(before[1], abs=1.0)


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
    compared: OpenedPage, record: EpisodeRecord, other: EpisodeRecord
) -> None:
    compared.page.evaluate("() => { episodePage.select(2); episodePage.seek(5.5); }")
    compared.page.select_option("#metric", "distance to the other episodes")
    pictures(compared)
    here, there = record.states[110], other.states[110]
    row = here.actor_id.tolist().index(2)
    aside = here.y_m[row] - there.y_m[row]
    assert aside > 1.0
    texts = compared.page.locator("#facts-of-actor .elsewhere").all_inner_texts()
    does = f"{3.6 * there.speed_mps[row]:.1f} km/h, driving in traffic"
    assert texts == [f"{does}, {aside:.1f} m to the right", does]
    assert compared.page.locator("#reading").inner_text() == f"{aside:.1f} m"


def test_the_first_difference_leads_to_its_moment(
    compared: OpenedPage, record: EpisodeRecord, other: EpisodeRecord
) -> None:
    pairs = zip(record.states, other.states, strict=False)
    apart = [np.hypot(here.x_m - there.x_m, here.y_m - there.y_m) for here, there in pairs]
    step = next(step for step, each in enumerate(apart) if each.max() > 0.0015)
    assert step > 0
    compared.page.locator("#other-list button").click()
    assert moment(compared)["time"] == pytest.approx(step * STEP_S)
    assert moment(compared)["actor"] == record.states[step].actor_id[int(np.argmax(apart[step] > 0.0015))]
    assert "on another map" in compared.page.locator("#other-list").inner_text()


def test_pictures_stand_above_each_other_where_it_is_narrow(compared: OpenedPage) -> None:
    compared.page.set_viewport_size({"width": 360, "height": 740})
    pictures(compared)
    canvas = compared.page.locator("#scene").bounding_box()
    places = [compared.page.evaluate("k => episodePage.onScreen(3, k)", k) for k in range(3)]
    assert [int((y - canvas["y"]) / (canvas["height"] / 3)) for _, y in places] == [0, 1, 2]
    assert compared.page.evaluate("document.documentElement.scrollWidth") <= 360
