"""The times of a program's answers: percentiles in closed form, and the line of a summary read back."""

from hypothesis import given
from hypothesis import strategies as st

from siren_ros.running.generation.answer_times import AnswerTimes


def test_percentiles_of_answers() -> None:
    assert AnswerTimes.of([0.001 * number for number in range(101)]) == AnswerTimes(50.0, 95.0, 100.0)


@given(st.lists(st.floats(0.0, 20.0), min_size=1, max_size=30))
def test_a_summary_is_read_back(times_s: list[float]) -> None:
    told = AnswerTimes.of(times_s)
    assert AnswerTimes.in_lines(["episode complete", told.line, "bag: x"]) == told


def test_a_summary_without_a_program_says_nothing() -> None:
    assert AnswerTimes.in_lines(["episode complete", "real-time factor 3.0 (1.0 s of wall time)"]) is None
