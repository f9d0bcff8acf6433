"""What a test can tell of a page: its complaints, its requests, images and videos that show nothing."""

from pathlib import Path

from browser_pages import PageBrowser

PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="


def page(folder: Path, body: str) -> Path:
    path = folder / "page.html"
    path.write_text(f"<!doctype html><html lang=en><meta charset=utf-8><title>t</title><body>{body}</body></html>")
    return path


def test_a_sound_page_has_nothing_to_complain_of(browser: PageBrowser, tmp_path: Path) -> None:
    body = f'<img alt=one src="{PIXEL}"><table><tr><th>a</th><td>1.5</td></tr></table>'
    with browser.opened(page(tmp_path, body)) as opened:
        assert opened.problems == []
        assert opened.requests == []
        assert opened.empty_images() == []
        assert opened.table("table") == [["a", "1.5"]]


def test_what_is_wrong_with_a_page_is_seen(browser: PageBrowser, tmp_path: Path) -> None:
    body = '<img alt=lost src="https://example.org/a.png"><video id=broken src="data:video/mp4;base64,AAAA"></video>'
    with browser.opened(page(tmp_path, f"{body}<script>nonsense()</script>")) as opened:
        assert opened.empty_images() == ["lost"]
        assert [line.split(":")[0] for line in opened.unplayable_videos()] == ["broken"]
        assert opened.requests == ["https://example.org/a.png"]
        assert any("nonsense" in problem for problem in opened.problems)
