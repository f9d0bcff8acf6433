from itertools import combinations

import pytest

from siren_ros.data.record.episode_source import open_source
from siren_ros.errors import InputError
from siren_ros.lab.training.prediction.plan import PlanSize, is_ordinary, plan_bags, plan_episodes
from siren_ros.simulation.scenario.paper import TEMPLATES, EmergencyLevel
from siren_ros.simulation.scenario.splits import EpisodeIdentity, Split, split_of

MAPS, HELD_OUT = ["", "maps/a.xodr", "maps/b.osm.gz"], ["maps/c.xodr"]
PLAN = plan_episodes(MAPS, HELD_OUT, PlanSize(train=10, validation=2, test=3))


def of(split):
    return [planned for planned in PLAN if planned.split is split]


def test_no_map_and_seed_serves_two_splits() -> None:
    places = {split: {episode.identity for episode in of(split)} for split in Split}
    assert all(not places[first] & places[second] for first, second in combinations(Split, 2))
    trained = {episode.request.seed for episode in of(Split.TRAIN)}
    assert not trained & {episode.request.seed for split in Split if split is not Split.TRAIN for episode in of(split)}


def test_the_held_out_map_only_judges() -> None:
    assert {episode.request.map for episode in of(Split.TEST_MAP)} == set(HELD_OUT)
    others = [episode for episode in PLAN if episode.split is not Split.TEST_MAP]
    assert {episode.request.map for episode in others} == set(MAPS)


def test_every_template_is_there_as_often_as_asked_for() -> None:
    for split, maps, seeds in zip(tuple(Split)[:4], (3, 3, 3, 1), (10, 2, 3, 3), strict=True):
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
    assert PLAN[0].name.startswith("S1_own_town_seed1")


def test_every_episode_is_in_the_split_that_is_fixed_for_it() -> None:
    fixed = {planned: split_of(planned.identity) for planned in PLAN if planned.split is not Split.TEST_MAP}
    assert all(planned.split is split for planned, split in fixed.items())


@pytest.mark.parametrize(("maps", "held_out"), [(["maps/Town07.xodr"], []), (["", "a.xodr"], ["a.xodr"])])
def test_a_map_that_judges_does_not_train(maps, held_out) -> None:
    with pytest.raises(InputError, match="maps"):
        plan_episodes(maps, held_out, PlanSize())


def test_own_bags_are_in_the_splits_that_are_fixed_for_them(tmp_path, write_bag) -> None:
    bags = [write_bag(tmp_path / f"bag{civilians}", duration_s=2.0, civilians=civilians) for civilians in (2, 3)]
    planned = plan_bags(bags)
    for one, bag in zip(planned, bags, strict=True):
        with open_source(bag) as source:
            identity = EpisodeIdentity.of(source.description)
        assert (one.bag, one.identity, one.split) == (bag, identity, split_of(identity))
    assert len({one.name for one in planned}) == 2, "bags of the same episode name have files of their own"
