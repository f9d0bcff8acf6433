from dataclasses import replace
from types import SimpleNamespace

from siren_ros.studies.episode_row import EpisodeRow, Status
from siren_ros.study_report.sections.scenes import chosen_episodes


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
