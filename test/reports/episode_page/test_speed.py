"""What a picture of many vehicles costs the script: in processor time, because other programs disturb the clock's."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from browser_pages import OpenedPage, PageBrowser
from episode_page.looked_at import until

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.reports.episode_page.build import episode_page

PLAYED_MS = 6000.0
MOST_MS = 4.0


def picture_times_ms(opened: OpenedPage) -> list[float]:
    """Processor time of the script for each picture while the page plays."""
    events: list[dict[str, object]] = []
    ended: list[object] = []
    session = opened.page.context.new_cdp_session(opened.page)
    session.on("Tracing.dataCollected", lambda data: events.extend(data["value"]))
    session.on("Tracing.tracingComplete", lambda data: ended.append(data))  # noqa: PLW0108 - playwright cannot wrap a built-in method
    opened.page.evaluate("episodePage.play(true)")
    session.send("Tracing.start", {"categories": "devtools.timeline", "transferMode": "ReportEvents"})
    opened.page.wait_for_timeout(PLAYED_MS)
    session.send("Tracing.end")
    while not ended:
        opened.page.wait_for_timeout(50.0)
    return [event["tdur"] / 1000.0 for event in events if event["name"] == "FireAnimationFrame" and "tdur" in event]


@pytest.mark.parametrize("beside", [False, True])
def test_sixty_vehicles_cost_the_script_little(
    record_of: Callable[..., EpisodeRecord], browser: PageBrowser, tmp_path: Path, beside: bool
) -> None:
    record = record_of(duration_s=14.0, civilians=60)
    assert len(record.states[-1].actor_id) >= 60
    path = tmp_path / "episode.html"
    path.write_text(episode_page(record, against=[record]), encoding="utf-8")
    with browser.opened(path) as page:
        until(page, "window.episodePage !== undefined")
        page.page.set_viewport_size({"width": 480, "height": 400})
        page.page.evaluate("beside => episodePage.showBeside(beside)", beside)
        times_ms = picture_times_ms(page)
        counted = page.page.evaluate("episodePage.statistics()")
        assert page.problems == []
    assert len(times_ms) >= 10
    assert np.quantile(times_ms, 0.5) <= MOST_MS
    assert np.quantile(times_ms, 0.9) <= MOST_MS
    assert counted["calls"] <= 150
    assert counted["triangles"] <= 300_000
