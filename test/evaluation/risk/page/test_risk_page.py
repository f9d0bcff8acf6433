"""The page in a real browser: videos play, charts are drawn, the filter filters, nothing comes from a network."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser_pages import OpenedPage, PageBrowser
from evaluation.made_video_sets import small_video_set

from siren_ros.evaluation.risk.page.risk_page import write_page
from siren_ros.evaluation.risk.references import oracle
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.scoring import score_answers
from siren_ros.evaluation.risk.video_set import VideoSet
from siren_ros.pictures.video import write_video

ODD = 'my <b>"model"</b>'


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> VideoSet:
    """Six videos, one with a name that an address has to quote; the file of the last one is missing."""
    folder = tmp_path_factory.mktemp("set of videos")
    made = small_video_set(folder)
    first, *_, last = made.videos
    renamed = {**made.videos, first: replace(made.videos[first], file="videos/a %23#.mp4")}
    for key, video in renamed.items():
        if key != last:
            write_video(folder / video.file, (np.full((48, 64, 3), number, np.uint8) for number in range(190)))
    return replace(made, videos=renamed)


@pytest.fixture(scope="module")
def path(videos: VideoSet) -> Path:
    answers = {
        "oracle": oracle(videos),
        ODD: {"S4_000": RiskClass.NORMAL, "S4_001": None, "S4_002": RiskClass.COLLISION},
    }
    page = videos.folder.parent / "pages" / "risk.html"
    write_page(page, videos, answers, [score_answers(name, videos, given) for name, given in answers.items()])
    return page


@pytest.fixture
def opened(browser: PageBrowser, path: Path) -> Iterator[OpenedPage]:
    with browser.opened(path) as page:
        yield page


def shown(opened: OpenedPage) -> list[str]:
    return opened.page.eval_on_selector_all(".card", "cards => cards.filter(c => !c.hidden).map(c => c.id)")


def test_every_video_plays_and_nothing_else_is_asked_for(opened: OpenedPage) -> None:
    assert opened.unplayable_videos() == []
    assert opened.page.locator("video").count() == 5
    assert opened.page.locator("#S6_005 .missing").inner_text() == "The video's file is missing."
    assert all(url.startswith("file:") and url.endswith(".mp4") for url in opened.requests)
    # A browser breaks a request off when it has read as much of a video as it needs.
    assert [problem for problem in opened.problems if ".mp4" not in problem] == []


def test_labels_and_answers_are_shown(opened: OpenedPage) -> None:
    heading = opened.page.locator("#S6_005 h2").inner_text()
    assert "Collision" in heading
    assert "contact at 3.5 m/s at 1.4 s" in heading
    assert opened.table("#S4_002 .answers") == [["oracle", "Near-Miss", "right"], [ODD, "Collision", "wrong"]]
    assert opened.table("#S4_001 .answers")[1] == [ODD, "unreadable", "wrong"]
    assert opened.table("#S6_003 .answers")[1] == [ODD, "none", ""]
    assert opened.table("#models")[1][:3] == ["oracle", "6 / 6", "100.0 %"]


def test_the_filter_shows_what_is_asked_for(opened: OpenedPage) -> None:
    assert len(shown(opened)) == 6
    opened.page.select_option("select[name=label]", "Near-Miss")
    assert shown(opened) == ["S4_002", "S6_004"]
    opened.page.select_option("select[name=template]", "S6")
    assert shown(opened) == ["S6_004"]
    opened.page.select_option("select[name=verdict]", "wrong")
    assert shown(opened) == []
    assert opened.page.locator("#nothing").is_visible()
    opened.page.select_option("select[name=model]", "1")
    assert shown(opened) == ["S6_004"]
    assert opened.page.locator("#shown").inner_text() == "1 of 6"


def test_the_button_goes_to_the_moment_and_the_charts_follow(opened: OpenedPage) -> None:
    opened.page.evaluate("document.querySelectorAll('video').forEach(video => video.play = () => {})")
    card = opened.page.locator("#S6_004")
    card.locator("svg").first.click(position={"x": 300, "y": 40})
    opened.page.wait_for_function("document.querySelector('#S6_004 video').currentTime > 5")
    opened.page.wait_for_function("document.querySelector('#S6_004 line.now').style.opacity === '1'")
    at, x = opened.page.evaluate(
        "[document.querySelector('#S6_004 video').currentTime,"
        " Number(document.querySelector('#S6_004 line.now').getAttribute('x1'))]"
    )
    assert x == pytest.approx(at / 19 * 380, abs=1.0)
    card.locator("button").click()
    opened.page.wait_for_function("document.querySelector('#S6_004 video').currentTime < 1")
