from itertools import combinations

from siren_ros.scenario.paper import TEMPLATES, EmergencyLevel
from siren_ros.training.prediction.plan import PlanSize, is_ordinary, plan_episodes
from siren_ros.training.settings import Split

MAPS, HELD_OUT = ["", "maps/a.xodr", "maps/b.osm.gz"], ["maps/c.xodr"]
PLAN = plan_episodes(MAPS, HELD_OUT, PlanSize(train=10, validation=2, test=3))


def of(split):
    return [planned for planned in PLAN if planned.split is split]


def test_no_map_and_seed_serves_two_splits() -> None:
    places = {split: {(episode.request.map, episode.request.seed) for episode in of(split)} for split in Split}
    assert all(not places[first] & places[second] for first, second in combinations(Split, 2))
    trained = {episode.request.seed for episode in of(Split.TRAIN)}
    assert not trained & {episode.request.seed for split in Split if split is not Split.TRAIN for episode in of(split)}


def test_the_held_out_map_only_judges() -> None:
    assert {episode.request.map for episode in of(Split.TEST_MAPS)} == set(HELD_OUT)
    others = [episode for episode in PLAN if episode.split is not Split.TEST_MAPS]
    assert {episode.request.map for episode in others} == set(MAPS)


def test_every_template_is_there_as_often_as_asked_for() -> None:
    for split, maps, seeds in zip(Split, (3, 3, 3, 1), (10, 2, 3, 3), strict=True):
        templates = [episode.request.template for episode in of(split)]
        assert {template: templates.count(template) for template in TEMPLATES} == dict.fromkeys(TEMPLATES, maps * seeds)


def test_training_has_all_levels_and_the_others_the_templates_own() -> None:
    levels = [episode.request.level for episode in of(Split.TRAIN)]
    assert set(levels) == {"", *EmergencyLevel.__members__}
    assert levels.count("") == len(levels) / 2
    assert sum(is_ordinary(episode.request) for episode in of(Split.TRAIN)) == len(levels) / 5
    assert {episode.request.level for episode in PLAN if episode.split is not Split.TRAIN} == {""}


def test_names_tell_episodes_apart() -> None:
    names = [(episode.split, episode.name) for episode in PLAN]
    assert len(set(names)) == len(names)
    assert PLAN[0].name == "S1_own_town_seed100"
    assert "S1_own_b_seed902" in {episode.name for episode in of(Split.VALIDATION)}
