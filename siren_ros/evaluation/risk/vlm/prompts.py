"""What a model is told and asked. The words are our own; SeeUnsafe's procedure is followed where the paper names it."""

from collections.abc import Sequence
from typing import Final

SYSTEM: Final = """You judge the risk of road traffic scenes. You are shown pictures from a camera that looks forward \
from an emergency vehicle on duty. The pictures are in order of time.

Choose exactly one class for what happens between the emergency vehicle and other road users in these pictures:
- Normal: nobody comes close to a crash. Vehicles that stand aside while the emergency vehicle passes slowly are normal.
- Near-Miss: a crash is close. The ways of two vehicles meet within about a second, or one of them has to brake or \
swerve hard to avoid the other, and they do not touch.
- Collision: the emergency vehicle and another vehicle touch.

Answer with one JSON object and nothing else: \
{"class": "Normal" | "Near-Miss" | "Collision", "reason": "one sentence"}"""

_MARKED: Final = (
    " Vehicles are outlined, each with its own number; the same number is the same vehicle in all pictures."
)


def question(frames: Sequence[int], *, marked: bool) -> str:
    """The text that goes with the pictures of one question.

    Args:
        frames: Numbers of the frames in the video; a frame is 0.1 s.
        marked: Whether vehicles are outlined.
    """
    times = ", ".join(f"{0.1 * frame:.1f}" for frame in frames)
    several = f"{len(frames)} pictures, taken at {times} s" if len(frames) > 1 else f"One picture, taken at {times} s"
    return f"{several} of the same drive; the video has a picture every 0.1 s.{_MARKED if marked else ''} Which class?"
