"""What charts share: colours, quiet axes, legends without a box, files."""

from pathlib import Path

import pytest
from PIL import Image

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.charts.chart import DPI, colour_of_model, legend, new_figure, quiet, save


def test_models_differ_in_their_colours_until_there_are_many() -> None:
    models = [f"model{number}" for number in range(11)]
    colours = [colour_of_model(models, model) for model in models]
    assert len(set(colours[:9])) == 9
    assert colours[9:] == colours[:2]


def test_quiet_axes_have_no_box_and_their_grid_is_behind() -> None:
    axes = new_figure(3.0, 2.0).add_subplot()
    quiet(axes)
    assert {side: axes.spines[side].get_visible() for side in ("top", "right", "left", "bottom")} == {
        "top": False, "right": False, "left": True, "bottom": True
    }  # fmt: skip
    assert axes.get_axisbelow() is True
    assert all(line.get_visible() for line in axes.get_xgridlines())


def test_a_legend_has_no_frame() -> None:
    axes = new_figure(3.0, 2.0).add_subplot()
    axes.plot([0.0, 1.0], [0.0, 1.0], label="a line")
    legend(axes)
    shown = axes.get_legend()
    assert shown is not None
    assert not shown.get_frame_on()


def test_a_figure_has_its_size_in_the_file(tmp_path: Path) -> None:
    save(new_figure(3.0, 2.0), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (3 * DPI, 2 * DPI)
    with pytest.raises(InputError, match="deep"):
        save(new_figure(3.0, 2.0), tmp_path / "deep" / "a.png")
