import io

import numpy as np
import pytest
import simplejpeg
from PIL import Image

from siren_ros.datasets.exporting.png import png_bytes, png_of_jpeg


@pytest.mark.parametrize("shape", [(1, 1, 3), (5, 7, 3), (60, 80, 3)])
def test_another_reader_sees_the_same_pixels(shape: tuple[int, int, int]) -> None:
    rgb = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    with Image.open(io.BytesIO(png_bytes(rgb))) as picture:
        picture.load()
        assert np.array_equal(np.asarray(picture), rgb)


def test_a_jpeg_is_decoded_once_and_kept() -> None:
    rgb = np.full((16, 16, 3), (200, 30, 90), dtype=np.uint8)
    jpeg = simplejpeg.encode_jpeg(rgb, quality=95)
    with Image.open(io.BytesIO(png_of_jpeg(jpeg))) as picture:
        assert np.array_equal(np.asarray(picture), simplejpeg.decode_jpeg(jpeg))
