"""What docs/av_programs.md says about stamps and frames is what the platform does."""

import re
from types import SimpleNamespace

import pytest
from repository import REPOSITORY

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces.topics import AV_CONTROL, AV_ROUTE, EPISODE, EPISODE_END, MAP, TF_STATIC

PAGE = (REPOSITORY / "docs" / "av_programs.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("step", [0, 1, 19, 20, 21, 799, 71_999])
def test_the_step_follows_from_the_stamp_as_the_page_says(step: int) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names: dict[str, object] = {}
    exec(code, names)  # noqa: S102 - the page's own function
    sec, nanosec = divmod(time_ns_of_step(step), 1_000_000_000)
    assert names["step_of"](SimpleNamespace(sec=sec, nanosec=nanosec)) == step  # type: ignore[operator] # a function


def test_the_topics_that_need_transient_local_are_the_latched_ones() -> None:
    (row,) = [line for line in PAGE.splitlines() if "transient local" in line and line.startswith("|")]
    named = set(re.findall(r"`(/[a-z_/]+)`", row))
    assert named == {topic.name for topic in (AV_ROUTE, EPISODE, MAP, EPISODE_END, TF_STATIC)}
    assert all(topic.latched for topic in (AV_ROUTE, EPISODE, MAP, EPISODE_END, TF_STATIC))
    assert not AV_CONTROL.latched
