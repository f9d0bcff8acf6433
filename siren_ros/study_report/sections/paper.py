"""Section: the paper's tables next to this study."""

from siren_ros.evaluation.paper_comparison.compared import HEAD, measured
from siren_ros.evaluation.paper_comparison.detection_rows import detection_rows
from siren_ros.evaluation.paper_comparison.prediction_rows import own_level_only, prediction_rows
from siren_ros.evaluation.paper_comparison.risk_rows import risk_rows
from siren_ros.evaluation.paper_comparison.stored_scores import stored
from siren_ros.evaluation.prediction.reports.paper_results import PAPER_NAMES
from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.study_report.commands import command, quoted
from siren_ros.study_report.content import Section, Table
from siren_ros.study_report.measures import StudyMeasures
from siren_ros.study_report.options import PageOptions
from siren_ros.study_report.sections.generated import own_level
from siren_ros.study_report.study_rows import StudyRows


def paper_section(study: StudyRows, measures: StudyMeasures, options: PageOptions) -> Section | None:
    """The paper's numbers that were measured here; None without an episode at its template's own level."""
    counted = own_level_only(measures.prediction, own_level)
    if not counted:
        return None
    detection, risk = options.detection_in(study.folder), options.risk_in(study.folder)
    rows = measured(
        [
            *prediction_rows(score_table(counted)),
            *detection_rows(stored(detection)),
            *risk_rows(None, stored(risk)),
        ]
    )
    text = (
        f"Of the {len(measures.bags)} episodes, {len(counted)} are at their template's own level and count here, as in "
        "the paper, which has one episode of each template. Samples are of the vehicles in the interaction region. "
        "Intervals are 95 % by bootstrap over episodes; the last column says whether the paper's value lies in ours."
    )
    more = [
        f"--{name} {quoted(folder)}"
        for name, folder in (("detection", detection), ("risk", risk))
        if stored(folder) is not None
    ]
    cells = tuple(tuple("–" if cell == "-" else cell for cell in row.cells()) for row in rows)
    table = Table("paper", "The paper's numbers and ours", HEAD, cells, folded=len(cells) > 100)
    models = ",".join(name for name in options.models if name in PAPER_NAMES)
    call = command("compare-paper", study.folder, f"--models {models}", *more)
    return Section("next_to_the_paper", "Next to the paper", (text,), tables=(table,), commands=(call,))
