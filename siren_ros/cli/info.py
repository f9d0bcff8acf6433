"""``siren info BAG``: what an episode is and what its bag holds."""

import argparse
from collections import Counter
from pathlib import Path

from siren_ros.errors import EXIT_OK
from siren_ros.interfaces.messages import shown_text
from siren_ros.recording.bag_reader import read_episode
from siren_ros.recording.episode_record import EpisodeRecord, TopicRecord
from siren_ros.world.actors import ActorClass

LONGEST_LINE = 4000
"""Characters; the description of a bag of another program may hold any."""


def add_arguments(verb: argparse.ArgumentParser) -> None:
    """Describe the verb, and what it takes."""
    verb.description = "Shows an episode's description, its outcome, its topics with counts and rates, and its events."
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Prints the report."""
    bag: Path = arguments.bag
    record = read_episode(bag)
    size = sum(file.stat().st_size for file in bag.iterdir() if file.is_file())
    lines = [*_head(record, bag, size), "", *_topics(record), "", *_events(record)]
    print("\n".join(shown_text(line, most=LONGEST_LINE) for line in lines))
    return EXIT_OK


def _head(record: EpisodeRecord, bag: Path, size_bytes: int) -> list[str]:
    episode = record.description
    classes = Counter(ActorClass(actor.actor_class).name.lower() for actor in record.actors.values())
    lines = [
        ("bag", f"{bag} ({_size(size_bytes)})"),
        ("episode", f"template {episode.template}, level {episode.level.name}, seed {episode.seed}"),
        ("map", f"{episode.map_name} (SHA-256 {episode.map_sha256[:12]}…)"),
        ("sensors", f"{episode.sensor_suite}, preset {episode.preset}"),
        ("duration", f"{record.duration_s:.2f} s of {episode.duration_s:.2f} s, {record.steps} steps"),
        ("actors", f"{len(record.actors)}: " + ", ".join(f"{count} {name}" for name, count in sorted(classes.items()))),
        ("EMV", ", ".join(str(emv_id) for emv_id in record.emv_ids) or "none"),
        ("versions", ", ".join(f"{name} {version}" for name, version in sorted(episode.versions.items())) or "unknown"),
        (
            "site",
            ", ".join(f"{key} {_plain(value)}" for key, value in sorted(episode.site.items()) if value) or "unknown",
        ),
    ]
    outcome = record.outcome
    if outcome is None:
        lines.append(("outcome", "none: the episode did not reach its end"))
    else:
        held = {True: "interaction verified", False: "interaction not found", None: "not judged"}
        reason = f" ({outcome.reason})" if outcome.reason else ""
        lines.append(("outcome", f"{outcome.end}{reason}, {held[outcome.predicate_holds]}"))
        lines += [("", f"{name} = {_plain(value)}") for name, value in sorted(outcome.measures.items())]
    return [f"{name:<10}{text}" for name, text in lines]


def _plain(value: object) -> str:
    """A value for people: numbers with six digits, lists as words."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return " ".join(str(part) for part in value) if isinstance(value, (list, tuple)) else str(value)


def _topics(record: EpisodeRecord) -> list[str]:
    rows = [
        (topic.name, topic.type_name, str(topic.count), _rate(topic), _size(topic.size_bytes))
        for topic in record.topics.values()
    ]
    head = ("topic", "type", "count", "rate", "size")
    widths = [max(len(row[column]) for row in (head, *rows)) for column in range(len(head))]
    return [
        "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in (head, *rows)
    ]


def _rate(topic: TopicRecord) -> str:
    if topic.count < 2:
        return "once"
    span_s = float(topic.times_ns[-1] - topic.times_ns[0]) / 1e9
    return f"{(topic.count - 1) / span_s:.4g} Hz" if span_s > 0.0 else "once"


def _events(record: EpisodeRecord) -> list[str]:
    counts = Counter(event.kind.value for event in record.events)
    if not counts:
        return ["events    none"]
    return [
        f"{'events' if not row else '':<10}{name} × {count}" for row, (name, count) in enumerate(sorted(counts.items()))
    ]


def _size(size_bytes: int) -> str:
    """The size with a decimal unit, as disks are sold."""
    size = float(size_bytes)
    for unit in ("B", "kB", "MB"):
        if size < 1000.0:
            return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1000.0
    return f"{size:.2f} GB"
