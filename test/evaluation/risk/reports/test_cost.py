"""What asking a model took."""

from siren_ros.evaluation.risk.reports.cost import account
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.vlm.model import Reply
from siren_ros.evaluation.risk.vlm.pipeline import VideoAnswer

ANSWERS = [
    VideoAnswer("a", (RiskClass.NORMAL, None), (Reply("x", 1000, 10, 1.0), Reply("y", 500, 20, 3.0)), 1),
    VideoAnswer("b", (RiskClass.NORMAL,), (Reply("z", 1500, 30, 2.0),), 0),
]


def test_questions_tokens_time_and_cost_are_summed() -> None:
    (line,) = account("m", ANSWERS, (400.0, 10_000.0))
    assert line == (
        "m: 3 questions, 1 of them answered before, 1 answers unreadable; 3000 tokens in, 60 out, cost 1.80; "
        "2.00 s for an answer (median), 2.90 s at the 95th percentile"
    )


def test_nothing_is_said_of_times_and_prices_that_are_not_known() -> None:
    (line,) = account("m", [VideoAnswer("a", (RiskClass.NORMAL,), (Reply("x"),), 0)], None)
    assert line == "m: 1 questions, 0 of them answered before, 0 answers unreadable; 0 tokens in, 0 out"
