"""People who label videos: their answers, and the page on which they give them."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser_pages import OpenedPage, PageBrowser
from evaluation.made_video_sets import evidence, small_video_set
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from siren_ros.cli.main import main
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import (
    Evidence,
    Moments,
    RiskClass,
    RiskThresholds,
    SeenEncroachment,
    label_of,
)
from siren_ros.scoring.evaluation.risk.people import blind_name, cohens_kappa, consensus, read_rating, write_rating_page
from siren_ros.scoring.evaluation.risk.report import HEIGHT, WIDTH, charts_of, curves_of, save_confusions, write_page
from siren_ros.scoring.evaluation.risk.scoring import ModelScores, oracle, score_answers
from siren_ros.scoring.evaluation.risk.video_set import RiskVideo, VideoSet
from siren_ros.scoring.pictures.video import write_video

N, M, C = RiskClass


def rated(text):
    return {str(number): {"N": N, "M": M, "C": C, "-": None}[letter] for number, letter in enumerate(text)}


def test_kappa_of_cohens_kind():
    """Of 50 + 50 videos 20 + 15 agree: 0.7 by observation, 0.5 by chance, κ 0.4 (a textbook's table)."""
    first = rated("N" * 20 + "N" * 5 + "M" * 10 + "M" * 15)
    second = rated("N" * 20 + "M" * 5 + "N" * 10 + "M" * 15)
    kappa = cohens_kappa(first, second)
    assert kappa.value == pytest.approx(0.4)
    assert kappa.low < 0.4 < kappa.high
    for pair in ((rated("NNN"), rated("NNN")), (rated("N-"), {"1": N}), ({}, {})):
        assert not cohens_kappa(*pair).valid, "one class alone, or no common video"


@given(st.text("NMC", min_size=2, max_size=12).filter(lambda text: len(set(text)) > 1))
def test_who_agrees_always_has_one(text):
    assert cohens_kappa(rated(text), rated(text)).value == pytest.approx(1.0)


def test_most_people_decide_and_the_severe_one_breaks_a_tie():
    assert consensus([rated("NMC"), rated("NNC"), rated("MC-")]) == {"0": N, "1": C, "2": C}
    assert consensus([rated("NM"), rated("MN")]) == {"0": M, "1": M}


def items_of(page):
    text = (page.parent / "index.html").read_text()
    return json.loads(re.search('id="items">(.*?)</script>', text, re.DOTALL)[1].replace("<\\/", "</"))["items"]


@pytest.mark.parametrize("pictures", [False, True])
def test_the_page_tells_nothing_about_a_video_and_each_person_has_another_order(drawn, tmp_path, pictures):
    orders = []
    for rater in ("anna", "ben"):
        page = write_rating_page(drawn, rater, tmp_path / rater, pictures=pictures)
        items = items_of(page)
        names = {blind_name(rater, key): key for key in drawn.videos}
        orders.append([names[item["id"]] for item in items])
        assert all((page.parent / name).is_file() for item in items for name in item["files"])
        assert [len(item["files"]) for item in items] == [9 if pictures else 1] * 6
        text = page.read_text() + " ".join(path.name for path in page.parent.iterdir())
        assert not any(key in text for key in (*drawn.videos, "S4", "S6"))
    assert orders[0] != orders[1]
    assert sorted(orders[0]) == sorted(orders[1]) == sorted(drawn.videos)


def test_names_that_are_no_files_and_a_folder_with_files_are_refused(drawn, tmp_path):
    for rater, folder, told in (("", "page", "rater"), ("../a b", "page", "rater"), ("anna", "videos", "empty")):
        with pytest.raises(InputError, match=told):
            write_rating_page(drawn, rater, tmp_path / folder)


def saved(path, drawn, rater, wrong=()):
    answers = {
        blind_name(rater, key): "Normal" if key in wrong else video.label.risk.title
        for key, video in drawn.videos.items()
    }
    path.write_text(json.dumps({"rater": rater, "answers": answers}))
    return path


def test_answers_come_back_by_the_ids_of_the_set(drawn, tmp_path):
    rater, answers = read_rating(saved(tmp_path / "a.json", drawn, "anna"), drawn)
    assert rater == "anna"
    assert answers == {key: video.label.risk for key, video in drawn.videos.items()}
    for content in ({"rater": "ben", "answers": {blind_name("anna", "S4_000"): "Normal"}}, {"answers": {}}, []):
        (tmp_path / "b.json").write_text(json.dumps(content))
        with pytest.raises(InputError, match="people"):
            read_rating(tmp_path / "b.json", drawn)


def test_people_have_a_row_and_kappas(drawn, tmp_path, capsys):
    files = [saved(tmp_path / "a.json", drawn, "anna"), saved(tmp_path / "b.json", drawn, "ben", ("S6_004",))]
    references = "--references", "majority", "template_prior"
    assert main(["evaluate", "risk", str(tmp_path), *references, "--people", *map(str, files)]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = {line.split()[0]: line for line in reversed(lines) if line.strip()}
    assert "100.00" in rows["people"]
    assert "83.33" in rows["ben"]
    assert any(line.startswith("anna") and "labels" in line and "1.00" in line for line in lines)


@pytest.mark.usefixtures("drawn")
def test_the_page_keeps_answers_and_goes_on(tmp_path, browser):
    """In a browser: a key chooses, the page goes on to the next video, and a new visit begins where it was."""
    assert main(["rate", str(tmp_path), "--rater", "anna", "--key-frames", "--out", str(tmp_path / "page")]) == 0
    items = items_of(tmp_path / "page" / "index.html")
    with browser.opened(tmp_path / "page" / "index.html") as opened:
        opened.page.keyboard.press("2")
        opened.page.click("button[data-class=Collision]")
        assert "Video 3 of 6, 2 answered" in opened.page.inner_text("#progress")
        opened.page.reload()
        assert "Video 3 of 6, 2 answered" in opened.page.inner_text("#progress")
        with opened.page.expect_download() as download:
            opened.page.click("#save")
        content = json.loads(download.value.path().read_text())
    assert content["answers"] == {items[0]["id"]: "Near-Miss", items[1]["id"]: "Collision"}


LIMITS = RiskThresholds()


def video_of(found: Evidence, first_step: int = 20) -> RiskVideo:
    return RiskVideo("S4_000", "S4", "a.mp4", 190, first_step, label_of(found, LIMITS), found, {})


def moments(*rows: tuple[int, int, float, float, float, float]) -> Evidence:
    step, actor, *values = (np.array(column) for column in zip(*rows, strict=True))
    return Evidence(Moments(step, actor.astype(np.uint32), *values, np.zeros(len(step))), (), ())


def test_time_begins_with_the_first_frame_and_ends_with_the_last() -> None:
    curves = curves_of(video_of(evidence("Collision")), LIMITS)
    assert (len(curves.time_s), curves.time_s[0], curves.time_s[-1]) == (380, 0.0, pytest.approx(18.95))
    assert np.flatnonzero(np.isfinite(curves.time_to_collision_s)).tolist() == list(range(20, 28))
    assert curves.moment_s == pytest.approx((48 - 20) * 0.05)
    assert [(dot.at_s, dot.value) for dot in curves.contacts] == [(pytest.approx(1.4), 3.5)]
    assert [(dot.at_s, dot.value) for dot in curves.encroachments] == [(pytest.approx(2.0), 2.5)]
    found = moments(*((step, 1, 1.0, 3.0, 1.0, 5.0) for step in (19, 20, 399, 400)))
    known = np.flatnonzero(np.isfinite(curves_of(video_of(found), LIMITS).time_to_collision_s))
    assert known.tolist() == [0, 379]


def test_the_most_critical_of_those_who_count_is_drawn() -> None:
    found = moments(
        # step, actor, TTC, closing, DRAC, gap: one closes too slowly, one is too far for its deceleration to count
        (30, 1, 0.5, 0.9, 2.0, 5.0),
        (30, 2, 2.0, 3.0, 1.0, 6.0),
        (30, 3, 1.8, 9.0, 8.0, 10.0),
    )
    curves = curves_of(video_of(found), LIMITS)
    assert curves.time_to_collision_s[10] == 1.8
    assert curves.required_deceleration_mps2[10] == 2.0
    assert curves.moment_s is None


def test_charts_keep_their_scale_and_lift_the_pen() -> None:
    found = moments(*((step, 1, value, 3.0, 20.0, 5.0) for step, value in ((20, 5.0), (21, 2.5), (210, 9.0))))
    ttc, pet, drac = charts_of(curves_of(video_of(found), LIMITS), LIMITS)
    assert ttc.path == f"M0.0 0.0h0.6L1.0 {HEIGHT / 2:.1f}M{WIDTH / 2:.1f} 0.0h0.6"
    assert ttc.limit_y == pytest.approx(HEIGHT * 0.7)
    assert ttc.extreme == "2.50 s at 0.1 s"
    assert (pet.path, pet.dots, pet.extreme) == ("", (), "")
    soon, late = (
        SeenEncroachment(number, step, time_s, 0.0, 0.0) for number, step, time_s in ((2, 40, 0.8), (3, 60, 2.5))
    )
    for order in (1, -1):
        _, pet, _ = charts_of(curves_of(video_of(replace(found, encroachments=(soon, late)[::order])), LIMITS), LIMITS)
        assert pet.extreme == "0.80 s at 1.0 s"
        assert sorted(text for *_, text in pet.dots) == ["0.80 s at 1.0 s", "2.50 s at 2.0 s"]
    assert drac.extreme == "20.00 m/s² at 0.0 s"
    assert drac.path.startswith("M0.0 0.0")


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


def shown(opened: OpenedPage) -> list[str]:
    return opened.page.eval_on_selector_all(".card", "cards => cards.filter(c => !c.hidden).map(c => c.id)")


def test_the_page_of_a_set_in_a_browser(browser: PageBrowser, path: Path) -> None:
    """Every video plays, answers stand next to labels, the filter shows what is asked for, the charts follow."""
    with browser.opened(path) as opened:
        page = opened.page
        assert opened.unplayable_videos() == []
        assert page.locator("video").count() == 5
        assert page.locator("#S6_005 .missing").inner_text() == "The video's file is missing."
        assert "contact at 3.5 m/s at 1.4 s" in page.locator("#S6_005 h2").inner_text()
        assert opened.table("#S4_002 .answers") == [["oracle", "Near-Miss", "right"], [ODD, "Collision", "wrong"]]
        assert opened.table("#S4_001 .answers")[1] == [ODD, "unreadable", "wrong"]
        assert opened.table("#S6_003 .answers")[1] == [ODD, "none", ""]
        assert opened.table("#models")[1][:3] == ["oracle", "6 / 6", "100.0 %"]

        page.evaluate("document.querySelectorAll('video').forEach(video => video.play = () => {})")
        card = page.locator("#S6_004")
        card.locator("svg").first.click(position={"x": 300, "y": 40})
        page.wait_for_function("document.querySelector('#S6_004 video').currentTime > 5")
        page.wait_for_function("Number(document.querySelector('#S6_004 line.now').getAttribute('x1')) > 0")
        at, x = page.evaluate(
            "[document.querySelector('#S6_004 video').currentTime,"
            " Number(document.querySelector('#S6_004 line.now').getAttribute('x1'))]"
        )
        assert x == pytest.approx(at / 19 * 380, abs=1.0)
        card.locator("button").click()
        page.wait_for_function("document.querySelector('#S6_004 video').currentTime < 1")

        assert len(shown(opened)) == 6
        for select, option, left in (
            ("label", "Near-Miss", ["S4_002", "S6_004"]),
            ("template", "S6", ["S6_004"]),
            ("verdict", "wrong", []),
            ("model", "1", ["S6_004"]),
        ):
            page.select_option(f"select[name={select}]", option)
            assert shown(opened) == left
        assert page.locator("#shown").inner_text() == "1 of 6"
        assert all(url.startswith("file:") and url.endswith(".mp4") for url in opened.requests)
        # A browser breaks a request off when it has read as much of a video as it needs.
        assert [problem for problem in opened.problems if ".mp4" not in problem] == []


def test_confusions_are_shares_of_each_label(figures: list[Figure]) -> None:
    counts = np.array([[7, 3, 0, 0], [1, 1, 0, 2], [0, 0, 0, 0]])
    save_confusions(ModelScores("mine", 14, 14, counts, {"S0": 2 * counts}), Path("a.png"))
    first, second = [axes for axes in figures[0].axes if axes.get_visible()]
    assert (first.get_title(), second.get_title()) == ("all templates (n = 14)", "S0 (n = 28)")
    shares = np.array([[0.7, 0.3, 0.0, 0.0], [0.25, 0.25, 0.0, 0.5], [0.0] * 4])
    assert np.asarray(first.images[0].get_array()) == pytest.approx(shares)
    told = {text.get_position(): text.get_text() for text in first.texts}
    # Column, row.
    assert {(column, row): str(counts[row, column]) for row in range(3) for column in range(4)} == told
