"""``siren info``, ``siren verify`` and ``siren recover``: what bags hold, whether they are sound, how to save them."""

import argparse
import json
from collections import Counter
from pathlib import Path
from shlex import quote

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables import Table
from siren_ros.cli.command import complain
from siren_ros.data.interfaces import topics
from siren_ros.data.recording.bag_reader import open_bag, read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord, TopicRecord
from siren_ros.data.recording.recover import recover_bag
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_OK, SirenError, shown_text
from siren_ros.scoring.judging.outcome import demand_measures
from siren_ros.scoring.judging.verify import Verification, verify_episode
from siren_ros.simulation.world.actors import ActorClass

LONGEST_LINE = 4000
"""Most characters of a printed line, because the description in a bag of another program may have any length."""


def add_info(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = "Shows an episode's description, its outcome, its topics with counts and rates, and its events."
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of a recorded episode")
    verb.set_defaults(run=info)


def info(arguments: argparse.Namespace) -> int:
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
        ("sensors", f"{episode.sensor_suite}{_sensed_by(bag)}, preset {episode.preset}"),
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


def _sensed_by(bag: Path) -> str:
    """Which other simulator sensed, where one did."""
    with open_bag(bag) as opened:
        told = [json.loads(message.read().data) for message in opened.messages({topics.SENSING.name})]
    names = {str(suite["simulator"]) for suites in told for suite in suites.values() if "simulator" in suite}
    return f", sensed by {' and '.join(sorted(names))}" if names else ""


def _plain(value: object) -> str:
    """A value as text for people: numbers with six digits, lists as words."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return " ".join(str(part) for part in value) if isinstance(value, (list, tuple)) else str(value)


def _topics(record: EpisodeRecord) -> list[str]:
    topics = record.topics.values()
    rows = tuple((each.name, each.type_name, str(each.count), _rate(each), _size(each.size_bytes)) for each in topics)
    return Table("topics", "", ("topic", "type", "count", "rate", "size"), rows).text()


def _rate(topic: TopicRecord) -> str:
    if topic.count < 2:
        return "once"
    span_s = float(topic.times_ns[-1] - topic.times_ns[0]) / 1e9
    return f"{(topic.count - 1) / span_s:.4g} Hz" if span_s > 0.0 else "once"


def _events(record: EpisodeRecord) -> list[str]:
    counts = Counter(event.kind.value for event in record.events)
    lines = [f"{name} × {count}" for name, count in sorted(counts.items())] or ["none"]
    return [f"{'' if row else 'events':<10}{line}" for row, line in enumerate(lines)]


def _size(size_bytes: int) -> str:
    """A size with a decimal unit, as for disks."""
    size = float(size_bytes)
    for unit in ("B", "kB", "MB"):
        if size < 1000.0:
            return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1000.0
    return f"{size:.2f} GB"


def add_verify(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Evaluates the predicate of the episode's template on the record alone, and checks motion, ownership, "
        "residuals, message counts, stamps and hashes. The exit code is 1 if anything fails."
    )
    verb.add_argument("bags", type=Path, metavar="BAG", nargs="+", help="folder of a recorded episode")
    verb.add_argument("-q", "--quiet", action="store_true", help="print only one line for each bag and what fails")
    verb.set_defaults(run=verify)


def verify(arguments: argparse.Namespace) -> int:
    """Verifies every bag; a bag that cannot be read does not keep the others from being verified."""
    worst = EXIT_OK
    for bag in arguments.bags:
        try:
            record = read_episode(bag)
            verification = verify_episode(record)
        except SirenError as error:
            complain(f"siren verify: {error}")
            worst = max(worst, error.exit_code)
            continue
        print("\n".join(_report(bag, verification, quiet=arguments.quiet)))
        for name, value in () if arguments.quiet else sorted(demand_measures(record).items()):
            print(f"  {name}: {value}")
        worst = max(worst, EXIT_OK if verification.holds else EXIT_FAILED)
    return min(worst, EXIT_BAD_INPUT)


def _report(bag: Path, verification: Verification, quiet: bool) -> list[str]:
    word = "holds" if verification.holds else "FAILS"
    lines = [f"{bag}: {word}: {verification.verdict.text}"]
    for title, parts in (("interaction", verification.verdict.parts), ("record", verification.checks)):
        shown = [part for part in parts if not (quiet and part.holds)]
        lines += [f"  {title}"] if shown and not quiet else []
        for part in shown:
            lines.append(f"    {'ok  ' if part.holds else 'FAIL'}  {part}")
            if (moment := part.decisive) and not part.holds:
                seconds = f"{moment.step * STEP_S:g}"
                lines.append(f"          siren view {quote(str(bag))} --time-s {seconds} --actor {moment.actor_id}")
    for emv_id, verdict in ({} if quiet else verification.others).items():
        lines += [f"  EMV {emv_id}: {'holds' if verdict.holds else 'does not hold'}: {verdict.text}"]
        lines += [f"    {'ok  ' if part.holds else 'no  '}  {part}" for part in verdict.parts]
    return lines


def add_recover(verb: argparse.ArgumentParser) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Writes a complete bag from all complete chunks of a bag that was cut off or damaged. A complete bag stays as "
        "it is. The exit code is 1 if messages of the file are lost."
    )
    verb.add_argument("bag", type=Path, metavar="BAG", help="folder of the bag, or the name that it should have")
    verb.add_argument("--out", type=Path, metavar="FOLDER", help="new folder (default: BAG.partial next to the bag)")
    verb.set_defaults(run=recover)


def recover(arguments: argparse.Namespace) -> int:
    """Completes the bag and says what was saved."""
    recovery = recover_bag(arguments.bag, arguments.out)
    count = f"{recovery.messages} messages, {recovery.steps} steps"
    if recovery.healthy:
        print(f"{recovery.path}: complete as it is: {count}")
        return EXIT_OK
    print(f"{recovery.path}: saved {count}")
    if recovery.restored:
        print(f"  {recovery.restored} of them from their second copies at the end of the damaged file")
    if recovery.lost_messages:
        complain(f"siren recover: {recovery.lost_messages} messages are lost: {recovery.lost}")
    elif recovery.lost and not recovery.restored:
        complain(f"siren recover: the unfinished end is lost: {recovery.lost}")
    if not recovery.described:
        complain("siren recover: without its description or its map the bag is no episode any more")
    return EXIT_FAILED if recovery.lost_messages else EXIT_OK
