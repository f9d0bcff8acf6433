import pickle
from itertools import chain

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.lab.training.packed import parquet_samples
from siren_ros.lab.training.packed.parquet_samples import (
    Column,
    PackedSamples,
    join_files,
    samples_of_shard,
    write_samples,
)

COLUMNS = {
    "name": Column(str, (), "a text"),
    "number": Column(np.int32, (), "a number"),
    "pair": Column(np.float32, (2, 3), "an array", ("x", "y", "z")),
    "flags": Column(np.bool_, (4,), "flags"),
    "points": Column(np.float32, (-1, 2), "any number of points"),
}


def sample(number: int) -> dict:
    random = np.random.default_rng(number)
    return {
        "name": f"sample {number}",
        "number": number,
        "pair": random.normal(size=(2, 3)).astype(np.float32),
        "flags": random.random(4) < 0.5,
        "points": random.normal(size=(number % 5, 2)).astype(np.float32),
    }


@pytest.fixture
def small_groups(monkeypatch):
    monkeypatch.setattr(parquet_samples, "GROUP_BYTES", 300)


@pytest.fixture
def written(tmp_path, small_groups):  # noqa: ARG001 - while it writes
    path = tmp_path / "a.parquet"
    assert write_samples(path, COLUMNS, map(sample, range(23)), "made") == 23
    return PackedSamples(path)


def test_what_was_written_is_read(written):
    assert (len(written), written.task) == (23, "made")
    assert dict(written.columns) == COLUMNS
    assert len(written.first_of_group) > 3
    for number in (0, 22, 7, 8, 1):
        want = sample(number)
        have = written[number]
        assert set(have) == set(want)
        for name, value in want.items():
            np.testing.assert_array_equal(have[name], value)
            assert np.asarray(have[name]).shape == np.asarray(value).shape
    for outside in (-1, 23):
        with pytest.raises(IndexError):
            written[outside]


def test_another_process_reads_the_same(written):
    before = written[3]["pair"]
    again = pickle.loads(pickle.dumps(written))  # noqa: S301 - our own
    np.testing.assert_array_equal(again[3]["pair"], before)


def test_files_are_joined_in_their_order(written, tmp_path):
    write_samples(tmp_path / "b.parquet", COLUMNS, map(sample, range(23, 30)), "made")
    join_files([written.path, tmp_path / "b.parquet"], tmp_path / "all.parquet")
    joined = PackedSamples(tmp_path / "all.parquet")
    assert [joined[number]["number"] for number in range(len(joined))] == list(range(30))


def test_other_shapes_are_refused(tmp_path):
    wrong = sample(0) | {"pair": np.zeros((3, 2), np.float32)}
    with pytest.raises(ValueError, match=r"\(3, 2\)"):
        write_samples(tmp_path / "a.parquet", COLUMNS, [wrong], "made")
    assert not (tmp_path / "a.parquet").exists()


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.parquet").write_bytes(b"nothing")
    pq.write_table(pa.table({"a": [1]}), tmp_path / "b.parquet")
    for name in ("a", "b", "missing"):
        with pytest.raises(InputError, match="siren pack"):
            PackedSamples(tmp_path / f"{name}.parquet")


@settings(max_examples=20)
@given(shards=st.integers(1, 5), seed=st.one_of(st.none(), st.integers(0, 3)), turn=st.integers(0, 2))
def test_shards_together_give_each_sample_once(packed_numbers, shards, seed, turn):
    parts, again = (
        [
            [item["number"] for item in samples_of_shard([packed_numbers], shard, shards, seed=seed, turn=turn)]
            for shard in range(shards)
        ]
        for _ in range(2)
    )
    assert sorted(chain.from_iterable(parts)) == list(range(40))
    assert parts == again


def test_each_pass_has_an_order_of_its_own(packed_numbers, monkeypatch):
    def order(seed, turn):
        return [int(item["number"]) for item in samples_of_shard([packed_numbers], seed=seed, turn=turn)]

    assert order(None, 0) == list(range(40))
    assert len({tuple(order(seed, turn)) for seed in (0, 1) for turn in (0, 1)}) == 4
    monkeypatch.setattr(parquet_samples, "GROUPS_MIXED", 2)
    first = int(packed_numbers.first_of_group[2])
    assert all(set(order(seed, 0)[:first]) != {*range(first)} for seed in (0, 1)), "groups are mixed, too"


@pytest.mark.parametrize("name", COLUMNS)
def test_a_part_of_a_column_has_the_samples_of_that_part(name):
    column, values = COLUMNS[name], [sample(number)[name] for number in range(9)]
    part = column.unpacked(column.packed(values).slice(3, 4))
    for have, want in zip(part, values[3:7], strict=True):
        np.testing.assert_array_equal(have, want)


def test_a_shard_that_is_not_there_is_refused(packed_numbers):
    for shard in (-1, 2):
        with pytest.raises(InputError, match="0 to 1"):
            next(samples_of_shard([packed_numbers], shard, 2))


@pytest.fixture(scope="module")
def packed_numbers(tmp_path_factory):
    path = tmp_path_factory.mktemp("numbers") / "a.parquet"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parquet_samples, "GROUP_BYTES", 200)
        write_samples(path, COLUMNS, map(sample, range(40)), "made")
    return PackedSamples(path)
