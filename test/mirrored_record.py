"""The record of the same episode where traffic keeps left."""

from dataclasses import replace

from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.mirror_image import mirrored_network
from siren_ros.world.mirror_image import mirror_image


def mirrored_record(record: EpisodeRecord) -> EpisodeRecord:
    """The mirror image about the x axis."""
    return replace(
        record,
        network=mirrored_network(record.network),
        states=tuple(map(mirror_image, record.states)),
        traffic=tuple(map(mirror_image, record.traffic)),
        commands={source: tuple(map(mirror_image, rows)) for source, rows in record.commands.items()},
        events=tuple(map(mirror_image, record.events)),
    )
