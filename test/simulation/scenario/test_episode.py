"""The fields of a request, descriptions of episodes, and their splits."""

from collections import Counter
from dataclasses import asdict, dataclass, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.base.params.parameters import parameter
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import (
    EpisodeDescription,
    EpisodeEnd,
    EpisodeIdentity,
    EpisodeOutcome,
    EpisodeRequest,
    SeenEpisodes,
    Split,
    SplitRule,
    counted_standings,
    overlap_warning,
    split_of,
    split_rule,
    text_of_values,
    values_of,
)
from siren_ros.simulation.scenario.paper import EmergencyLevel


@dataclass(frozen=True)
class Program(EpisodeRequest):
    """A configuration with a field of its own."""

    bag: str = parameter("", "Where the bag goes.")


def test_a_configuration_holds_a_request():
    program = Program(template="S5", seed=7, duration_s=3.0, bag="x")
    request = EpisodeRequest.within(program)
    assert type(request) is EpisodeRequest
    assert request == EpisodeRequest("S5", seed=7, duration_s=3.0)
    assert asdict(program) == {**asdict(request), "bag": "x"}


def test_values_are_text_and_numbers_to_the_last_bit():
    values = {"emv.speed_mps": 0.1 + 0.2, "demand.background_vehicles": 20.0}
    text = text_of_values(values)
    assert values_of(text) == values
    assert text == "demand.background_vehicles=20.0,emv.speed_mps=0.30000000000000004"
    assert (values_of(" emv.speed_mps = 12 , "), values_of("")) == ({"emv.speed_mps": 12.0}, {})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *[("emv.speed_mps", "values"), ("emv.speed_mps=fast", "values"), ("a=1,a=2", "values")],
        *[("a.b=1,a.b=2", "each parameter once"), ("a.b=1,a.b =2", "each parameter once")],
        *[(" a.b =1, a.b=1", "each parameter once"), ("a.b =1,a.b =2", "each parameter once")],
    ],
)
def test_other_texts_are_refused_and_a_parameter_is_given_once_however_it_is_spaced(text, words):
    with pytest.raises(InputError, match=words):
        values_of(text)


PLAIN = {"template": "S1", "level": "", "seed": 0, "map": "", "duration_s": 0.0, "preset": "paper", "sensors": "front"}
PLAIN |= {"look": "clear", "av": "", "av_sensors": "none"}
CHOSEN = {"site": "a..b", "values": "duration_s=30", "demand": "own.sumocfg", "demand_begin_s": 60.0}
CHOSEN |= {"predictor": "cv", "detector": "pillars"}


@pytest.mark.parametrize("chosen", [{}, *({name: value} for name, value in CHOSEN.items()), CHOSEN])
def test_a_record_has_what_was_chosen_and_never_the_secret(chosen):
    """A record of a request without such a choice is as it was before there was any."""
    request = EpisodeRequest("S1", **chosen)
    assert EpisodeRequest("S1", salt="secret", **chosen).to_json() == request.to_json() == PLAIN | chosen
    assert EpisodeRequest(**request.to_json()) == request


def described(parameters):
    return EpisodeDescription("S1", EmergencyLevel.L3, 0, "town", "", 10.0, "none", "paper", (1,), parameters)


NOTHING = {"asked": {}, "predictor": "", "detector": "", "draw": "", "pinned": "", "template_values": {}}
NOTHING |= {"av_id": 0, "av_sensor_suite": "", "crossed_junctions": {}}
REQUEST = {"site": "a..b", "values": "x=1", "predictor": "cv", "detector": "pillars"}
VALUES = {"emv.speed_mps": 13, "response.compliance": 0.9, "emv.class": "ambulance", "flag": True}


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        *[({}, {}), ({"request": {}}, {}), ({"request": None, "av": None, "template": [1.0], "crossing": None}, {})],
        ({"request": "S1", "av": "civilian", "template": "S1", "crossing": "J"}, {}),
        (
            {"request": REQUEST},
            {"asked": REQUEST, "predictor": "cv", "detector": "pillars", "draw": "x=1", "pinned": "a..b x=1"},
        ),
        *[
            ({"request": one}, {"asked": one, "pinned": "a..b"})
            for one in ({"site": "a..b"}, {"site": "a..b", "seed": 1})
        ],
        ({"request": {"values": "x=1"}}, {"asked": {"values": "x=1"}, "draw": "x=1", "pinned": "x=1"}),
        ({"template": VALUES}, {"template_values": {"emv.speed_mps": 13.0, "response.compliance": 0.9}}),
        ({"av": {"actor_id": 4, "sensors": "full"}}, {"av_id": 4, "av_sensor_suite": "full"}),
        ({"crossing": {"emv_ids": [3, 7], "junction": "J"}}, {"crossed_junctions": {3: "J", 7: "J"}}),
    ],
)
def test_a_description_says_what_its_parameters_name_and_nothing_of_others(parameters, expected):
    episode = described(parameters)
    assert {name: getattr(episode, name) for name in NOTHING} == NOTHING | expected
    assert all(isinstance(value, float) for value in episode.template_values.values())


@pytest.mark.parametrize(
    ("holds", "measures", "said"),
    [
        *[(True, {}, ()), (True, {"demand.near_emv": 3, "collisions": 0}, ())],
        (True, {"demand.near_emv": 0}, ("no vehicle of the own demand came near an EMV",)),
        (False, {"collisions": 1}, ("the interaction did not happen", "1 collision")),
        (None, {"collisions": 2}, ("whether the interaction happened could not be judged", "2 collisions")),
    ],
)
def test_what_an_episode_lacks_is_said(holds, measures, said):
    assert EpisodeOutcome(EpisodeEnd.COMPLETE, "", 9, holds, measures).shortcomings == said


RULE = SplitRule(frozenset({"far"}), frozenset({"S8"}), val_percent=15, test_seed_percent=15)
IDENTITIES = st.builds(
    EpisodeIdentity, st.sampled_from(["town", "far"]), st.sampled_from(["S1", "S8"]), st.integers(0, 99)
)


def test_shares_are_70_15_15() -> None:
    splits = Counter(RULE.split_of(EpisodeIdentity("town", "S2", seed)) for seed in range(4000))
    shares = {split: count / 4000 for split, count in splits.items()}
    assert shares == {
        Split.TRAIN: pytest.approx(0.7, abs=0.03),
        Split.VAL: pytest.approx(0.15, abs=0.03),
        Split.TEST_SEED: pytest.approx(0.15, abs=0.03),
    }


@pytest.mark.parametrize(
    ("val", "test_seed", "splits"),
    [(0, 0, {Split.TRAIN}), (100, 0, {Split.VAL}), (0, 100, {Split.TEST_SEED}), (60, 40, {Split.VAL, Split.TEST_SEED})],
)
def test_no_episode_is_of_a_split_without_a_share(val: int, test_seed: int, splits: set[Split]) -> None:
    rule = replace(RULE, val_percent=val, test_seed_percent=test_seed)
    assert {rule.split_of(EpisodeIdentity("town", "S2", seed)) for seed in range(800)} == splits


def test_an_episodes_identity_has_its_parameters_and_the_hash_of_its_map() -> None:
    episode = replace(described({"request": {"values": "emv.speed_mps=12"}}), seed=4, map_sha256="ab")
    identity = EpisodeIdentity.of(episode)
    assert (identity.text, identity.content) == ("town S1 4 emv.speed_mps=12.0", "ab S1 4 emv.speed_mps=12.0")
    assert EpisodeIdentity.of(described({})).content == ""


@given(st.lists(IDENTITIES), st.lists(IDENTITIES))
def test_a_study_that_grows_moves_no_episode(study, more) -> None:
    before = {identity: split_of(identity) for identity in study}
    after = {identity: split_of(identity) for identity in [*more, *study]}
    assert all(after[identity] is split for identity, split in before.items())


def test_template_seed_map_and_parameters_decide() -> None:
    def splits(**changed) -> set[Split]:
        return {
            RULE.split_of(EpisodeIdentity(**{"map_name": "town", "template": "S2", "seed": 1} | one))
            for one in changed["each"]
        }

    for each in (
        [{"seed": seed} for seed in range(40)],
        [{"map_name": f"map{number}"} for number in range(40)],
        [{"template": f"mine{number}"} for number in range(40)],
        [{"values": f"emv.speed_mps={number}"} for number in range(40)],
    ):
        assert splits(each=each) == {Split.TRAIN, Split.VAL, Split.TEST_SEED}


def test_the_order_of_parameters_decides_nothing() -> None:
    first, second = (EpisodeIdentity("town", "S2", 1, text) for text in ("a.b=1,c.d=2", "c.d=2.0, a.b=1.0"))
    assert first.text == second.text == "town S2 1 a.b=1.0,c.d=2.0"


def test_held_out_maps_and_templates_never_train() -> None:
    assert {RULE.split_of(EpisodeIdentity("far", "S1", seed)) for seed in range(50)} == {Split.TEST_MAP}
    assert {RULE.split_of(EpisodeIdentity("far", "S8", seed)) for seed in range(50)} == {Split.TEST_TEMPLATE}


def test_the_rule_of_the_project_has_maps_and_a_template_of_its_own() -> None:
    rule = split_rule()
    assert {"Town07", "Town10HD_Opt"} <= rule.test_maps
    assert "town" not in rule.test_maps
    assert rule.test_templates == {"S8", "sealed"}


def test_a_map_under_another_name_is_known_by_its_content() -> None:
    town, other = "a" * 64, "b" * 64
    card = {"data": {"train": {"keys": ["town S1 1"], "contents": [f"{town} S1 1"]}}}
    seen = SeenEpisodes.of_card(card)
    assert seen is not None
    expected = {
        EpisodeIdentity("town", "S1", 1, map_sha256=town): Split.TRAIN,
        EpisodeIdentity("renamed", "S1", 1, map_sha256=town): Split.TRAIN,
        EpisodeIdentity("renamed", "S1", 2, map_sha256=town): Split.TEST_SEED,
        EpisodeIdentity("renamed", "S1", 3, map_sha256=other): Split.TEST_MAP,
        EpisodeIdentity("far", "S1", 1): Split.TEST_MAP,
    }
    assert {episode: seen.split_of(episode) for episode in expected} == expected
    # Another map that bears the name of the one that was trained on:
    assert seen.split_of(EpisodeIdentity("town", "S1", 2, map_sha256=other)) is Split.TEST_MAP


def test_how_an_episode_stands_to_a_model() -> None:
    seen = SeenEpisodes(frozenset({"town S1 1", "town S2 1", "other S1 4"}), frozenset({"town S1 9"}))
    expected = {
        ("town", "S1", 1): Split.TRAIN,
        ("town", "S1", 9): Split.VAL,
        ("town", "S1", 2): Split.TEST_SEED,
        ("far", "S1", 1): Split.TEST_MAP,
        ("town", "S3", 1): Split.TEST_TEMPLATE,
    }
    assert {key: seen.split_of(EpisodeIdentity(*key)) for key in expected} == expected


def test_a_request_has_the_identity_of_its_episode() -> None:
    request = EpisodeRequest("S2", "L2", 7, "maps/Far.xodr", values="b=2,a=1")
    assert EpisodeIdentity.of_request(request).text == "Far S2 7 a=1.0,b=2.0"
    assert EpisodeIdentity.of_request(EpisodeRequest("own/S1.yaml", seed=3), "S1").text == "town S1 3"
    assert EpisodeIdentity.of_request(EpisodeRequest("S1", map="own.net.xml.gz")).text == "own S1 0"


def test_a_card_lists_its_episodes_or_does_not() -> None:
    card = {"data": {"train": {"keys": ["town S1 1", "far S2 2"]}, "val": {"keys": ["town S1 9"]}}}
    seen = SeenEpisodes.of_card(card)
    assert seen == SeenEpisodes(frozenset({"town S1 1", "far S2 2"}), frozenset({"town S1 9"}))
    assert seen.maps == {"town", "far"}
    assert SeenEpisodes.of_card({"data": {"train": {"keys": []}}}) == SeenEpisodes(frozenset())
    assert SeenEpisodes.of_card({}) is SeenEpisodes.of_card({"data": {"unknown": "lost"}}) is None


def test_scored_episodes_of_the_training_are_warned_of() -> None:
    counts = counted_standings([Split.TRAIN, Split.TEST_MAP, Split.TRAIN])
    assert counts == {split: {Split.TRAIN: 2, Split.TEST_MAP: 1}.get(split, 0) for split in Split}
    assert overlap_warning("a", counts) == "WARNING: a was trained on 2 of these 3 episodes: its scores say too much"
    assert overlap_warning("a", counted_standings([Split.VAL, Split.TEST_SEED])) == ""
    assert counted_standings([]) == {}
    assert overlap_warning("a", {}) == ""
