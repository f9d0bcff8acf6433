"""Which episodes are for training, validation and test: whole episodes, those of one seed and map together."""

import hashlib
from collections.abc import Sequence
from typing import Final

SPLITS: Final = ("train", "val", "test")
AUTO: Final = "auto"
_SHARE: Final = {"test": 0.15, "val": 0.15}
_LEAST_GROUPS: Final = {"test": 3, "val": 2}
"""With fewer groups than these a split stays empty, so that training always has something."""


def split_of_groups(groups: Sequence[tuple[str, int]], wanted: str = AUTO) -> dict[tuple[str, int], str]:
    """The split of every group of episodes that share map and seed.

    Groups are ordered by a hash of map and seed. The first 15 % are for test, the next 15 % for validation, at least
    one group each from three and two groups on; the others are for training. The same groups always give the same
    answer, in whatever order they come.

    Args:
        groups: Hash of the map, and seed.
        wanted: One split for all, or ``auto``.
    """
    ordered = sorted(set(groups), key=lambda group: hashlib.sha256(f"{group[0]}/{group[1]}".encode()).digest())
    if wanted != AUTO:
        return dict.fromkeys(ordered, wanted)
    count, found, first = len(ordered), {}, 0
    for split, share in _SHARE.items():
        size = max(1, round(share * count)) if count >= _LEAST_GROUPS[split] else 0
        found.update(dict.fromkeys(ordered[first : first + size], split))
        first += size
    found.update(dict.fromkeys(ordered[first:], "train"))
    return found
