"""Section: the paper's tables next to this study."""

from collections.abc import Iterator, Sequence

from siren_ros.evaluation.paper_comparison.compared import Compared, measured
from siren_ros.evaluation.paper_comparison.detection_rows import detection_rows
from siren_ros.evaluation.paper_comparison.prediction_rows import own_level_only, prediction_rows
from siren_ros.evaluation.paper_comparison.risk_rows import risk_rows
from siren_ros.evaluation.paper_comparison.stored_scores import stored
from siren_ros.evaluation.prediction.reports.paper_comparison import maps_next_to_the_papers
from siren_ros.evaluation.prediction.reports.paper_results import PAPER_NAMES
from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.study_report.cells import NONE, with_interval
from siren_ros.study_report.cells import number as number_of
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
        "the paper, which has one episode of each template. Samples are of the vehicles in the interaction region; "
        f"{maps_next_to_the_papers(counted)}. "
        "Intervals are 95 % over episodes; a star says that the paper's value lies in ours."
    )
    more = [
        f"--{name} {quoted(folder)}"
        for name, folder in (("detection", detection), ("risk", risk))
        if stored(folder) is not None
    ]
    models = ",".join(name for name in options.models if name in PAPER_NAMES)
    call = command("compare-paper", study.folder, f"--models {models}", *more)
    return Section("next_to_the_paper", "Next to the paper", (text,), tables=tuple(_tables(rows)), commands=(call,))


def _tables(rows: Sequence[Compared]) -> Iterator[Table]:
    """A table for each of the paper's: two rows for each of its rows, the paper's and ours."""
    for number, name in enumerate(dict.fromkeys(row.table for row in rows)):
        of_table = [row for row in rows if row.table == name]
        columns = list(dict.fromkeys(row.column for row in of_table))
        lines = []
        for model in dict.fromkeys(row.row for row in of_table):
            cells = {row.column: row for row in of_table if row.row == model}
            there = [cells.get(column) for column in columns]
            lines.append((f"{model}, paper", *(number_of(one.paper, one.digits) if one else NONE for one in there)))
            lines.append((f"{model}, here", *(_ours(one) if one else NONE for one in there)))
        yield Table(f"paper_{number}", _capitalised(name), ("", *columns), tuple(lines))


def _capitalised(name: str) -> str:
    """With a capital, where the first word has none anyway: not ``MAP`` for ``mAP``."""
    return f"{name[:1].upper()}{name[1:]}" if name.partition(" ")[0].islower() else name


def _ours(row: Compared) -> str:
    return with_interval(row.ours, row.digits) + (" *" if row.inside else "")
