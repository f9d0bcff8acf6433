"""Columns come back as they were given, to half a unit."""

import numpy as np
import pytest
from episode_page.unpacked import unpacked

from siren_ros.reports.episode_page.columns import ColumnFile


@pytest.mark.parametrize("order", [0, 1, 2])
def test_columns_come_back_to_half_a_unit(order: int) -> None:
    values = np.array([0.0, -12.3456, 7.0, 2000000.0, -2000000.0, 0.0004, 1.0])
    file = ColumnFile()
    file.add("places", values, 0.001, order)
    file.add("codes", [3, 255, 0])
    head, columns = unpacked(file.packed({"title": "a"}))
    assert head["title"] == "a"
    assert [entry["name"] for entry in head["columns"]] == ["places", "codes"]
    assert np.abs(columns["places"] - values).max() <= 0.0005 + 1e-9
    assert columns["codes"].tolist() == [3, 255, 0]


@pytest.mark.parametrize("order", [0, 1, 2])
def test_narrow_columns_and_bytes_come_back(order: int) -> None:
    file = ColumnFile()
    file.add("places", [0.0, 327.67, -327.68, 5.0], 0.01, order, width=2)
    file.add_bytes("picture", b"\xff\xd8\x00")
    file.add("after", [7, -1])
    _, columns = unpacked(file.packed({}))
    assert columns["places"] == pytest.approx([0.0, 327.67, -327.68, 5.0])
    assert bytes(columns["picture"]) == b"\xff\xd8\x00"
    assert columns["after"].tolist() == [7, -1]


def test_what_changes_evenly_takes_hardly_any_bytes() -> None:
    sizes = []
    for order in (0, 2):
        file = ColumnFile()
        file.add("places", 3.7 * np.arange(10_000), 0.001, order)
        sizes.append(len(file.packed({})))
    assert 5 * sizes[1] < sizes[0]


def test_an_empty_file_has_its_head() -> None:
    file = ColumnFile()
    file.add("none", [])
    head, columns = unpacked(file.packed({}))
    assert head["columns"][0]["length"] == 0
    assert len(columns["none"]) == 0
