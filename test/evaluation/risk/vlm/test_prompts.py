"""When the pictures of a question were taken, and what is said of their outlines."""

from siren_ros.evaluation.risk.key_frames import batches, key_frames
from siren_ros.evaluation.risk.vlm.prompts import question


def test_times_are_tenths_of_the_frames_numbers() -> None:
    first, last = batches(key_frames(190))
    asked = question(first, marked=False)
    assert asked.startswith("8 pictures, taken at 0.0, 2.3, 4.7, 7.0, 9.4, 11.8, 14.1, 16.5 s of the same drive")
    assert question(last, marked=False).startswith("One picture, taken at 18.9 s of the same drive")


def test_outlines_are_explained_where_there_are_some() -> None:
    assert "outlined" in question((0, 10), marked=True)
    assert "outlined" not in question((0, 10), marked=False)
