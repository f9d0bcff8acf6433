"""An episode of formulas on the small crossing: an EMV, a car that comes late and a bus that leaves."""

from dataclasses import replace

from evaluation.made_records import moving, record_with
from hand_made_record import STRAIGHT, crossing, traffic_of

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.tracks import Track, tracks_of
from siren_ros.simulation.world.actors import ActorClass, TrafficState

FRAMES = 21
"""The car is there from frame 5 on, the bus up to frame 9."""
LANE = 1


def made_record() -> EpisodeRecord:
    """41 steps; the signal's movement straight on is red, and green from step 20 on."""
    tracks = {
        1: moving(0.0, 0.0, 10.0, steps=41, is_emv=True, actor_class=ActorClass.AMBULANCE, length_m=6.0),
        5: moving(20.0, 3.0, 8.0, accel_mps2=0.5, yaw_rad=1.0, steps=31, first_step=10, length_m=4.0),
        9: moving(-20.0, -3.0, 5.0, yaw_rad=2.0, steps=19, actor_class=ActorClass.BUS, length_m=12.0),
    }
    record = record_with(tracks, crossing())
    return replace(record, traffic=tuple(_shown(step) for step in range(41)))


def _shown(step: int) -> TrafficState:
    letters = ["r"] * 7
    letters[STRAIGHT] = "G" if step >= 20 else "y"
    return traffic_of(step, "".join(letters))


def made_tracks() -> tuple[Track, ...]:
    """Of the EMV, the car and the bus."""
    return tracks_of(made_record())
