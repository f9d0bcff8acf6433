"""The card of a dataset: ``dataset.json`` for programs and ``README.md`` for people."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import siren_ros
from siren_ros.datasets.exporting.format import EpisodePart, Format
from siren_ros.datasets.exporting.splits import SPLITS
from siren_ros.datasets.exporting.survey import BagSurvey

CARD_FILE: Final = "dataset.json"
README_FILE: Final = "README.md"
NO_LICENCE: Final = (
    "not stated by whoever made this dataset (--licence states it); SIREN is Apache-2.0, and a map that was not made "
    "by SIREN keeps its own licence"
)


def card(
    made: Format,
    options: Mapping[str, str],
    surveys: Sequence[BagSurvey],
    parts: Sequence[EpisodePart],
    licence: str,
) -> dict[str, Any]:
    """The card as JSON types. No time, no host, no path: the same bags give the same card."""
    words = [f"--{name} {value}" for name, value in options.items()]
    counts: Counter[str] = Counter()
    classes: Counter[str] = Counter()
    for part in parts:
        counts.update(part.report.counts)
        classes.update(part.report.classes)
    return {
        "format": made.name,
        "what": made.summary,
        "made_with": {
            "command": " ".join(["siren export", made.name, *words, "BAG…", "--out", "DIR"]),
            "siren_ros": siren_ros.__version__,
            "options": dict(options),
        },
        "licence": licence or NO_LICENCE,
        "episodes": [
            {
                "id": part.episode_id,
                "split": part.split,
                **survey.episode,
                "bag_sha256": survey.sha256,
                "lost": survey.note,
                "counts": dict(part.report.counts),
            }
            for survey, part in zip(surveys, parts, strict=True)
        ],
        "splits": {split: [part.episode_id for part in parts if part.split == split] for split in SPLITS},
        "counts": dict(counts),
        "classes": dict(sorted(classes.items())),
    }


def readme(content: Mapping[str, Any]) -> str:
    """The same for people."""
    lines = [
        f"# SIREN dataset, format {content['format']}",
        "",
        f"{content['what']}.",
        "",
        f"Made by SIREN {content['made_with']['siren_ros']} with `{content['made_with']['command']}`.",
        "The episodes are recorded simulations of an emergency vehicle in traffic, not measurements of real traffic.",
        "",
        f"Licence: {content['licence']}.",
        "",
        "## Counts",
        "",
        "| | |",
        "|---|---|",
        f"| episodes | {len(content['episodes'])} |",
        *(f"| {name} | {count} |" for name, count in content["counts"].items()),
        "",
    ]
    if content["classes"]:
        lines += ["| class | labels |", "|---|---|"]
        lines += [f"| {name} | {count} |" for name, count in content["classes"].items()]
        lines.append("")
    lines += [
        "## Splits",
        "",
        "Whole episodes; those of one seed on one map are in one split.",
        "",
        *(f"* {split}: {', '.join(names) or 'none'}" for split, names in content["splits"].items()),
        "",
        "## Episodes",
        "",
        "| episode | map (SHA-256) | suite | ended | bag (SHA-256) |",
        "|---|---|---|---|---|",
        *map(_row, content["episodes"]),
        "",
        "The first episode is recorded again with",
        "",
        f"    {content['episodes'][0]['recorded_with']}",
        "",
        f"`{CARD_FILE}` holds all of this for programs, with whole hashes, versions and every command.",
    ]
    lost = [f"* {one['id']}: {one['lost']}" for one in content["episodes"] if one["lost"]]
    if lost:
        lines += ["", "## Not whole", "", *lost]
    return "\n".join(lines) + "\n"


def _row(one: Mapping[str, Any]) -> str:
    hashes = [f"{one[key][:12]}…" for key in ("map_sha256", "bag_sha256")]
    return f"| {one['id']} | {one['map']} ({hashes[0]}) | {one['sensor_suite']} | {one['ended']} | {hashes[1]} |"


def write_card(folder: Path, content: Mapping[str, Any]) -> None:
    """Writes both files into a dataset's folder; a README that the format wrote there stays at its head."""
    (folder / CARD_FILE).write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    file = folder / README_FILE
    own = file.read_text(encoding="utf-8") + "\n" if file.exists() else ""
    file.unlink(missing_ok=True)
    file.write_text(own + readme(content), encoding="utf-8")
