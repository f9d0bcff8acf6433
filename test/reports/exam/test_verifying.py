"""What differs between a certificate and what its bags give, whatever their folders are called."""

import copy
import json
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from siren_ros.base.tables import Measure
from siren_ros.errors import InputError
from siren_ros.reports.exam import verifying
from siren_ros.reports.exam.certificate import Certificate, as_json
from siren_ros.reports.exam.finding import Finding
from siren_ros.reports.exam.grading import Grade, Mark, Sitting, load_rulebook
from siren_ros.reports.exam.verifying import differences
from siren_ros.running.generation.closed_loop import AnswerTimes

BOOK = load_rulebook("california")
ANSWERS = AnswerTimes(2.0, 3.0, 9.0)
MATRIX = {"templates": ["S1"], "levels": ["L2"], "seeds": [1, 2, 3], "maps": [""], "sites": [""]}


def sitting(number, grade, **more):
    marks = tuple(Mark(one, grade, Finding(Measure(float(number)), number)) for one in BOOK.clauses)
    return Sitting(f"old/{number}", f"S{number}", 10 + number, marks, map_sha256=f"m{number}", **more)


PAIRED = sitting(1, Grade.MINOR, answers=ANSWERS, paper="old/p1", others={"emv_delay_s": 2.0, "braked_hard": 1.0})
LOST = Sitting("old/2", "S2", 12, (), "it hangs")
ALONE = sitting(3, Grade.PASS)
HASHES = {"old/1": "#1", "old/p1": "#p1", "old/3": "#3"}
CONTENT = json.loads(as_json(Certificate("d", BOOK, (PAIRED, LOST, ALONE), {"matrix": MATRIX}), HASHES))
BAGS = [Path(f"new/{name}") for name in ("3", "p1", "1", "other")]


@pytest.fixture
def asked(monkeypatch):
    """Bags are graded as they were, in this process; what was asked."""
    asked = []

    def grade(made, book):
        asked.append((str(made.bag), str(made.paper), made.answers, made.actor_id, book.name))
        same = {"new/1": PAIRED, "new/3": ALONE}[str(made.bag)]
        return replace(same, bag=str(made.bag), paper=str(made.paper or ""))

    pool = SimpleNamespace(map=lambda function, calls: [function(*call) for call in calls])
    monkeypatch.setattr(verifying, "ProcessPool", lambda _: nullcontext(pool))
    monkeypatch.setattr(verifying, "bag_sha256", lambda bag: f"#{bag.name}")
    monkeypatch.setattr(verifying, "sit_in_made_episode", grade)
    return asked


def test_a_certificate_is_confirmed_by_bags_of_any_names(asked):
    elsewhere = json.loads(json.dumps(CONTENT).replace("old/", "moved/")) | {"siren": "0.0"}
    assert differences(elsewhere, BAGS) == ()
    assert asked == [("new/1", "new/p1", ANSWERS, 11, "california"), ("new/3", "None", None, 13, "california")]


FIRST, LAST = BOOK.clauses[0].clause_id, BOOK.clauses[-1].clause_id


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (("heard_late_m",), 1.0, ["heard_late_m differs"]),
        (("passed",), True, ["passed differs"]),
        (("extra",), 1, ["extra differs"]),
        (("clauses", 0, "minor"), -1.0, ["clauses differs"]),
        (("matrix", "seeds"), [1, 2], ["2 episodes in the matrix, 3 on the certificate"]),
        (("matrix", "levels"), ["L2", "L3"], ["6 episodes in the matrix, 3 on the certificate"]),
        (("matrix", "sites"), ["", "a"], ["6 episodes in the matrix, 3 on the certificate"]),
        (("episodes", 2, "map_sha256"), "m", ["S3: map_sha256 differs"]),
        (("episodes", 0, "others", "braked_hard"), 0.0, ["S1: others differs"]),
        (("episodes", 0, "marks", -1, "grade"), "pass", [f"S1: {LAST}: pass on the certificate, minor from the bag"]),
        (("episodes", 2, "marks", 0, "value"), 9.0, [f"S3: {FIRST}: pass on the certificate, pass from the bag"]),
        (
            ("episodes", 2, "marks", 0, "clause"),
            "~",
            [
                f"S3: {FIRST}: nothing on the certificate, pass from the bag",
                "S3: ~: pass on the certificate, nothing from the bag",
            ],
        ),
        (("episodes", 0, "paper_sha256"), "#q", ["S1: no bag of the paper's driver has the hash #q"]),
        (("episodes", 2, "bag_sha256"), "#q", ["S3: no bag has the hash #q"]),
    ],
)
def test_each_difference_is_named_with_its_place(asked, place, value, said):  # noqa: ARG001 - made in place
    forged = copy.deepcopy(CONTENT)
    inner = forged
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    assert [*differences(forged, BAGS)] == said


def test_a_bag_that_cannot_be_read_is_told_and_other_content_refused(asked, monkeypatch):  # noqa: ARG001
    def fails(made, _):
        raise InputError("bag", str(made.bag), "a bag")

    monkeypatch.setattr(verifying, "sit_in_made_episode", fails)
    assert [one.split("'")[1] for one in differences(CONTENT, BAGS)] == ["new/1", "new/3"]
    with pytest.raises(InputError, match="content of a certificate"):
        differences({"rulebook": "california"}, BAGS)
