import pytest

pytest.importorskip("pygame", reason="the extra learn is not installed")

import numpy as np

from siren_ros.lab.learning.top_view import Window


def test_a_window_shows_a_picture_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    picture = np.random.default_rng(0).integers(0, 255, (40, 64, 3), dtype=np.uint8)
    window = Window("test")
    window.show(picture, 1000)
    import pygame

    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    assert (shown == picture).all()
    window.close()
    assert pygame.display.get_surface() is None
    window.close()
