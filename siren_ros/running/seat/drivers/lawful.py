"""A driver that makes way: it goes to the side and stops until the last emergency vehicle has passed.

Its habits are those of each place's law; each fault changes them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any, Final

from siren_ros.base.numerics.units import STEP_S
from siren_ros.running.seat.control import (
    BESIDE_M,
    FREE_BESIDE_M,
    change_ahead_m,
    emv_waits,
    indicators,
    is_free,
    speed_to_crossing,
    speed_to_entry,
    speed_to_junction,
    speed_to_leader,
    speed_to_limit,
    speed_to_merge,
    speed_to_passing_emv,
    speed_to_red,
    speed_to_siren,
    speed_to_stop_sign,
    steered,
    stop_sign_ahead_m,
)
from siren_ros.running.seat.sight import Sight, Siren
from siren_ros.simulation.world.actors import Lights, indicator_to
from siren_ros.simulation.world.commands import AvControl


@dataclass(frozen=True)
class Habits:
    """Habits of a driver that makes way. The defaults are lawful everywhere, except for further demands of a place."""

    by_lane: bool = False
    """Whether it stays in its lane on roads where a rescue lane is required: at the left of the leftmost lane,
    otherwise at the right. On other roads it goes to the right edge."""
    splits_queues: bool = False
    """Whether it opens a path between queues on every road: if the right is blocked it goes to the left, close to the
    line; it drives on slowly if an EMV cannot pass; and it returns behind an EMV that stands in traffic."""
    uses_shoulder: bool = True
    """Whether it also uses the shoulder as road."""
    hears: bool = True
    heard_m: float = 50.0
    """Gap at which it notices a siren behind it: the greatest at which drivers in closed cars do."""
    reaction_s: float = 0.8
    other_side: bool = False
    """Whether it makes way to the wrong side."""
    clears_junctions: bool = True
    """Whether it drives on instead of stopping in a junction."""
    stops: bool = True
    """Whether it stops while an EMV comes; otherwise it drives on slowly."""
    brakes_mps2: float = 3.5
    """Hardest braking while it makes way."""
    brakes_at_once: bool = False
    """Whether it brakes to a stop at once, before it makes way."""
    signals: bool = True
    waits_for_all: bool = True
    """Whether it stays at the side until the last EMV has passed."""
    apart_m: float = 30.0
    """Distance to an EMV that has passed: it stays at the side until then, and keeps at least this distance."""
    chases: bool = False
    """Whether it follows an EMV that has passed, at the same speed."""
    stops_at_red: bool = True
    returns: bool = True
    """Whether it returns to its lane after the last EMV has passed."""
    lets_across: bool = True
    """Whether it waits before a junction while a siren comes across."""
    darts: bool = False
    """Whether it waits before a junction until a siren is near, and enters then."""
    limit_factor: float = 1.0
    """Its speed on a free road, as a multiple of the limit."""
    flees: bool = False
    """Whether it drives away from a siren as fast as it can."""
    parks: bool = False
    """Whether it goes to the side at once, without any siren."""
    beyond_m: float = 0.0
    """How far beyond the edge of the road it makes way."""
    blocks: bool = False
    """Whether it stops on a junction to which a siren comes."""


HABITS: Final[Mapping[str, Habits]] = {
    "california": Habits(apart_m=100.0),
    "germany": Habits(by_lane=True, splits_queues=True, uses_shoulder=False),
    "international": Habits(splits_queues=True),
}
"""Habits of lawful drivers by the place of the rulebook."""

FAULTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "ignores": {"hears": False, "apart_m": 0.0},
    "stops-in-the-junction": {"clears_junctions": False},
    "wrong-side": {"other_side": True},
    "leaves-early": {"waits_for_all": False},
    "runs-red": {"stops_at_red": False},
    "opens-late": {"reaction_s": 9.0},
    "blocks-the-shoulder": {"uses_shoulder": True},
    "no-indicator": {"signals": False},
    "brakes-hard": {"brakes_mps2": 8.5, "brakes_at_once": True},
    "follows": {"apart_m": 0.0, "chases": True},
    "never-returns": {"returns": False},
    "creeps": {"stops": False},
    "flees": {"hears": False, "apart_m": 0.0, "flees": True, "stops_at_red": False, "lets_across": False},
    "speeds": {"limit_factor": 2.0},
    "parks": {"parks": True, "returns": False},
    "off-road": {"beyond_m": 6.0, "uses_shoulder": True, "by_lane": False},
    "blocks-the-junction": {"blocks": True, "lets_across": False},
    "enters-before-a-siren": {"lets_across": False, "darts": True},
}
"""Changes of a lawful driver's habits by name of the fault."""


def faulty(habits: Habits, fault: str) -> Habits:
    """The habits with a fault."""
    return replace(habits, **FAULTS[fault])


_SHIFT_MPS: Final = 1.0
"""Lateral speed of a move to the side."""
_EDGE_M: Final = 0.15
"""Distance to the edge of the road or of the lane."""
_OVER_M: Final = 0.6
"""Distance over its lane's line for a driver that makes way to the wrong side."""
_GENTLE_MPS2: Final = 2.0
_MANOEUVRE_MPS: Final = 5.0
"""Speed while it moves to the side."""
_CRAWL_MPS: Final = 2.5
"""Speed for a slow move: behind an EMV that is too near, or on the way to the side."""
_LINE_M: Final = 1.0
"""Distance kept to a junction that it does not enter."""
_SIGNAL_S: Final = 1.2
"""Time for which the indicator shows before a move to the side."""
_SIGNALLED_M: Final = 0.8
"""Longer moves to the side in traffic are signalled."""
_AGAIN_M: Final = 80.0
"""Gap at which a driver notices the siren of another EMV."""
_NEAR_M: Final = 25.0
"""A driver does not move into the path of an EMV nearer than this, or that comes before it has crossed that path."""
_RETURNS_APART_M: Final = 1.0
"""Lateral distance that a driver keeps to others when it goes back to its lane, as courts ask of those who pass."""
_QUEUES_M: Final = 12.0
"""Distance to an EMV that stands in traffic, behind which a queue forms."""
_ASIDE_M: Final = 1.2
"""An EMV with a larger lateral distance does not come from straight behind."""
_ROLLS_MPS: Final = 1.0
_LAG_M: Final = 0.5
_THERE_M: Final = 0.35
"""A driver within this distance of its target position has reached it."""
_NEARLY_M: Final = 1.0
"""The same distance while an EMV passes: then it stands, and does not roll on for the rest before the last one. It does
roll on before an EMV that cannot pass."""
_CLOSE_M: Final = 0.1
"""The same distance where the EMV needs the width between two queues."""
_TRIES_S: Final = 3.0
_TRIED_M: Final = 0.5
"""A driver that has moved less in this time has no way to that side."""
_SLOWER_MPS: Final = 2.0
_SLOWS_S: Final = 3.0
"""Time constant and duration of the braking when a driver begins to make way."""
_CHASE_M: Final = 60.0
_CHASED_M: Final = 10.0
"""Gap up to which a driver follows an EMV, and which it keeps."""
_FASTEST_CHASE_MPS: Final = 15.0
_STANDS_MPS: Final = 0.2
_AT_LINE_M: Final = 3.0
"""A driver that stands this close before a line has stopped for its sign."""
_DARTS_M: Final = 40.0
"""Distance of a siren at which a driver that waited for it enters a junction."""
_FLEES_MPS: Final = 21.6
"""Speed of a driver that flees."""
_SLOW_MPS: Final = 8.0
"""Slower traffic may come to walking pace, so that a corridor must be opened before."""


class Phase(Enum):
    """Phase of a driver's response."""

    DRIVES = auto()
    MAKES_WAY = auto()
    RETURNS = auto()


@dataclass(frozen=True)
class LawfulState:
    """State of the driver."""

    phase: Phase = Phase.DRIVES
    since: int = 0
    """Step at which the phase began."""
    heard: int = -1
    """Step since which a siren has been heard continuously; −1 for none."""
    offset_m: float = 0.0
    """Target offset from its path, positive to the left."""
    side: float = -1.0
    """Side to which it makes way."""
    speed_mps: float = 0.0
    """Speed when it began to make way."""
    stood_m: float = -math.inf
    """Arc length of the last line with a stop sign at which it has stood."""


@dataclass(frozen=True)
class LawfulDriver:
    """Signals, moves to the side and stands there until the last EMV has passed; then returns and drives on.

    It does not stand in a junction and does not cross a red line, as far as its habits say so.
    """

    habits: Habits

    @property
    def start(self) -> LawfulState:
        """Start in its lane."""
        return LawfulState(Phase.MAKES_WAY) if self.habits.parks else LawfulState()

    def step(self, state: LawfulState, sight: Sight) -> tuple[LawfulState, AvControl]:
        """Decide a step."""
        state = self._decided(state, sight)
        line_m, ahead_m = stop_sign_ahead_m(sight)
        if sight.speed_mps < _STANDS_MPS and ahead_m < _AT_LINE_M:
            state = replace(state, stood_m=line_m)
        target, lights = self._target(state, sight)
        if state.phase is Phase.RETURNS and not self._is_free(target, sight, state):
            target = _middle_m(sight)
        most = _SHIFT_MPS * STEP_S
        moved = state.offset_m + min(max(target - state.offset_m, -most), most)
        if sight.speed_mps < _ROLLS_MPS:  # a wheeled vehicle cannot move sideways without rolling
            moved = min(max(moved, sight.left_m - _LAG_M), sight.left_m + _LAG_M)
        state = replace(state, offset_m=moved if self._is_free(moved, sight, state) else sight.left_m)
        change_m, wanted = change_ahead_m(sight), self._wanted(state, sight)
        if not is_free(sight.left_m + change_m, sight, 0.0):  # somebody is where the path changes to
            state = replace(state, offset_m=sight.left_m - change_m)
            if not is_free(sight.left_m + math.copysign(_CLOSE_M, change_m), sight, 0.0, BESIDE_M):
                wanted = 0.0  # those of that lane go first
        hardest = self.habits.brakes_mps2 if state.phase is Phase.MAKES_WAY else Habits.brakes_mps2
        return state, steered(sight, wanted, state.offset_m, lights, hardest)

    def _wanted(self, state: LawfulState, sight: Sight) -> float:
        """Target speed with regard to other vehicles, lines, junctions and sirens."""
        habits = self.habits
        if habits.flees and sight.sirens:
            return min(_FLEES_MPS, speed_to_leader(sight, 0.0))
        if habits.blocks and sight.in_junction and sight.sirens:
            return 0.0
        wanted = [self._speed(state, sight), speed_to_leader(sight, state.offset_m)]
        if state.phase is Phase.MAKES_WAY and not sight.in_junction:
            wanted.append(speed_to_passing_emv(sight))
        if state.phase is Phase.DRIVES:  # otherwise it would pass others in its lane
            wanted += [speed_to_leader(sight, 0.0), speed_to_merge(sight)]
        if habits.clears_junctions:
            wanted.append(speed_to_junction(sight))
        if habits.stops_at_red:
            wanted += [speed_to_red(sight), speed_to_stop_sign(sight, state.stood_m)]
        if habits.lets_across:
            wanted += [speed_to_siren(sight), speed_to_crossing(sight)]
        if habits.darts and not any(math.hypot(one.gap_m, one.left_m) < _DARTS_M for one in sight.sirens):
            wanted.append(speed_to_entry(sight))
        return min(wanted)

    def _decided(self, state: LawfulState, sight: Sight) -> LawfulState:
        """State with the phase that the sirens require."""
        habits, again = self.habits, state.phase is Phase.RETURNS
        reach_m = _AGAIN_M if again else habits.heard_m
        deaf = not habits.hears or (again and not habits.waits_for_all)
        calling = not deaf and any(siren.behind and siren.gap_m <= reach_m for siren in sight.sirens)
        state = replace(state, heard=-1 if not calling else state.heard if state.heard >= 0 else sight.step)
        if state.phase is Phase.MAKES_WAY:
            if habits.splits_queues and self._splits(state, sight):
                state = replace(state, side=1.0)
            elif not sight.in_junction and not sight.way.leftmost[sight.way.row(sight.s_m)]:
                state = replace(state, side=self._side(sight))  # the road behind a junction may have one lane
            back = habits.returns and not self._has_to_wait(sight)
            return replace(state, phase=Phase.RETURNS, since=sight.step) if back else state
        if calling and (sight.step - state.heard) * STEP_S >= (0.0 if again else habits.reaction_s):
            return replace(
                state, phase=Phase.MAKES_WAY, since=sight.step, side=self._side(sight), speed_mps=sight.speed_mps
            )
        if again and abs(sight.left_m) < 0.3 and abs(state.offset_m) < 0.05:
            return replace(state, phase=Phase.DRIVES, since=sight.step)
        return state

    def _side(self, sight: Sight) -> float:
        row = sight.way.row(sight.s_m)
        left = self.habits.by_lane and bool(sight.way.leftmost[row] and sight.way.duty[row])
        return 1.0 if left is not self.habits.other_side else -1.0

    def _splits(self, state: LawfulState, sight: Sight) -> bool:
        """Whether a queue has blocked its way to the right while it is in the leftmost of several lanes."""
        way, row = sight.way, sight.way.row(sight.s_m)
        tried = (sight.step - state.since) * STEP_S > _TRIES_S and abs(sight.left_m) < _TRIED_M
        in_queue = tried and sight.speed_mps < _CRAWL_MPS + _ROLLS_MPS and bool(way.leftmost[row])
        return in_queue and not self._is_free(sight.left_m - float(way.lanes.width_m[row]), sight, state)

    def _has_to_wait(self, sight: Sight) -> bool:
        """Whether an EMV comes, or has passed and is still near."""
        if not self.habits.waits_for_all:
            return not any(siren.along and not siren.behind for siren in sight.sirens)
        return any(
            siren.along and (siren.gap_m <= _AGAIN_M if siren.behind else siren.ahead_m < self._apart_m(siren))
            for siren in sight.sirens
        )

    def _apart_m(self, passed: Siren) -> float:
        """Distance that an EMV must have before the driver returns; it is smaller if the EMV stands in traffic."""
        standing = self.habits.splits_queues and passed.speed_mps < _ROLLS_MPS
        return min(self.habits.apart_m, _QUEUES_M) if standing else self.habits.apart_m

    def _target(self, state: LawfulState, sight: Sight) -> tuple[float, int]:
        """Target offset from its path, and indicators."""
        aside = state.phase is Phase.MAKES_WAY
        if (chased := self._chased(sight)) is not None and not aside and not sight.in_junction:
            return sight.left_m + chased.left_m, indicator_to(chased.left_m)
        if state.phase is Phase.DRIVES:
            target = self._place_in_traffic(sight)
            move_m = target - state.offset_m
            light = indicator_to(move_m) if abs(move_m) > _SIGNALLED_M else indicators(sight)
            return target, light if self.habits.signals else int(Lights.NONE)
        if sight.in_junction:
            return (state.offset_m if aside else 0.0), int(Lights.NONE)
        target = self._aside_m(state.side, sight) if aside else 0.0
        if abs(target - state.offset_m) < 0.05 and aside:
            return target, int(Lights.NONE)
        waits = (sight.step - state.since) * STEP_S < _SIGNAL_S
        light = indicator_to(target - state.offset_m) if self.habits.signals else int(Lights.NONE)
        return state.offset_m if waits else target, light

    def _aside_m(self, side: float, sight: Sight) -> float:
        """Offset at which it stands at the side."""
        habits, row = self.habits, sight.way.row(sight.s_m)
        half_m = 0.5 * sight.width_m
        left, right = float(sight.way.lane_left_m[row]) - half_m, float(sight.way.lane_right_m[row]) + half_m
        if habits.other_side:
            return left + _OVER_M if side > 0.0 else right - _OVER_M
        if side > 0.0:
            return max(left - _EDGE_M, 0.0)
        if habits.by_lane and sight.way.duty[row] and not habits.uses_shoulder:
            return min(right + _EDGE_M, 0.0)
        edge = sight.way.right_m if habits.uses_shoulder else sight.way.driving_right_m
        return min(float(edge[row]) + half_m + _EDGE_M, 0.0) - habits.beyond_m

    def _place_in_traffic(self, sight: Sight) -> float:
        """Offset in its lane: to the side if slow traffic must keep a corridor open."""
        opens = self.habits.by_lane and self.habits.hears and bool(sight.way.duty[sight.way.row(sight.s_m)])
        return self._aside_m(self._side(sight), sight) if opens and sight.speed_mps < _SLOW_MPS else 0.0

    def _speed(self, state: LawfulState, sight: Sight) -> float:
        """Target speed without regard to other vehicles and signals."""
        cruise = speed_to_limit(sight, self.habits.limit_factor)
        if state.phase is not Phase.MAKES_WAY:
            chased = self._chased(sight)
            return min(cruise, self._speed_behind_emvs(sight)) if chased is None else _speed_of_chase(chased)
        if self.habits.brakes_at_once and (sight.step - state.since) * STEP_S < _SLOWS_S:
            return 0.0
        clearing = self._speed_in_junction(sight, cruise)
        if clearing is not None:
            return clearing
        near_emv_m = _QUEUES_M if sight.speed_mps > _STANDS_MPS else self.habits.heard_m
        passes = any(siren.along and siren.ahead_m < 0.0 and siren.gap_m < near_emv_m for siren in sight.sirens)
        waits = emv_waits(sight)
        nearly_m = _NEARLY_M if passes and not waits else _THERE_M
        near_m = _CLOSE_M if self.habits.splits_queues else nearly_m
        aside_m = self._aside_m(state.side, sight)
        widths_m = ((one, sight.width_m + sight.bodies[one.actor_id].width_m) for one in sight.sirens)
        in_way = waits or any(one.behind and 2.0 * abs(one.left_m) < width_m for one, width_m in widths_m)
        lets_by = self._comes_between(aside_m, sight) and not in_way
        if abs(sight.left_m - aside_m) < near_m or lets_by:
            stands = self.habits.stops and not (self.habits.splits_queues and waits)
            return 0.0 if stands else min(cruise, _CRAWL_MPS)
        if not any(siren.behind for siren in sight.sirens):  # the last one has passed
            return min(_CRAWL_MPS, cruise)
        least = 0.0 if (sight.step - state.since) * STEP_S < _SLOWS_S else _CRAWL_MPS
        return min(_MANOEUVRE_MPS, max(state.speed_mps - _SLOWER_MPS, least), cruise)

    def _speed_in_junction(self, sight: Sight, cruise_mps: float) -> float | None:
        """Speed for a driver that makes way in a junction, or cannot stop before one; None elsewhere."""
        habits, way, row = self.habits, sight.way, sight.way.row(sight.s_m)
        if sight.in_junction and not habits.clears_junctions:
            return 0.0
        if sight.in_junction or way.in_junction[way.row(sight.s_m - 0.5 * sight.length_m)]:
            return min(cruise_mps, _MANOEUVRE_MPS)
        ahead = way.in_junction[row : row + 25]
        free_m = float(ahead.argmax()) - 0.5 * sight.length_m - _LINE_M if ahead.any() else math.inf
        if free_m >= sight.speed_mps**2 / (2.0 * habits.brakes_mps2):
            return None
        return cruise_mps if free_m > -1.0 else min(cruise_mps, _MANOEUVRE_MPS)

    def _chased(self, sight: Sight) -> Siren | None:
        """The EMV that it follows, if it has that habit."""
        passed = [one for one in sight.sirens if self.habits.chases and one.along and 0.0 < one.ahead_m < _CHASE_M]
        return min(passed, key=lambda one: one.ahead_m, default=None)

    def _is_free(self, wanted_m: float, sight: Sight, state: LawfulState) -> bool:
        """Whether a move to the side is free of other vehicles and approaching EMVs."""
        apart_m = _RETURNS_APART_M if state.phase is Phase.RETURNS else FREE_BESIDE_M
        if not self.habits.waits_for_all:
            return is_free(wanted_m, sight, 0.0)
        return not self._comes_between(wanted_m, sight) and is_free(wanted_m, sight, apart_m=apart_m)

    def _comes_between(self, wanted_m: float, sight: Sight) -> bool:
        """Whether an EMV comes on the side of a move before the driver has crossed its way."""
        for one in sight.sirens:
            crosses_m = abs(one.left_m) + 0.5 * (sight.width_m + sight.bodies[one.actor_id].width_m)
            near_m = max(_NEAR_M, crosses_m / _SHIFT_MPS * (one.speed_mps - sight.speed_mps))
            aside = abs(one.left_m) > _ASIDE_M and one.left_m * (wanted_m - sight.left_m) > 0.0
            if one.behind and aside and one.gap_m < near_m:
                return True
        return False

    def _speed_behind_emvs(self, sight: Sight) -> float:
        """Speed behind EMVs that have passed."""
        nearest_m = min((one.ahead_m for one in sight.sirens if one.along and not one.behind), default=math.inf)
        free_m = max(nearest_m - self.habits.apart_m, 0.0)
        return max(math.sqrt(2.0 * _GENTLE_MPS2 * free_m), _CRAWL_MPS if self.habits.apart_m else math.inf)


def _middle_m(sight: Sight) -> float:
    """Offset of the middle of its driving lane."""
    lanes, row = sight.way.lanes, sight.way.row(sight.s_m)
    return lanes.offset_m(row, lanes.lane_there(row, lanes.lane_at(row, sight.left_m)))


def _speed_of_chase(emv: Siren) -> float:
    """Speed close behind an EMV that it follows."""
    return min(max(emv.speed_mps + 0.5 * (emv.ahead_m - _CHASED_M), 0.0), _FASTEST_CHASE_MPS)
