"""How a driver sits an exam: which episodes are made, which are paired, and what stands on the certificate."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from siren_ros.errors import InputError
from siren_ros.reports.exam.grading import Sitting, load_rulebook
from siren_ros.reports.exam.sitting import certificate_of, make_exam
from siren_ros.running.generation.closed_loop import AnswerTimes
from siren_ros.running.studies.episode_row import Status
from siren_ros.running.studies.matrix import Seat, Study

BOOK = load_rulebook("california")
OUT = Path("exam")
ANSWERS = '{"answers.median_ms": 2.0, "answers.p95_ms": 3.0, "answers.worst_ms": 9.0}'


def row(seed, status=Status.COMPLETE, measures="{}"):
    """What a study tells of an episode, as far as an exam asks."""
    path = f"S2_L3/S2_L3_seed{seed}"
    return SimpleNamespace(
        template="S2",
        level="L3",
        seed=seed,
        map="town",
        map_name="town",
        site="",
        values="",
        path=path,
        bag=path if status is Status.COMPLETE else "",
        status=status,
        reason="" if status is Status.COMPLETE else "SUMO teleported",
        measures=measures,
    )


class Maker:
    """Stands for the processes that make a study; it keeps what it was asked for."""

    def __init__(self, *rows, papers=()):
        self.rows, self.papers, self.asked = rows, papers, []

    def __call__(self, study, folder):
        self.asked.append((study.seat, folder))
        return self.rows if folder == OUT else self.papers


def study(**seat):
    return Study(("S2",), seat=Seat(**seat))


def test_each_episode_of_a_driver_has_that_of_the_papers_driver_beside_it():
    make = Maker(row(0), row(1), row(2), papers=(row(2), row(1, Status.FAILED), row(0)))
    made, lacks = make_exam(study(driver="idm"), OUT, make, paired=True)
    assert make.asked == [(Seat("idm"), OUT), (Seat(), OUT / "paper")]
    assert [one.bag for one in made] == [OUT / f"S2_L3/S2_L3_seed{seed}" for seed in range(3)]
    assert [one.paper for one in made] == [OUT / "paper/S2_L3/S2_L3_seed0", None, OUT / "paper/S2_L3/S2_L3_seed2"]
    assert lacks == ()


@pytest.mark.parametrize(("driver", "seat", "paired"), [("idm", Seat("idm"), False), ("siren", Seat(), True)])
def test_an_exam_alone_and_that_of_the_papers_driver_itself_have_no_pairs(driver, seat, paired):
    make = Maker(row(0))
    made, _ = make_exam(study(driver=driver), OUT, make, paired=paired)
    assert make.asked == [(seat, OUT)]
    assert [one.paper for one in made] == [None]


def test_an_episode_that_failed_has_its_reason_and_an_unknown_driver_is_refused():
    made, lacks = make_exam(study(driver="idm"), OUT, Maker(row(0, Status.FAILED), row(1)), paired=False)
    assert [one.bag.name for one in made] == ["S2_L3_seed1"]
    assert [(one.bag, one.episode, one.lack) for one in lacks] == [
        ("exam/S2_L3/S2_L3_seed0", "S2_L3_seed0_town", "SUMO teleported")
    ]
    make = Maker()
    with pytest.raises(InputError, match="driver: 'nobody'"):
        make_exam(study(driver="nobody"), OUT, make, paired=True)
    assert make.asked == []


@pytest.mark.parametrize(
    ("real_time", "measures", "known"), [(True, ANSWERS, True), (True, "{}", False), (False, ANSWERS, False)]
)
def test_the_wall_time_of_answers_counts_in_real_time(real_time, measures, known):
    seat = {"program": "./drive", "real_time": real_time}
    made, _ = make_exam(study(**seat), OUT, Maker(row(0, measures=measures)), paired=False)
    assert [one.answers for one in made] == [AnswerTimes(2.0, 3.0, 9.0) if known else None]


def test_episodes_are_in_the_order_of_their_seeds():
    bags = ["exam/S1_L2_seed2", "exam/S1_L2_seed10", "exam/S1_L3_seed1", "exam/S2_L2_seed0"]
    sittings = [Sitting(bag, "", 2, ()) for bag in bags[::-1]]
    assert [one.bag for one in certificate_of("", None, BOOK, sittings).sittings] == bags


@pytest.mark.parametrize(
    ("driver", "actor_id", "name"), [("", None, "the AV under test"), ("", 7, "actor 7"), ("a\x1b", 7, "a\\x1b")]
)
def test_a_certificate_names_the_driver(driver, actor_id, name):
    assert certificate_of(driver, actor_id, BOOK, []).driver == name
