"""Pictures and films as data URIs, so that the page is one file."""

import base64
import io
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from siren_ros.pictures.video import Coding, Frame, write_video

_JPEG_QUALITY: Final = 82


def data_uri(kind: str, content: bytes) -> str:
    """A file's content as an address."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def figure_uri(figure: Figure) -> str:
    """A chart as SVG: the same figure gives the same bytes, and no font of the reader's is needed."""
    out = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "siren", "svg.fonttype": "path"}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    return data_uri("image/svg+xml", out.getvalue())


def picture_uri(pixels: Image.Image) -> str:
    """A picture as JPEG."""
    out = io.BytesIO()
    pixels.convert("RGB").save(out, "JPEG", quality=_JPEG_QUALITY, optimize=True)
    return data_uri("image/jpeg", out.getvalue())


def drawn_uri(figure: Figure, width_px: int) -> str:
    """A figure with very many lines, such as a map, as JPEG of some width."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=width_px / figure.get_figwidth())
    return picture_uri(Image.open(out))


def film_uri(frames: Iterable[Frame], coding: Coding) -> str:
    """Frames as H.264 in MP4."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        write_video(path, frames, coding)
        return data_uri("video/mp4", path.read_bytes())
