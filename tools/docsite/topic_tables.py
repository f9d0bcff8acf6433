"""Tables of the topics, section by section: what the nodes' table says of each, and the text that stands below it."""

import ast
from itertools import pairwise
from pathlib import Path
from typing import Final

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.topics import Topic

SECTIONS: Final = {
    "episode": (
        "CLOCK",
        "EPISODE",
        "MAP",
        "TRAFFIC",
        "ROSTER",
        "EMV_COMMANDS",
        "YIELD_COMMANDS",
        "ACTORS",
        "EVENTS",
        "STEP_DONE",
        "EPISODE_END",
        "OUTCOME",
    ),
    "carrier": ("TF", "TF_STATIC", "SENSING", "ODOMETRY", "GROUND_TRUTH", "BOXES", "MARKERS"),
    "sensor": (
        "LIDAR",
        "IMAGE_COMPRESSED",
        "CAMERA_INFO",
        "IMAGE",
        "IMAGE_DEPTH",
        "IMAGE_SEMANTIC",
        "IMAGE_INSTANCE",
        "IMAGE_TRUTH",
        "IMAGE_BOXES",
        "GNSS",
        "IMU",
        "AUDIO",
    ),
    "av": ("AV_ROUTE", "ODOMETRY", "GROUND_TRUTH", "BOXES", "AV_CONTROL"),
    "detector": ("DETECTIONS", "DETECTION_LATENCY"),
    "predictor": ("PREDICTIONS",),
}
"""Names of the topics of each table in ``siren_ros/data/interfaces/topics.py``."""
_OPTIONAL: Final = frozenset({"IMAGE_DEPTH", "IMAGE_SEMANTIC", "IMAGE_INSTANCE", "IMAGE_TRUTH", "IMAGE_BOXES"})
_OTHER_PUBLISHERS: Final = {
    "STEP_DONE": "every participant",
    "AV_CONTROL": "**your controller**",
    "PREDICTIONS": "**your predictor**",
}
_HEAD: Final = "| topic | content | type | published by | rate | in the bag |\n|---|---|---|---|---|---|"


def texts_of(source: str, owner: str = "") -> dict[str, str]:
    """The text below each name that a module, or a class in it, assigns with its type, by name."""
    body = ast.parse(source).body
    if owner:
        (body,) = (node.body for node in body if isinstance(node, ast.ClassDef) and node.name == owner)
    return {
        first.target.id: " ".join(after.value.value.split())
        for first, after in pairwise(body)
        if isinstance(first, ast.AnnAssign)
        and isinstance(first.target, ast.Name)
        and isinstance(after, ast.Expr)
        and isinstance(after.value, ast.Constant)
        and isinstance(after.value.value, str)
    }


def topic_table(section: str) -> str:
    """The table of a section as Markdown."""
    texts = texts_of(Path(topics.__file__).read_text(encoding="utf-8"))
    return "\n".join([_HEAD, *(_row(section, name, texts[name]) for name in SECTIONS[section])])


def _row(section: str, name: str, text: str) -> str:
    topic: Topic = getattr(topics, name)
    if section == "av":
        topic = topic.of_carrier(topics.AV_CARRIER)
    cells = (
        f"`{topic.name.format(sensor='SENSOR')}`",
        text.replace("``", "`").removesuffix("."),
        f"`{topic.type_name.replace('/msg/', '/')}`",
        _OTHER_PUBLISHERS.get(name, f"`{topic.publisher}`"),
        "once" if topic.latched else f"{20 // topic.period_steps} Hz",
        _in_the_bag(name, topic),
    )
    return f"| {' | '.join(cells)} |"


def _in_the_bag(name: str, topic: Topic) -> str:
    if name in _OPTIONAL:
        return "if the suite says so"
    if name == "EPISODE_END":
        return "written by the recorder"
    return "yes" if topic.recorded else "no"
