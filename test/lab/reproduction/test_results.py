from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.lab.reproduction.results import PartResult, figures_in, machine, read_results, write_results

NAMES = st.text(st.characters(categories=("L", "N")), min_size=1, max_size=8)
FIGURES = st.dictionaries(NAMES, st.integers() | st.floats(allow_nan=False, allow_infinity=False) | NAMES, max_size=4)
PARTS = st.builds(PartResult, NAMES, st.tuples(NAMES), st.just({"cores": "2"}), st.floats(0.0, 1e4), FIGURES)
RESULTS = st.dictionaries(NAMES, PARTS, max_size=3)


@given(RESULTS)
def test_results_are_read_as_they_were_written(tmp_path_factory, results) -> None:
    file = tmp_path_factory.mktemp("results") / "results.json"
    write_results(file, results)
    assert read_results(file) == results


@pytest.mark.parametrize("text", ["{", "{}", '{"parts": {"a": {}}}', '{"parts": []}'])
def test_a_damaged_file_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "results.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="a file of results"):
        read_results(tmp_path / "results.json")
    assert read_results(tmp_path / "none.json") == {}


def test_rows_are_named_by_their_texts() -> None:
    rows = [
        {"template": "S1", "model": "cv", "ade_m": 1.99, "windows": [3, 4]},
        {"template": "S1", "model": "idm", "ade_m": 2.99},
    ]
    content = {"rows": rows, "card": {"holds": "20/20", "absent": None}}
    assert figures_in(content, ("*",)) == {
        "rows.S1.cv.ade_m": 1.99,
        "rows.S1.cv.windows.0": 3,
        "rows.S1.cv.windows.1": 4,
        "rows.S1.idm.ade_m": 2.99,
        "card.holds": "20/20",
    }
    assert figures_in(content, ("*.idm.*",), "town") == {"town.rows.S1.idm.ade_m": 2.99}
    content = {"rows": [{"template": "S1", "outcome": "delay", "levels": ["L3", "L1"], "difference": {"value": 2.0}}]}
    assert figures_in(content, ("*",), leave_out=("rows", "value")) == {"S1.delay.L3-L1.difference": 2.0}
    assert figures_in({"up to 15 m": 1, "siren:lstm": 2}, ("*",)) == {"up_to_15_m": 1, "siren_lstm": 2}


def test_a_pattern_without_a_number_and_a_name_twice_are_refused() -> None:
    with pytest.raises(InputError, match="matches a number"):
        figures_in({"a": 1}, ("a", "b.*"))
    with pytest.raises(InputError, match="one number of each name"):
        figures_in([{"name": "a", "x": 1}, {"name": "a", "x": 2}], ("*",))


def test_the_machine_has_no_name_and_no_path() -> None:
    said = machine()
    assert {"cores", "load", "processor", "python", "numpy"} <= set(said)
    assert not any("/" in value and Path(value).exists() for value in said.values())
