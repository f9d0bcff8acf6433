import pytest

pytest.importorskip("gymnasium", reason="the extra learn is not installed")

import numpy as np
from hand_made_record import NORTHBOUND, Driven, at_speed, crossing, hand_made
from made_moment import moment_of

from siren_ros.learning.manoeuvres import Manoeuvre
from siren_ros.learning.task import Task
from siren_ros.learning.trial import Outcome, _delay_s, driven, keeps_lane, makes_way, means, of_the_model

SHORT = Task(template="S2", level=2, duration_s=3.0, decision_s=0.5)
NOTHING = np.zeros(0)


@pytest.mark.parametrize(
    ("gap_m", "aside_m", "manoeuvre"),
    [
        (39.0, 0.0, Manoeuvre.PULL_OVER),
        (41.0, 0.0, Manoeuvre.KEEP),
        (20.0, 2.9, Manoeuvre.PULL_OVER),
        (20.0, 3.1, Manoeuvre.KEEP),
        (-25.0, 0.0, Manoeuvre.KEEP),
    ],
)
def test_the_rule_pulls_over_while_a_siren_comes_from_behind_in_line(
    gap_m: float, aside_m: float, manoeuvre: Manoeuvre
) -> None:
    moment = moment_of(own_m=60.0, emv_m=60.0 - 5.0 - gap_m, aside_m=(aside_m, aside_m))
    assert makes_way(NOTHING, moment) == manoeuvre
    assert keeps_lane(NOTHING, moment) == Manoeuvre.KEEP


def test_the_delay_is_what_the_emv_loses_against_its_own_speed_and_all_time_after_an_early_end() -> None:
    record = hand_made(crossing(), {1: Driven(NORTHBOUND, at_speed(0.0, 6.0, 100))})
    assert _delay_s(record, 1, 8.0, 100) == pytest.approx(5.0 * (1.0 - 6.0 / 8.0))
    assert _delay_s(record, 1, 6.0, 100) == pytest.approx(0.0, abs=1e-9)
    assert _delay_s(record, 1, 6.0, 140) == pytest.approx(2.0)


def test_means_are_over_the_episodes() -> None:
    outcomes = [Outcome(1, 2.0, 1, 0), Outcome(2, 4.0, 0, 1)]
    assert means(outcomes) == {"delay_s": 3.0, "violations": 0.5, "contacts": 0.5}


def test_every_driver_is_tried_in_the_same_episode() -> None:
    outcomes = [driven(SHORT, 7, keeps_lane), of_the_model(SHORT, 7), driven(SHORT, 7, lambda *_: Manoeuvre.STOP)]
    assert [outcome.seed for outcome in outcomes] == [7, 7, 7]
    assert len({outcome.delay_s for outcome in outcomes}) > 1
    assert all(0.0 <= outcome.delay_s <= 3.0 for outcome in outcomes)
    assert driven(SHORT, 7, keeps_lane) == outcomes[0]
