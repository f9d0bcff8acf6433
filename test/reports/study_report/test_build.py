"""The page of a small study: in a browser, and its numbers against those of the commands that it names."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from browser_pages import PageBrowser

from siren_ros.cli.evaluation import yielding
from siren_ros.cli.evaluation.yielding import score_bag
from siren_ros.cli.main import main
from siren_ros.errors import InputError
from siren_ros.reports.study_report.build import build_page, detection_section
from siren_ros.reports.study_report.episode_sections import chosen_episodes
from siren_ros.reports.study_report.study import PageOptions, measure_study
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.scoring.evaluation.prediction.reports.report import prediction_tables, text_report
from siren_ros.scoring.evaluation.prediction.reports.score_table import differences, score_table
from siren_ros.scoring.evaluation.prediction.scoring import ScoringJob, score_bags
from siren_ros.scoring.evaluation.yielding.metrics import EPISODE_METRICS, PEOPLE_METRICS
from siren_ros.scoring.evaluation.yielding.scoring import ScoredEpisode, group_means


def test_the_page_opens_in_a_browser_without_network_or_complaint(made: SimpleNamespace, browser: PageBrowser) -> None:
    with browser.opened(made.file) as opened:
        assert opened.problems == []
        assert opened.requests == []
        opened.page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
        assert opened.page.locator("img").count() >= 8
        assert opened.empty_images() == []
        assert opened.page.locator("video").count() == 1
        assert opened.unplayable_videos() == []
        targets = opened.page.evaluate("[...document.querySelectorAll('nav a')].map(a => a.getAttribute('href'))")
        assert targets == [f"#section_{section.key}" for section in made.page.sections]
        for key, table in made.tables.items():
            shown = opened.table(f"#{key}")
            assert shown == [list(table.head), *map(list, table.cells())], key
        ids = opened.page.evaluate("[...document.querySelectorAll('[id]')].map(one => one.id)")
        assert len(ids) == len(set(ids))


def test_what_is_written_into_the_page_stays_text(made: SimpleNamespace) -> None:
    content = made.file.read_text(encoding="utf-8")
    assert "no site on &lt;this&gt; map" in content
    assert "<this>" not in content
    assert not re.search(r"(?:src|href)=\"(?!data:|#|my%20%231%20pages/)", content), "the rest is inside the file"


def test_the_page_names_the_map_of_its_figures(made: SimpleNamespace) -> None:
    assert made.page.lead.startswith("5 episodes of S2 at L1, L2, L3 on town. ")
    (section,) = [section for section in made.page.sections if section.key == "next_to_the_paper"]
    assert "; map: straight (2); the paper's is Town10HD_Opt. " in section.text[0]


def test_the_sections_are_in_the_order_of_a_reader(made: SimpleNamespace) -> None:
    keys = [section.key for section in made.page.sections]
    assert keys[:5] == ["generated", "scenes", "moments", "making_way", "effects"]
    assert keys[5:] == ["prediction", "detection", "risk", "next_to_the_paper", "diversity"]


def test_the_paper_is_held_against_the_episodes_at_their_own_level(made: SimpleNamespace) -> None:
    table = made.tables["next_to_the_paper_paper_0"]
    assert (table.caption, table.head) == ("ADE in m", ("", "S2", "mean"))
    paper, ours, *_ = table.cells()
    at_own = [one for one in made.measures.prediction if one.level.name == "L2"]
    values = np.concatenate([one.models["cv"].values["ade_m"] for one in at_own])
    assert paper == ("CV, paper", "1.17", "1.44")
    assert ours[0] == "CV, here"
    assert ours[1] == f"{values.mean():.2f}"


def test_every_episode_is_told_and_what_is_missing_has_its_reason(made: SimpleNamespace) -> None:
    rows = {row[:2]: row for row in made.tables["generated_groups"].cells()}
    assert rows["S2", "L1"][3:6] == ("2", "2 of 2", "0 of 2 [–]")
    assert rows["S2", "L2 (own)"][3:6] == ("2", "2 of 2", "2 of 2 [–]"), "with the row that the table lacks"
    assert rows["S2", "L3"][4] == "0 of 1"
    assert made.tables["generated_missing"].cells() == [("S2_L3_seed0", "refused", "no site on <this> map", "1")]


def test_what_is_measured_is_what_the_commands_measure(made: SimpleNamespace) -> None:
    one = made.measures.bags[0]
    (scored,) = score_bag(one.bag)
    assert isinstance(scored, ScoredEpisode)
    assert scored.row() == one.yielding.row()
    (result,) = score_bags(ScoringJob(("cv", "idm")), [one.bag])
    assert result.scores is not None
    for model, scores in result.scores.models.items():
        assert np.array_equal(scores.values["ade_m"], one.prediction.models[model].values["ade_m"])


def test_yield_metrics_are_those_that_the_command_prints(
    made: SimpleNamespace, study: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(yielding, "scored_episodes", lambda *_: (list(made.measures.yielding), 0))
    assert main(["evaluate", "yield", str(study)]) == 0
    printed = capsys.readouterr().out.splitlines()
    means = group_means(made.measures.yielding)
    table = made.tables["making_way_S2"]
    assert printed[: len(table.text())] == table.text()
    assert table.head == ("metric", "L1", "L2", "meaning")
    assert len(table.rows) == len(EPISODE_METRICS) - len(PEOPLE_METRICS)
    for name, *cells, _ in table.cells():
        for level, cell in zip(("L1", "L2"), cells, strict=True):
            mean = means["S2", level, "straight"][name]
            assert cell.split(" ")[0] == (f"{mean.value:.2f}" if mean.valid else "–")


def test_prediction_is_what_the_command_prints(made: SimpleNamespace) -> None:
    scores = score_table(made.measures.prediction)
    tables = prediction_tables(scores, differences(scores))
    lines = text_report(scores, tables)
    shown = [table for table in tables if not table.folded]
    assert shown
    for table in shown:
        assert made.tables[f"prediction_{table.key}"] == table
        start = lines.index(table.caption)
        assert lines[start : start + len(table.text())] == table.text()


def test_effects_are_paired_over_the_seeds(made: SimpleNamespace) -> None:
    (row,) = made.tables["effects_emv_delay_s"].cells()
    first, second = (
        [one.scores.metrics["emv_delay_s"].value for one in made.measures.yielding if one.level == level]
        for level in ("L2", "L1")
    )
    assert row[:2] == ("L2 − L1", "S2")
    assert float(row[2].split(" ")[0]) == pytest.approx(sum(first) / 2 - sum(second) / 2, abs=0.005)
    assert row[5] == "2"


def test_scores_of_other_commands_are_read(made: SimpleNamespace) -> None:
    assert made.tables["detection_by_template"].cells() == [
        ("made", "0.312/0.438", "0.312/0.438"),
        ("made, 95 % of mAP", "[0.250, 0.375]", "[0.250, 0.375]"),
    ]
    assert made.tables["detection_parts"].cells() == [("EMV", "the EMV", "12", "0.312 [0.250, 0.375]")]
    (row,) = made.tables["risk_scores"].cells()
    assert row[:3] == ("made", "4/5", "50.00 [–]")
    assert made.tables["risk_confusion"].cells()[2] == ("made", "Collision", "0", "0", "0", "1")


def test_a_bag_that_cannot_be_read_does_not_hold_up_the_others(study: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad"
    bad.mkdir()
    good = next(study.glob("episodes/S2_L1/*/"))
    found = measure_study([bad, good], ("cv",), 1)
    assert [bag for bag, _ in found.unread] == [bad]
    assert [one.bag for one in found.bags] == [good]
    with pytest.raises(InputError, match="can be read"):
        measure_study([bad], ("cv",), 1)


def test_a_folder_without_study_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="siren generate"):
        build_page(tmp_path, PageOptions())


@pytest.mark.parametrize("task", ["detection", "risk"])
def test_a_folder_without_the_scores_that_were_asked_for_is_refused(study: Path, tmp_path: Path, task: str) -> None:
    """Where nothing is asked for, the page has no such section."""
    with pytest.raises(InputError, match=f"siren evaluate {task} --out"):
        build_page(study, PageOptions(**{task: tmp_path}))
    PageOptions().check()
    (tmp_path / "scores.json").write_text("{}", encoding="utf-8")
    PageOptions(**{task: tmp_path}).check()


def test_scores_that_are_none_are_refused(study: Path, tmp_path: Path, made: SimpleNamespace) -> None:
    for content in ("[]", "nonsense", '{"a": {}}'):
        (tmp_path / "scores.json").write_text(content, encoding="utf-8")
        with pytest.raises(InputError, match="siren evaluate"):
            detection_section(made.rows, tmp_path)
    assert detection_section(made.rows, study / "episodes") is None


def test_the_shown_episode_is_at_its_own_level_with_a_predicate_that_holds(made: SimpleNamespace) -> None:
    complete: list[EpisodeRow] = [row for row in made.rows.rows if row.status is Status.COMPLETE]
    assert [row.episode for row in chosen_episodes(complete)] == ["S2_L2_seed0"]
    failed = [replace(row, predicate_holds=row.episode == "S2_L2_seed1") for row in complete]
    assert [row.episode for row in chosen_episodes(failed)] == ["S2_L2_seed1"]
    others = [row for row in complete if row.level == "L1"]
    assert [row.episode for row in chosen_episodes(others)] == ["S2_L1_seed0"]


def test_every_template_has_its_film_around_the_events(made: SimpleNamespace) -> None:
    scenes = next(section for section in made.page.sections if section.key == "scenes")
    assert [clip.key for clip in scenes.clips] == ["film_S2"]
    assert [figure.key for figure in scenes.figures] == ["picture_S2"]
    assert any(command.startswith("./env siren video ") for command in scenes.commands)
