"""The commands of the controllers to the vehicles at one step, as a structure of arrays."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Brief, Codes, Floats, Ids, dtypes_of
from siren_ros.errors import EpisodeError
from siren_ros.simulation.world.actors import LEFTWARD, PARTS, SIDED, Event, Lights, Mode, Owner

CommandRow = tuple[int, int, float, float, float, bool, int, int]
"""Id, owner, throttle, brake, wheel angle, hand brake, mode and lights of one actor."""


@dataclass(frozen=True)
class VehicleCommands(Brief):
    """Commands of one controller at one step; rows sorted by ``actor_id``.

    A row with ``owner`` ROS drives the actor by throttle, brake and steering from this step on. One with ``owner`` SUMO
    hands it back (or leaves it there) and only sets mode and lights. Actors without a row belong to SUMO and are in
    mode NOMINAL.
    """

    step: int
    source: str
    """Name of the controlling node."""
    actor_id: Ids
    owner: Codes
    throttle: Floats
    """Throttle pedal, 0–1."""
    brake: Floats
    """Brake pedal, 0–1."""
    steer_rad: Floats = field(metadata=LEFTWARD)
    """Wanted road-wheel angle, left positive."""
    hand_brake: Codes
    mode: Codes
    lights: Codes = field(metadata=SIDED)
    """Lights to show. The vehicle itself adds the brake light."""
    events: tuple[Event, ...] = field(default=(), metadata=PARTS)

    def __len__(self) -> int:
        return len(self.actor_id)

    @classmethod
    def of(
        cls, step: int, source: str, rows: Sequence[CommandRow], events: tuple[Event, ...] = ()
    ) -> "VehicleCommands":
        """The commands of some actors, sorted by id."""
        arrays = _NO_COMMANDS
        if rows:
            named = zip(COMMAND_DTYPES.items(), zip(*rows, strict=True), strict=True)
            arrays = {name: np.array(column, dtype) for (name, dtype), column in named}
        return cls(step=step, source=source, events=events, **arrays)

    @classmethod
    def empty(cls, step: int, source: str, events: tuple[Event, ...] = ()) -> "VehicleCommands":
        """Commands of a controller that drives no vehicle at this step."""
        return cls.of(step, source, (), events)


COMMAND_DTYPES: Final = dtypes_of(VehicleCommands)
"""Array fields of VehicleCommands and their element types, in declaration order."""
_NO_COMMANDS: Final[dict[str, Any]] = {name: np.empty(0, dtype) for name, dtype in COMMAND_DTYPES.items()}


AV_SOURCE: Final = "av_controller"
"""Name of the external controller of the AV under test, in the lockstep and in the record."""
_LARGEST_STEER_RAD: Final = math.pi / 2.0
"""Wheels do not turn further on any vehicle; the vehicle's own limit is far below it."""
_WARNING_LIGHTS: Final = int(Lights.BEACON | Lights.SIREN)


@dataclass(frozen=True)
class AvControl:
    """The command of an external controller to the AV under test. It answers one step and holds until the next."""

    step: int
    throttle: float = 0.0
    """Throttle pedal, 0–1."""
    brake: float = 0.0
    """Brake pedal, 0–1."""
    steer_rad: float = field(default=0.0, metadata=LEFTWARD)
    """Wanted road-wheel angle, left positive; the vehicle's steering limits it."""
    lights: int = field(default=int(Lights.NONE), metadata=SIDED)
    """Indicators to show. The vehicle itself adds the brake light."""

    def check(self) -> None:
        """Refuses commands that no vehicle could carry out.

        Raises:
            EpisodeError: Names the field, its value and what is allowed.
        """
        both = f"throttle {self.throttle!r} and brake {self.brake!r}"
        angle = f"an angle of the road wheels of at most {_LARGEST_STEER_RAD:.4f} rad"
        for usable, given, allowed in (
            (0.0 <= self.throttle <= 1.0, f"throttle {self.throttle!r}", "a number from 0 to 1"),
            (0.0 <= self.brake <= 1.0, f"brake {self.brake!r}", "a number from 0 to 1"),
            (not (self.throttle and self.brake), both, "one of the two pedals"),
            (abs(self.steer_rad) <= _LARGEST_STEER_RAD, f"steer_rad {self.steer_rad!r}", angle),
            (not self.lights & ~int(Lights.INDICATORS), f"lights {self.lights}", "0, 2, 4 or 6"),
        ):
            if not usable:
                raise EpisodeError(f"{given} of step {self.step} cannot be used; allowed: {allowed}")


def av_commands(control: AvControl, step: int, actor_id: int) -> VehicleCommands:
    """The command that drives the AV to a step, from its controller's answer to the step before."""
    pedals = control.throttle, control.brake, control.steer_rad
    return VehicleCommands.of(step, AV_SOURCE, [(actor_id, Owner.ROS, *pedals, False, Mode.EXTERNAL, control.lights)])


Controls = Mapping[int, AvControl]
"""Commands of external drivers at a step, by the id of their vehicle."""


def with_seats(commands: VehicleCommands, controls: Controls, seats: Collection[int]) -> VehicleCommands:
    """A controller's commands with those of external drivers in place of its own.

    Args:
        commands: Commands of the controller, also for these vehicles.
        controls: Answers of the drivers whose vehicles the controller would drive. Beacon and siren stay as the
            controller has them.
        seats: All actors whose driver is another one; rows and events of them are left out.
    """
    kept = [row for row, actor_id in enumerate(commands.actor_id.tolist()) if actor_id not in seats]
    columns = {name: getattr(commands, name) for name in COMMAND_DTYPES}
    rows: list[CommandRow] = list(zip(*(column[kept].tolist() for column in columns.values()), strict=True))
    warnings = dict(zip(commands.actor_id.tolist(), (commands.lights & _WARNING_LIGHTS).tolist(), strict=True))
    for actor_id, control in controls.items():
        pedals = control.throttle, control.brake, control.steer_rad
        lights = control.lights | warnings.get(actor_id, 0)
        rows.append((actor_id, Owner.ROS, *pedals, False, Mode.EXTERNAL, lights))
    events = tuple(event for event in commands.events if event.actor_id not in seats)
    return VehicleCommands.of(commands.step, commands.source, sorted(rows), events)


def controls_in(commands: VehicleCommands) -> Controls:
    """The commands of external drivers that a controller's commands contain."""
    controls: dict[int, AvControl] = {}
    for row in np.flatnonzero(commands.mode == Mode.EXTERNAL).tolist():
        throttle, brake, steer_rad = (
            float(one[row]) for one in (commands.throttle, commands.brake, commands.steer_rad)
        )
        lights = int(commands.lights[row] & Lights.INDICATORS)
        controls[int(commands.actor_id[row])] = AvControl(commands.step - 1, throttle, brake, steer_rad, lights)
    return controls
