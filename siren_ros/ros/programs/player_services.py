"""The services of rosbag2's player, with its names and types, for the player of episodes."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final, Protocol

from rclpy.node import Node
from rosbag2_interfaces.srv import (
    Burst,
    GetRate,
    IsPaused,
    Pause,
    PlayNext,
    Resume,
    Seek,
    SetRate,
    TogglePaused,
)

PREFIX: Final = "/rosbag2_player"
"""Name of rosbag2's node: programs that control a player call its services."""
_NS_PER_S: Final = 1_000_000_000


class Player(Protocol):
    """What the services control."""

    paused: bool
    rate: float

    def seek(self, time_ns: int) -> bool:
        """Go to a time of the bag; False where the bag has no such time."""

    def play_next(self, count: int) -> int:
        """Publish the next messages, while paused; returns their number. A count of 0 is the rest of the bag."""


def _set_paused(paused: bool, player: Player, _request: Any, response: Any) -> Any:
    player.paused = paused
    return response


def _toggle_paused(player: Player, _request: Any, response: Any) -> Any:
    player.paused = not player.paused
    return response


def _is_paused(player: Player, _request: Any, response: Any) -> Any:
    response.paused = player.paused
    return response


def _get_rate(player: Player, _request: Any, response: Any) -> Any:
    response.rate = player.rate
    return response


def _set_rate(player: Player, request: Any, response: Any) -> Any:
    response.success = 0.0 < request.rate < math.inf
    if response.success:
        player.rate = request.rate
    return response


def _seek(player: Player, request: Any, response: Any) -> Any:
    response.success = player.seek(request.time.sec * _NS_PER_S + request.time.nanosec)
    return response


def _play_next(player: Player, _request: Any, response: Any) -> Any:
    response.success = player.play_next(1) == 1
    return response


def _burst(player: Player, request: Any, response: Any) -> Any:
    response.actually_burst = player.play_next(request.num_messages)
    return response


_SERVICES: Final[Mapping[str, tuple[type, Callable[[Player, Any, Any], Any]]]] = {
    "pause": (Pause, partial(_set_paused, True)),
    "resume": (Resume, partial(_set_paused, False)),
    "toggle_paused": (TogglePaused, _toggle_paused),
    "is_paused": (IsPaused, _is_paused),
    "get_rate": (GetRate, _get_rate),
    "set_rate": (SetRate, _set_rate),
    "seek": (Seek, _seek),
    "play_next": (PlayNext, _play_next),
    "burst": (Burst, _burst),
}


def offer_services(node: Node, player: Player) -> None:
    """Create the services on a node."""
    for name, (kind, answer) in _SERVICES.items():
        node.create_service(kind, f"{PREFIX}/{name}", partial(answer, player))
