"""The card of a set: what it is, how it was made and found, counts, sources of the thresholds."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from siren_ros.errors import whole_file
from siren_ros.evaluation.risk.risk_class import TITLES, RiskClass
from siren_ros.evaluation.risk.video_set import EVIDENCE_FILE, SET_FILE, VIDEO_FRAMES, VideoSet
from siren_ros.generation.episode_setup import present_versions
from siren_ros.studies.risk_set.balance import Balance
from siren_ros.studies.risk_set.search import Search


def write_set_card(videos: VideoSet, searches: Mapping[str, Search], balance: Balance, map_name: str) -> None:
    """Writes dataset.json and README.md into the set's folder."""
    content = card_content(videos, searches, balance, map_name)
    text = json.dumps(content, indent=1, sort_keys=True) + "\n"
    for name, written in (("dataset.json", text), ("README.md", _readme(content))):
        with whole_file(videos.folder / name) as file:
            file.write_text(written, encoding="utf-8")


def card_content(videos: VideoSet, searches: Mapping[str, Search], balance: Balance, map_name: str) -> dict[str, Any]:
    """The card as JSON types; counts are Normal, Near-Miss, Collision."""
    counts = {name: [0, 0, 0] for name in searches}
    for video in videos.videos.values():
        counts[video.template][video.label.risk] += 1
    return {
        "name": "SIREN risk videos",
        "videos": len(videos.videos),
        "frames": VIDEO_FRAMES,
        "rate_hz": 10,
        "map": map_name,
        "classes": list(TITLES),
        "asked_for": list(balance.total),
        "counts": [sum(row[risk] for row in counts.values()) for risk in RiskClass],
        "by_template": {
            name: {"counts": counts[name], "candidates": len(search.trials), "found": list(search.found)}
            for name, search in searches.items()
        },
        "thresholds": asdict(videos.thresholds),
        "versions": dict(present_versions()),
        "license": "Apache-2.0",
    }


def _readme(content: Mapping[str, Any]) -> str:
    rows = [
        f"| {name} | {' | '.join(str(count) for count in one['counts'])} | {one['candidates']} | "
        f"{' / '.join(str(count) for count in one['found'])} |"
        for name, one in content["by_template"].items()
    ]
    limits = [f"| `{name}` | {value:g} |" for name, value in content["thresholds"].items()]
    counts, asked = (" / ".join(str(count) for count in content[key]) for key in ("counts", "asked_for"))
    about = (
        f"{content['videos']} videos of the EMV's front camera, {content['frames']} frames each at 10 Hz, on the map "
        f"{content['map']}. Classes {', '.join(content['classes'])}: {counts}; asked for: {asked}."
    )
    made = (
        "Nothing is scripted. Candidates were simulated without sensors, with drawn parameters (speed of the EMV, "
        "density, compliance, reaction, attention of the drivers), until each class had its videos; the label of each "
        "was then derived from its record. The window of 19 s lies so that the decisive moment is at a drawn place "
        "between 40 and 80 % of the video."
    )
    files = (
        f"`{SET_FILE}` has each video's label, what decided it and when, and the request that makes its episode again. "
        f"`{EVIDENCE_FILE}` has every moment of a collision course with a civilian in view, so that other thresholds "
        "can be tried: `siren label`. `masks/` has the actor of each pixel of the nine key frames."
    )
    table = ["| template | Normal | Near-Miss | Collision | candidates | found |", "|---|---|---|---|---|---|", *rows]
    values = ["| threshold | value |", "|---|---|", *limits]
    parts = [[f"# {content['name']}"], [about], [made], table, [files], values, [f"Licence: {content['license']}."]]
    return "\n\n".join("\n".join(part) for part in parts) + "\n"
