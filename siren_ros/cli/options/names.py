"""Several names in one word of a command line."""


def names_in(text: str) -> tuple[str, ...]:
    """Names separated by commas, without the spaces around them; empty ones do not count."""
    return tuple(name.strip() for name in text.split(",") if name.strip())
