"""Of those who have not reported, the first in the chain is told, and what it has to do."""

from siren_ros.data.interfaces.episode_conversions import Phase
from siren_ros.data.lockstep import LockstepConfig, LockstepState, Stage
from siren_ros.running.ros.participants.hang_watch import Work, awaited_by, overdue

OWN = ("sumo_bridge", "emv_controller", "vehicle_dynamics", "recorder")
CONFIG = LockstepConfig((*OWN, "my_stack", "av_controller"), 10)


def state(stage: Stage, *waiting: str, step: int = -1, owing: tuple[str, ...] = ()) -> LockstepState:
    return LockstepState(stage, step, frozenset(waiting), frozenset(owing))


def test_before_the_first_step() -> None:
    everybody = state(Stage.GATHERING, *CONFIG.participants)
    assert awaited_by(everybody, CONFIG, OWN) == (
        "av_controller to publish /av/control_cmd, my_stack to report READY on /siren/step_done, at most 120 s"
    )
    assert awaited_by(state(Stage.GATHERING, "sumo_bridge"), CONFIG, OWN) == "sumo_bridge to be ready, at most 120 s"


def test_who_is_at_work_in_this_process_comes_first() -> None:
    works = (None, Work("recorder", Phase.READY, 0, 1.0), Work("sensor_sim", Phase.READY, 0, 1.0))
    everybody = state(Stage.GATHERING, *CONFIG.participants)
    assert awaited_by(everybody, CONFIG, OWN, works) == "recorder to be ready, at most 120 s"


def test_within_a_step() -> None:
    stepping = state(Stage.STEPPING, "emv_controller", "vehicle_dynamics", "recorder", step=3)
    assert awaited_by(stepping, CONFIG, OWN) == "emv_controller to finish step 3, at most 20 s"
    owing = state(Stage.STEPPING, "sumo_bridge", step=3, owing=("recorder",))
    assert awaited_by(owing, CONFIG, OWN) == "recorder to finish step 2, at most 20 s"


def test_at_the_end() -> None:
    assert awaited_by(state(Stage.CLOSING, "recorder", step=9), CONFIG, OWN) == "recorder to close, at most 60 s"
    assert awaited_by(state(Stage.CLOSED, "recorder"), CONFIG, OWN) == "", "it is no longer waited for"


def test_many_are_not_all_named() -> None:
    config = LockstepConfig(tuple("abcde"), 1)
    line = awaited_by(state(Stage.GATHERING, *"abcde"), config, tuple("abcde"))
    assert line == "a, b, c and 2 more to be ready, at most 120 s"


def test_the_first_step_may_take_as_long_as_the_start() -> None:
    works = [None, Work("recorder", Phase.STEP, 0, 0.0)]
    assert overdue(works, CONFIG, 100.0) == "", "it may compile loops"
    assert overdue(works, CONFIG, 122.0) == "recorder: did not finish step 0 within 120 s"
    assert overdue([Work("recorder", Phase.STEP, 1, 0.0)], CONFIG, 22.0) == (
        "recorder: did not finish step 1 within 20 s"
    )
    stepping = state(Stage.STEPPING, "recorder", step=0)
    assert awaited_by(stepping, CONFIG, OWN) == "recorder to finish step 0, at most 120 s"
