"""``docs/paper.md`` held against the code: the symbols that it names exist, and its numbers are the code's."""

import ast
import re
from itertools import pairwise

import pytest
from repository import REPOSITORY
from test_architecture import names_defined_in

from siren_ros.base.numerics.units import mps_from_kmh
from siren_ros.scoring.evaluation.prediction.metrics import METRICS
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, future_times_s
from siren_ros.simulation.conflicts.yielding import MOST_BRAKE_MPS2
from siren_ros.simulation.scenario.paper import (
    LEVEL_POLICIES,
    PAPER_CONSTANTS,
    PAPER_SPEEDS,
    TEMPLATES,
    CivilianResponse,
    EmergencyLevel,
)
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.scenario.templates import load_template


def shown(page: str) -> str:
    """A page without its comments."""
    return re.sub(r"<!--.*?-->", "", (REPOSITORY / page).read_text(encoding="utf-8"), flags=re.DOTALL)


TEXT = re.sub(r" *\| *", " | ", re.sub(r"\s+", " ", shown("docs/paper.md")))
LEVELS = (REPOSITORY / "docs" / "behaviour.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("path", "symbol"), sorted(set(re.findall(r"`(siren_ros/[\w/]+\.py)` `([\w.]+)`", TEXT))))
def test_symbols_are_where_the_document_says(path: str, symbol: str) -> None:
    inside = ast.parse((REPOSITORY / path).read_text(encoding="utf-8")).body
    for name in symbol.split("."):
        names = names_defined_in(inside)
        assert name in names
        inside = names[name]


def numbers_in(pattern: str) -> list[float]:
    """The numbers of the one place of the page that a pattern fits."""
    (found,) = re.findall(pattern, TEXT)
    return [float(number) for number in ([found] if isinstance(found, str) else found)]


@pytest.mark.parametrize("name", TEMPLATES)
def test_templates_have_the_numbers_of_the_page(name: str) -> None:
    template = load_template(name)
    vehicles = numbers_in(r"interaction, " + ", ".join([r"(\d+)"] * 7) + " background vehicles")
    assert template.value("demand.background_vehicles") == vehicles[int(name[1]) - 1]
    shortest_s, longest_s = numbers_in(r"\| (\d+) to (\d+) s, states at 10 Hz")
    if name == "S1":
        shortest_s = longest_s = numbers_in(r"S1 lasts (\d+) s")[0]
    assert shortest_s <= template.duration_s <= longest_s
    (limit_kmh,) = numbers_in(r"the templates lower all limits to (\d+) km/h")
    assert template.value("demand.speed_limit_mps") == pytest.approx(mps_from_kmh(limit_kmh), abs=1e-3)
    assert template.value("demand.speed_factor") == 1.0
    assert template.value("emv.speed_mps") == pytest.approx(PAPER_SPEEDS.emv_route_follow_mps, abs=1e-3)
    assert template.value("response.compliance") == 1.0
    same = {"demand.background_vehicles", "demand.speed_limit_mps", "demand.speed_factor", "response.compliance"}
    assert not same & template.drawn.keys(), "seeds draw what the page calls the paper's"


@pytest.mark.parametrize("name", TEMPLATES)
def test_seeds_draw_what_the_page_says(name: str) -> None:
    drawn = load_template(name).drawn
    speeds_kmh = numbers_in(r"draws a speed from (\d+) to (\d+) km/h")
    (delay_s, *distances_m) = numbers_in(r"each seed draws them, up to (\d+) s and from (\d+) to (\d+) m")
    expected = {
        "emv.speed_mps": pytest.approx([mps_from_kmh(speed) for speed in speeds_kmh], abs=0.05),
        "response.extra_delay_s": [0.0, delay_s],
        "response.response_distance_m": distances_m,
    }
    assert {path: [drawn[path].minimum, drawn[path].maximum] for path in expected} == expected


def test_the_default_preset_is_what_the_page_says() -> None:
    preset = load_preset("paper")
    assert "all drivers of an episode comply, with one delay and one distance" in TEXT
    assert (preset.compliance.complies, preset.reaction_delay_s.std, preset.response_distance_m.std) == (1.0, 0.0, 0.0)
    assert (preset.reaction_delay_s.mean, preset.response_distance_m.mean) == (0.0, PAPER_CONSTANTS.region_enter_m)


def test_levels_are_those_of_the_page() -> None:
    rows = re.findall(r"^\|(L\d)\|(on|off)\|[^|]+\|([^|]+)\|$", LEVELS, re.MULTILINE)
    responses = {
        "do not react": CivilianResponse.NOMINAL,
        "change out of": CivilianResponse.FEASIBLE_YIELD,
        "pull over to": CivilianResponse.PULL_OVER,
    }
    for name, siren, response in rows:
        policy = LEVEL_POLICIES[EmergencyLevel[name]]
        assert policy.siren == (siren == "on")
        assert policy.response is responses[" ".join(response.split()[:3])]
        assert policy.privileged == (name != "L0")
        assert policy.corridor == (name == "L3")
    assert [row[0] for row in rows] == list(EmergencyLevel.__members__)
    assert "SUMO's bluelight device, which makes the list in the paper, does not run" in TEXT


def test_speeds_and_brakes_are_those_of_the_page() -> None:
    (around_kmh,) = numbers_in(r"drawn per driver, around (\d+) km/h, or less where it cannot see")
    assert around_kmh == pytest.approx(3.6 * load_preset("paper").attention.emv_line_mps.mean, abs=0.01)
    assert numbers_in(r"their ways meet, with up to (\d+) m/s²") == [MOST_BRAKE_MPS2]


def test_the_protocol_is_that_of_the_page() -> None:
    history_s, future_s, period_s = numbers_in(r"same: (\d) s of history, (\d) s of future, (0\.\d) s apart")
    times_s = [*HistoryWindow().times_s, *future_times_s()]
    assert (times_s[0], times_s[-1]) == pytest.approx((-history_s, future_s))
    assert [after - before for before, after in pairwise(times_s)] == pytest.approx([period_s] * (len(times_s) - 1))
    names = {"ade_m": "ADE", "fde_m": "FDE", "min_ade_6_m": "minADE", "min_fde_6_m": "minFDE", "rmse_5s_m": "RMSE"}
    assert f"| {', '.join(names.values())} |" in TEXT
    assert names.keys() <= {metric.name for metric in METRICS}
