"""What tests ask of a page that is open in the browser."""

from browser_pages import OpenedPage


def until(opened: OpenedPage, condition: str) -> None:
    """Waits for a condition; playwright's own wait evaluates texts, which the page's security policy refuses."""
    look = f"const look = () => ({condition}) ? done() : requestAnimationFrame(look); look();"
    opened.page.evaluate(f"() => new Promise(done => {{ {look} }})")


def moment(opened: OpenedPage) -> dict[str, object]:
    return opened.page.evaluate("episodePage.moment")


def pictures(opened: OpenedPage) -> None:
    """Waits until the next pictures have been drawn."""
    opened.page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
