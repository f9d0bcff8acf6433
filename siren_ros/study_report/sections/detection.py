"""Section: 3-D detection, from the scores that ``siren evaluate detection`` wrote."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from siren_ros.evaluation.detection.metrics.devkit_score import ERRORS
from siren_ros.evaluation.paper_comparison.stored_scores import interval_in
from siren_ros.study_report.cells import number, with_interval
from siren_ros.study_report.commands import command, quoted
from siren_ros.study_report.content import Section, Table
from siren_ros.study_report.stored_tables import stored_tables
from siren_ros.study_report.study_rows import StudyRows


def detection_section(study: StudyRows, folder: Path) -> Section | None:
    """The detectors' scores; None where there are none."""
    tables = stored_tables("detection", folder, _tables)
    if tables is None:
        return None
    text = (
        "nuScenes' own code and the paper's protocol: one class for all vehicles, labels within 50 m with at least one "
        "LiDAR point. Intervals are 95 % over episodes."
    )
    call = command("evaluate detection", study.folder, f"--detections NAME=FILE --out {quoted(folder)}")
    return Section("detection", "Task: 3-D detection", (text,), tables=tables, commands=(call,))


def _tables(content: Mapping[str, Any]) -> Iterator[Table]:
    templates = list(dict.fromkeys(name for one in content.values() for name in one["templates"]))
    rows = [
        (
            name,
            *(_ap_nds(one["templates"].get(template)) for template in templates),
            f"{with_interval(interval_in(one['mean']['mAP']), 3)} / {number(one['mean']['NDS'], 3)}",
        )
        for name, one in content.items()
    ]
    yield Table("detection_templates", "mAP / NDS by template", ("detector", *templates, "mean"), tuple(rows))
    rows = [
        (name, template, *(number(of_template["errors"].get(error), 3) for error in ERRORS))
        for name, one in content.items()
        for template, of_template in one["templates"].items()
    ]
    head = ("detector", "template", *ERRORS)
    yield Table("detection_errors", "True-positive errors", head, tuple(rows), folded=True)
    rows = [
        (name, part["of"], part["name"], f"{part['labels']:,}", with_interval(interval_in(part["mAP"]), 3))
        for name, one in content.items()
        for part in one["parts"]
        if part["labels"]
    ]
    if rows:
        head = ("detector", "of", "labels that are", "labels", "mAP")
        yield Table("detection_parts", "mAP of parts of the labels", head, tuple(rows), folded=True)


def _ap_nds(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return number(None)
    return f"{number(interval_in(found['mAP']).value, 3)} / {number(found['NDS'], 3)}"
