"""Elements of XML written by formats that have no binary files."""

from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring


def child(parent: Element, tag: str, text: object = None, **attributes: object) -> Element:
    """Adds an element; numbers are written with at most six decimals."""
    made = SubElement(parent, tag, {name: value_text(value) for name, value in attributes.items()})
    if text is not None:
        made.text = value_text(text)
    return made


def value_text(value: Any) -> str:
    """A value as XML text."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{round(value, 6) + 0.0:.6f}".rstrip("0").rstrip(".")
    return str(value)


def document(root: Element) -> bytes:
    """A whole file."""
    indent(root, " ")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"
