"""Two certificates side by side."""

import json

import pytest

from siren_ros.errors import InputError
from siren_ros.reports.exam.comparison import compared, read_certificate


def certificate(driver, grades, delays=(), rulebook="california"):
    """A certificate of one clause, with its grade and the EMV's delay in each episode."""
    return {
        "driver": driver,
        "rulebook": rulebook,
        "clauses": [{"title": "Stands"}],
        "episodes": [
            {
                "episode": f"S2_L2_seed{seed}_town",
                "marks": [{"grade": grade}] if grade else [],
                "others": {"emv_delay_s": delays[seed], "braked_hard": 0.0} if delays else {},
            }
            for seed, grade in enumerate(grades)
        ],
    }


@pytest.mark.parametrize(
    "change",
    [{"rulebook": None}, {"clauses": 2}, {"episodes": [1]}, {"episodes": [{"episode": "a", "marks": [1]}]}],
    ids=str,
)
def test_a_certificate_of_something_else_is_refused(change):
    other = certificate("a", ["pass"]) | change
    if change == {"rulebook": None}:
        del other["rulebook"]
    with pytest.raises(InputError, match="certificate"):
        compared(other, other)


def test_the_share_of_violations_in_common_episodes_where_the_clause_applies_to_both():
    first = certificate("a", ["major", "minor", "pass", "not applicable", "", "pass", "minor"])
    second = certificate("b", ["pass", "minor", "pass", "pass", "pass", "pass", "pass"])
    row = compared(first, second).rows[0]
    assert row[0] == "violated: Stands"
    assert row[1] == 5  # seed 3 does not apply, seed 4 has no result
    assert row[2] == pytest.approx(3 / 5)
    assert row[3] == pytest.approx(1 / 5)
    assert row[4].value == pytest.approx(2 / 5)
    assert row[4].low < 2 / 5 < row[4].high
    mirrored = compared(second, first).rows[0][4]
    assert (mirrored.value, mirrored.low) == (pytest.approx(-2 / 5), pytest.approx(-row[4].high))


def test_what_they_do_to_others_is_compared_where_both_know_it():
    grades = ["pass"] * 6
    table = compared(certificate("a", grades, [1.0, 2, 3, 1, 2, 3]), certificate("b", grades, [0.0, 1, 2, 0, 1, 3]))
    by_name = {str(row[0]): row for row in table.rows}
    delay = next(row for name, row in by_name.items() if "later arrival" in name)
    assert delay[4].value == pytest.approx(5 / 6)
    without = compared(certificate("a", grades), certificate("b", grades))
    assert without.rows[-1][1] == 0


def test_certificates_that_cannot_be_compared_are_refused(tmp_path):
    first = certificate("a", ["pass"])
    with pytest.raises(InputError, match="california"):
        compared(first, certificate("b", ["pass"], rulebook="germany"))
    with pytest.raises(InputError, match="common episodes"):
        compared(first, certificate("b", [""]))
    file = tmp_path / "certificate.json"
    for content in ("", "[]", json.dumps({"driver": "a"})):
        file.write_text(content)
        with pytest.raises(InputError, match=r"certificate\.json"):
            read_certificate(file)
