import re

from repository import shared_file

from siren_ros.base.numerics.units import mps_from_kmh
from siren_ros.simulation.scenario.paper import PAPER_CONSTANTS, PAPER_SPEEDS


def test_tables_in_the_papers_source_agree():
    text = shared_file("paper", "siren.tex").read_text(encoding="utf-8")

    def cell(label):
        row = next(line for line in re.split(r"\\\\", text) if re.search(label, line) and line.count("&") == 2)
        return [float(number) for number in re.findall(r"\d+\.?\d*", row.rsplit("&", 1)[1].replace("m/s", ""))]

    constants, speeds = PAPER_CONSTANTS, PAPER_SPEEDS
    assert cell("Interaction region") == [constants.region_enter_m, constants.region_leave_m]
    assert cell("Leader query range") == [constants.leader_query_m]
    assert cell("Lane-change cooldown") == [constants.lane_change_cooldown_s]
    assert cell("EMV-passed clearance") == [constants.emv_passed_clearance_m]
    assert cell(r"stop\\_threshold\\_s") == [constants.gap_escape.stop_before_entry_s]
    assert cell(r"blocker\\_grace\\_s") == [constants.gap_escape.blocker_grace_s]
    assert [mps_from_kmh(v) for v in cell("Next-link route-following")] == [speeds.emv_route_follow_mps]
    assert [mps_from_kmh(v) for v in cell("L2 feasible-yield lane change")] == [speeds.civilian_yield_lane_change_mps]
    assert mps_from_kmh(cell("L3 pull-over")[0]) == speeds.civilian_pull_over_mps
