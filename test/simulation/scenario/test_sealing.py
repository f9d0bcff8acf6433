"""Tests of sealed episodes: the salt, what follows from it, and what a sealed description says."""

import json
from itertools import pairwise
from pathlib import Path

import pytest

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import MAX_SEED, EpisodeDescription, EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.scenario.sealing import (
    actor_ids,
    actor_name,
    commitment,
    opened,
    read_salt,
    sealed,
    seed_of,
    told,
    write_salt,
)


@pytest.fixture
def asked(tmp_path: Path) -> EpisodeRequest:
    """A request with a drawn salt."""
    write_salt(tmp_path / "salt")
    return EpisodeRequest("S2", seed=17, map="secret_place.net.xml", salt=str(tmp_path / "salt"))


def described(request: EpisodeRequest) -> EpisodeDescription:
    """A description with everything that could tell something."""
    return EpisodeDescription(
        template="S2",
        level=EmergencyLevel.L3,
        seed=seed_of(request),
        map_name="secret_place",
        map_sha256="ab",
        duration_s=60.0,
        sensor_suite="front",
        preset="paper",
        emv_ids=(1,),
        parameters={
            "request": request.to_json(),
            "template": {"emv.speed_mps": 11.25},
            "av": {"actor_id": 2, "name": "platoon0", "sensors": "none"},
        },
        site={"name": "secret_site"},
    )


def test_an_episode_without_a_salt_stays_as_it_is() -> None:
    request = EpisodeRequest("S2", seed=17)
    description = described(request)
    assert seed_of(request) == 17
    assert sealed(description, request) is description
    assert told(description) is description
    assert opened(description) is description
    ids = actor_ids(17, 3)
    assert [next(ids) for _ in range(4)] == [3, 4, 5, 6]
    assert "salt" not in request.to_json()


def test_the_streams_of_a_sealed_episode_follow_from_salt_and_seed_alone(asked: EpisodeRequest, tmp_path: Path) -> None:
    write_salt(tmp_path / "other")
    others = (
        EpisodeRequest("S2", seed=18, salt=asked.salt),
        EpisodeRequest("S2", seed=17, salt=str(tmp_path / "other")),
        EpisodeRequest("S2", seed=17),
    )
    seeds = [seed_of(one) for one in (asked, *others)]
    assert len(set(seeds)) == len(seeds)
    assert seeds[0] == seed_of(asked) > MAX_SEED
    assert min(seed.bit_length() for seed in seeds[:3]) > 200
    draws = {random_stream(seed, "demand").random() for seed in seeds}
    assert len(draws) == len(seeds)
    # The high bits take part, so that nobody can try a part of the number.
    assert random_stream(seeds[0], "demand").random() != random_stream(seeds[0] ^ (1 << 250), "demand").random()


def test_ids_and_names_say_no_order(asked: EpisodeRequest) -> None:
    drawn = actor_ids(seed_of(asked), 3)
    ids = [next(drawn) for _ in range(2000)]
    assert len(set(ids)) == len(ids)
    assert min(ids) >= 3
    assert max(ids) < 2**16
    rises = sum(later > earlier for earlier, later in pairwise(ids))
    assert 900 < rises < 1100  # half of 1999; the standard deviation is 13
    names = {actor_name(seed_of(asked), f"platoon{number}") for number in range(100)}
    assert len(names) == 100
    assert not any("platoon" in name for name in names)


def test_a_sealed_description_has_the_commitment_and_nothing_else(asked: EpisodeRequest) -> None:
    whole = sealed(described(asked), asked)
    said = told(whole)
    text = json.dumps({**vars(said), "level": int(said.level)})
    salt = read_salt(Path(asked.salt)).hex()
    secrets = ("S2", "17", "secret", "11.25", "platoon", "60", str(whole.seed), salt, asked.salt)
    assert not [secret for secret in secrets if secret in text.replace(json.dumps(said.parameters["sealed"]), "")]
    assert said.av_id == 2
    assert said.parameters["sealed"] == whole.parameters["sealed"]
    assert opened(said) is whole
    assert salt not in json.dumps(dict(whole.parameters))


def test_a_commitment_binds_salt_and_content() -> None:
    assert len({commitment(bytes([one] * 16), {"a": two}) for one in (1, 2) for two in (1, 2)}) == 4
    assert commitment(bytes(16), {"a": 1, "b": 2}) == commitment(bytes(16), {"b": 2, "a": 1})


@pytest.mark.parametrize("content", ["", "00" * 15, "no digits", "00" * 65])
def test_a_salt_that_is_none_is_refused_and_not_shown(content: str, tmp_path: Path) -> None:
    file = tmp_path / "salt"
    file.write_text(content)
    with pytest.raises(InputError, match="hexadecimal") as raised:
        seed_of(EpisodeRequest("S2", salt=str(file)))
    assert not content or content not in str(raised.value)


def test_a_salt_never_replaces_another_one(tmp_path: Path) -> None:
    write_salt(tmp_path / "salt")
    assert (tmp_path / "salt").stat().st_mode & 0o077 == 0
    with pytest.raises(InputError, match="salt"):
        write_salt(tmp_path / "salt")
