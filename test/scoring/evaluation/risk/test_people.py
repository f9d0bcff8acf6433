import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.cli.main import main
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import RiskClass
from siren_ros.scoring.evaluation.risk.people import blind_name, cohens_kappa, consensus, read_rating, write_rating_page

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


@given(st.text("NMC", min_size=2, max_size=12).filter(lambda text: len(set(text)) > 1))
def test_who_agrees_always_has_one(text):
    assert cohens_kappa(rated(text), rated(text)).value == pytest.approx(1.0)


def test_one_class_alone_and_no_common_video_have_no_kappa():
    assert not cohens_kappa(rated("NNN"), rated("NNN")).valid
    assert not cohens_kappa(rated("N-"), {"1": N}).valid
    assert not cohens_kappa({}, {}).valid


def test_most_people_decide_and_the_severe_one_breaks_a_tie():
    assert consensus([rated("NMC"), rated("NNC"), rated("MC-")]) == {"0": N, "1": C, "2": C}
    assert consensus([rated("NM"), rated("MN")]) == {"0": M, "1": M}


def items_of(page):
    text = (page.parent / "index.html").read_text()
    return json.loads(re.search('id="items">(.*?)</script>', text, re.DOTALL)[1].replace("<\\/", "</"))["items"]


@pytest.mark.parametrize("pictures", [False, True])
def test_the_page_tells_nothing_about_a_video(drawn, tmp_path, pictures):
    page = write_rating_page(drawn, "anna", tmp_path / "page", pictures=pictures)
    items = items_of(page)
    assert len(items) == len(drawn.videos)
    assert {item["id"] for item in items} == {blind_name("anna", key) for key in drawn.videos}
    assert all((page.parent / name).is_file() for item in items for name in item["files"])
    assert [len(item["files"]) for item in items] == [9 if pictures else 1] * 6
    text = page.read_text() + " ".join(path.name for path in page.parent.iterdir())
    assert not any(key in text for key in (*drawn.videos, "S4", "S6"))


def test_another_person_has_another_order(drawn, tmp_path):
    def order(rater):
        names = {blind_name(rater, key): key for key in drawn.videos}
        return [names[item["id"]] for item in items_of(write_rating_page(drawn, rater, tmp_path / rater))]

    assert order("anna") != order("ben")
    assert sorted(order("cem")) == sorted(drawn.videos)


@pytest.mark.parametrize("rater", ["", "a b", "../a"])
def test_names_that_are_no_files_are_refused(drawn, tmp_path, rater):
    with pytest.raises(InputError, match="rater"):
        write_rating_page(drawn, rater, tmp_path / "page")


def test_a_folder_with_files_is_refused(drawn, tmp_path):
    with pytest.raises(InputError, match="empty"):
        write_rating_page(drawn, "anna", tmp_path / "videos")


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
    words = [
        "evaluate",
        "risk",
        str(tmp_path),
        "--references",
        "majority",
        "template_prior",
        "--people",
        *map(str, files),
    ]
    assert main(words) == 0
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
