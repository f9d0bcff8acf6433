"""The two layouts of a KITTI export."""

from enum import StrEnum


class Layout(StrEnum):
    """Which layout."""

    KITTI = "kitti"
    """The object benchmark's own."""
    PAPER = "paper"
