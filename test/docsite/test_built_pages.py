from pathlib import Path

import pytest

from docsite.built_pages import faults_of_site


def site_of(folder: Path, **pages: str) -> Path:
    for name, body in pages.items():
        path = folder / name / "index.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"<html><body>{body}</body></html>")
    (folder / "picture.png").write_bytes(b"")
    return folder


@pytest.mark.parametrize(
    "body",
    [
        '<a href="../b/">page</a>',
        '<a href="../b/#here">anchor</a>',
        '<a href="#own">anchor</a><h1 id="own">x</h1>',
        '<a href="https://example.org/page">elsewhere, when the reader follows it</a>',
        '<a href="mailto:a@b">mail</a>',
        '<img src="../picture.png">',
        '<video poster="../picture.png"></video>',
        '<link rel="canonical" href="https://example.org/">',
        '<img src="data:image/png;base64,AA==">',
        '<a href="/b/">from the top</a>',
    ],
)
def test_sound_pages_have_no_faults(tmp_path: Path, body: str) -> None:
    assert faults_of_site(site_of(tmp_path, a=body, b='<h2 id="here">b</h2>')) == []


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ('<a href="../c/">x</a>', "a/index.html: links to ../c/, which does not exist"),
        ('<a href="../b/#there">x</a>', "a/index.html: links to ../b/#there; that page has no such anchor"),
        ('<a href="#own">x</a>', "a/index.html: links to #own; that page has no such anchor"),
        ('<img src="../other.png">', "a/index.html: links to ../other.png, which does not exist"),
        (
            '<script src="https://cdn.example.org/x.js"></script>',
            "a/index.html: a browser would load https://cdn.example.org/x.js from elsewhere",
        ),
        (
            '<link rel="stylesheet" href="//fonts.example.org/css">',
            "a/index.html: a browser would load //fonts.example.org/css from elsewhere",
        ),
        (
            '<link rel="preconnect" href="https://example.org">',
            "a/index.html: a browser would load https://example.org from elsewhere",
        ),
    ],
)
def test_each_fault_is_named(tmp_path: Path, body: str, fault: str) -> None:
    assert faults_of_site(site_of(tmp_path, a=body, b='<h2 id="here">b</h2>')) == [fault]


@pytest.mark.parametrize("rule", ['@import "https://e.org/a.css";', "a { src: url(//e.org/f.woff2) }"])
def test_styles_that_load_from_elsewhere_are_named(tmp_path: Path, rule: str) -> None:
    site_of(tmp_path, a="")
    (tmp_path / "own.css").write_text("a { src: url(own.woff2) }" + rule)
    (fault,) = faults_of_site(tmp_path)
    assert fault.startswith("own.css: loads ")
