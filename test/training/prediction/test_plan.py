from itertools import combinations

from siren_ros.scenario.paper import TEMPLATES, EmergencyLevel
from siren_ros.training.prediction.plan import PlanSize, is_ordinary, plan_episodes
from siren_ros.training.settings import Split

MAPS, HELD_OUT = ["", "maps/a.xodr", "maps/b.osm.gz"], ["maps/c.xodr"]
PLAN = plan_episodes(MAPS, HELD_OUT, PlanSize(train=10, validation=2, test=3))


def of(split):
    return [planned for planned in PLAN if planned.split is split]


def test_no_map_and_seed_serves_two_splits() -> None:
    places = {split: {(one.request.map, one.request.seed) for one in of(split)} for split in Split}
    assert all(not places[one] & places[other] for one, other in combinations(Split, 2))
    trained = {one.request.seed for one in of(Split.TRAIN)}
    assert not trained & {one.request.seed for split in Split if split is not Split.TRAIN for one in of(split)}


def test_the_held_out_map_only_judges() -> None:
    assert {one.request.map for one in of(Split.TEST_MAPS)} == set(HELD_OUT)
    others = [one for one in PLAN if one.split is not Split.TEST_MAPS]
    assert {one.request.map for one in others} == set(MAPS)


def test_every_template_is_there_as_often_as_asked_for() -> None:
    for split, maps, seeds in (
        (Split.TRAIN, 3, 10),
        (Split.VALIDATION, 3, 2),
        (Split.TEST_SEEDS, 3, 3),
        (Split.TEST_MAPS, 1, 3),
    ):
        templates = [one.request.template for one in of(split)]
        assert {template: templates.count(template) for template in TEMPLATES} == dict.fromkeys(TEMPLATES, maps * seeds)


def test_training_has_all_levels_and_the_others_the_templates_own() -> None:
    levels = [one.request.level for one in of(Split.TRAIN)]
    assert set(levels) == {"", *EmergencyLevel.__members__}
    assert levels.count("") == len(levels) / 2
    assert sum(is_ordinary(one.request) for one in of(Split.TRAIN)) == len(levels) / 5
    assert {one.request.level for one in PLAN if one.split is not Split.TRAIN} == {""}


def test_names_tell_episodes_apart() -> None:
    names = [(one.split, one.name) for one in PLAN]
    assert len(set(names)) == len(names)
    assert PLAN[0].name == "S1_own_town_seed100"
    assert "S1_own_b_seed902" in {one.name for one in of(Split.VALIDATION)}
