"""Moments of a study's episodes that its page shows."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from browser_pages import PageBrowser

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.reports.study_report.page import EpisodePages, Page, html_of
from siren_ros.reports.study_report.study import MOST, Kind, Notable, moments_section, notable_moments
from siren_ros.scoring.judging.outcome import evaluate_predicate
from siren_ros.simulation.world.actors import Event, EventKind

RecordOf = Callable[..., EpisodeRecord]


def found(record: EpisodeRecord) -> dict[Kind, Notable]:
    return {notable.kind: notable for notable in notable_moments(record)}


def test_the_hardest_contact_is_named(record_of: RecordOf) -> None:
    events = [
        Event(10 * k, EventKind.COLLISION, k, 3, detail={"impact_speed_mps": v})
        for k, v in ((1, 0.5), (2, 4.25), (4, 1))
    ]
    contact = found(replace(record_of(duration_s=2.0), events=tuple(events)))[Kind.CONTACT]
    assert (contact.step, contact.actor_id, contact.rank) == (20, 2, -4.25)
    assert contact.text == "contact with 3 at 4.2 m/s, the hardest of 3"


def test_a_failure_is_named_at_the_templates_own_level_alone(record_of: RecordOf) -> None:
    record = record_of(changing=1)
    (part, _) = evaluate_predicate(record).failing
    assert part.decisive is not None
    failure = found(record)[Kind.FAILURE]
    assert (failure.step, failure.actor_id, failure.text) == (part.decisive.step, part.decisive.actor_id, str(part))
    assert Kind.FAILURE not in found(record_of(changing=1, level="L1"))
    assert Kind.FAILURE not in found(record_of())


def test_the_closest_call_is_the_least_time_to_collision(record_of: RecordOf) -> None:
    """The EMV (6.2 m, from x 10 m at 14 m/s) comes up behind a car (4.6 m, from x 40 m at 6 m/s) until they touch."""
    close = found(record_of(duration_s=4.0, changing=0))[Kind.CLOSE]
    assert close.actor_id == 1
    assert close.step * 0.05 == pytest.approx((30.0 - (6.2 + 4.6) / 2.0) / 8.0, abs=0.06)
    assert close.text == "least TTC of the EMV, 0.00 s to 2"
    assert notable_moments(replace(record_of(duration_s=1.0), states=())) == ()


def test_the_worst_come_first_and_the_others_are_counted() -> None:
    ranked = [(Path(f"bag{n}"), Notable(Kind.CONTACT, f"at rank {n}", 20 * n, 3, float(n))) for n in range(23)]
    close = [(Path(f"bag{n}"), Notable(Kind.CLOSE, "close", 7, 1, float(-n))) for n in range(9)]
    section = moments_section([*close, *reversed(ranked)], EpisodePages(Path("pages"), 1, {Path("bag0"), Path("bag1")}))
    assert section is not None
    assert len(section.links) == MOST[Kind.CONTACT] + MOST[Kind.CLOSE]
    assert section.links[0].text == "bag0, 0.00 s, vehicle 3: at rank 0"
    assert [link.address for link in section.links[:2]] == ["pages/bag0.html#t=0&v=3", ""]
    assert section.links[1].command == "./env siren view bag1 --time-s 1 --actor 3"
    assert section.links[20].text.startswith("bag8, "), "the least time first"
    assert section.text[1] == "3 more are not named."
    assert moments_section([], EpisodePages(Path("pages"), 1, set())) is None


def test_names_stay_text_in_links(browser: PageBrowser, tmp_path: Path) -> None:
    hostile = Path("\"><script>document.title='taken'<")
    notable = Notable(Kind.CONTACT, "<img src=x onerror=\"document.title='taken'\">", 4, 1, 0.0)
    section = moments_section([(hostile, notable), (Path("b"), notable)], EpisodePages(tmp_path / "p'\"", 1, {hostile}))
    assert section is not None
    (tmp_path / "page.html").write_text(html_of(Page("study", "", [section])), encoding="utf-8")
    with browser.opened(tmp_path / "page.html") as opened:
        assert opened.page.title() == "study"
        assert opened.page.locator("main img").count() == 0
        assert opened.page.locator(".moments a").inner_text() == f"{hostile}, 0.20 s, vehicle 1: {notable.text}"


def test_a_link_opens_the_episode_at_its_moment(made: SimpleNamespace, browser: PageBrowser) -> None:
    link = next(link for link in made.page.sections[2].links if link.address)
    with browser.opened(made.file) as opened:
        opened.page.click("#section_moments a >> nth=0")
        opened.page.wait_for_url("**/my%20%231%20pages/*")
        opened.page.locator("#wait").wait_for(state="hidden")
        now = opened.page.evaluate("episodePage.moment")
        assert f"#t={now['time']:g}&v={now['actor']}" == link.address[link.address.index("#") :]
        assert opened.problems == []
        (asked,) = opened.requests
        assert asked.endswith(link.address.split("#")[0]), "and nothing else"
