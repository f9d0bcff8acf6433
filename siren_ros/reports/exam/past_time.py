"""Past-time temporal logic over conditions that are sampled at every step (Lichtenstein, Pnueli and Zuck 1985).

All functions take and give arrays of shape ``(M,)``, one value for each consecutive step; before the first step no
condition held.
"""

import numpy as np

from siren_ros.base.numerics.arrays import Flags


def once(holds: Flags, within: int | None = None) -> Flags:
    """Whether a condition holds now or held at one of the last ``within`` steps; at any step before without a bound."""
    last = _last(holds)
    return np.asarray(last >= 0 if within is None else (last >= 0) & (np.arange(len(holds)) - last <= within))


def historically(holds: Flags, within: int | None = None) -> Flags:
    """Whether a condition holds now and held at the last ``within`` steps, as far as there were any; or at all."""
    return ~once(~holds, within)


def since(holds: Flags, begin: Flags) -> Flags:
    """Whether a condition has held at every step since ``begin`` was last true; false if ``begin`` never was."""
    return np.asarray((_last(begin) >= 0) & (_last(begin) >= _last(~holds)))


def rises(holds: Flags) -> Flags:
    """Whether a condition holds and did not hold at the step before."""
    return np.asarray(holds & ~np.concatenate(([False], holds[:-1])))


def held_for(holds: Flags, steps: int) -> Flags:
    """Whether a condition has held at this step and at so many steps before it, which all were there."""
    return np.asarray(historically(holds, steps) & (np.arange(len(holds)) >= steps))


def _last(holds: Flags) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """The last step, this one included, at which a condition held; −1 where there is none."""
    steps = np.arange(len(holds))
    return np.maximum.accumulate(np.where(holds, steps, -1)) if len(holds) else steps
