from hypothesis import given
from hypothesis import strategies as st

from siren_ros.datasets.exporting.splits import SPLITS, split_of_groups

GROUPS = st.lists(st.tuples(st.sampled_from(["map a", "map b"]), st.integers(0, 400)), min_size=1, max_size=60)


@given(GROUPS, st.randoms())
def test_order_and_repetition_change_nothing(groups: list[tuple[str, int]], random: object) -> None:
    shuffled = [*groups, *groups]
    random.shuffle(shuffled)  # type: ignore[attr-defined] # a random.Random
    assert split_of_groups(groups) == split_of_groups(shuffled)


@given(GROUPS)
def test_training_always_has_something(groups: list[tuple[str, int]]) -> None:
    found = list(split_of_groups(groups).values())
    assert found.count("train") >= 1
    count = len(set(groups))
    assert (found.count("val") > 0) == (count >= 2)
    assert (found.count("test") > 0) == (count >= 3)
    assert found.count("train") >= 0.6 * count - 1


def test_shares_are_70_15_15() -> None:
    found = list(split_of_groups([("map", seed) for seed in range(100)]).values())
    assert [found.count(split) for split in SPLITS] == [70, 15, 15]


def test_one_split_for_all() -> None:
    assert set(split_of_groups([("map", 1), ("map", 2)], "val").values()) == {"val"}
