"""Pages of episodes in a folder next to the report, for the moments that it links to."""

from collections.abc import Collection
from pathlib import Path
from urllib.parse import quote

from siren_ros.base.processes.process_pool import ProcessPool
from siren_ros.errors import SirenError, write_text, writing
from siren_ros.reports.episode_page.of_bag import page_of_bag


class EpisodePages:
    """Gives addresses of moments and collects the pages that they need; ``write`` writes these pages."""

    def __init__(self, folder: Path, most: int, bags: Collection[Path]) -> None:
        """Prepare pages for at most ``most`` episodes, only of bags that a page can show."""
        self.folder = folder
        self._most = most
        self._bags = bags
        self._asked: dict[Path, Path] = {}

    def address(self, bag: Path, time_s: float, actor_id: int | None = None) -> str:
        """Address of a moment relative to the report; empty if the episode has no page."""
        if bag not in self._asked:
            if bag not in self._bags or len(self._asked) >= self._most:
                return ""
            self._asked[bag] = self.folder / f"{bag.name}.html"
        actor = "" if actor_id is None else f"&v={actor_id}"
        return f"{quote(self.folder.name)}/{quote(self._asked[bag].name)}#t={time_s:g}{actor}"

    def write(self, jobs: int) -> tuple[int, int, tuple[str, ...]]:
        """Write the pages in parallel processes; returns their number, total size, and reasons of missing pages."""
        if not self._asked:
            return 0, 0, ()
        with writing(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        with ProcessPool(min(jobs, len(self._asked))) as pool:
            results = pool.map(write_page, list(self._asked.items()))
        sizes = [result for result in results if isinstance(result, int)]
        return len(sizes), sum(sizes), tuple(result for result in results if isinstance(result, str))


def write_page(bag: Path, file: Path) -> int | str:
    """Write the page of a bag; returns its size in bytes, or why it cannot be made."""
    try:
        content = page_of_bag(bag)
        write_text(file, content)
    except SirenError as error:
        return f"{bag.name}: {error}"
    return len(content.encode())
