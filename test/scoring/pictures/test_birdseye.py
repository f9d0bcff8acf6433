"""Pictures from above: of an episode and of a site."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from busy_record import busy_record
from drawn_figures import shown
from hand_made_record import EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made, with_states
from known_outputs import assert_known
from map_networks import network_of_map
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from PIL import Image
from repository import REPOSITORY

from siren_ros.data.interfaces.boxes import EMV_COLOUR
from siren_ros.errors import InputError
from siren_ros.running.generation.site_choice import good_sites, shortcomings
from siren_ros.scoring.pictures.birdseye import (
    Survey,
    draw_episode,
    draw_site_map,
    interaction_box,
    interaction_steps,
    save_episode_picture,
    save_site_map,
    snapshot_steps,
)
from siren_ros.scoring.pictures.plot_parts import LabelPlacer, draw_roads, lane_outline
from siren_ros.simulation.roads.road_network import RoadNetwork, mirrored_network
from siren_ros.simulation.roads.site_finder import places_without_site
from siren_ros.simulation.scenario.templates import available_templates, load_template
from siren_ros.simulation.world.actors import Event, EventKind, Mode


@pytest.fixture(scope="module")
def record(record_of):
    return record_of()


@pytest.fixture(scope="module")
def picture(record, tmp_path_factory):
    return save_episode_picture(record, tmp_path_factory.mktemp("pictures") / "new" / "episode.png")


def _share_of(path, colour):
    pixels = np.asarray(Image.open(path).convert("RGB"), dtype=np.int64)
    distance = np.abs(pixels - np.round(np.array(colour[:3]) * 255).astype(np.int64)).max(axis=-1)
    return float((distance <= 3).mean())


def test_the_picture_shows_the_emv_and_the_road_in_the_same_bytes_again(record, picture, tmp_path):
    assert _share_of(picture, EMV_COLOUR) > 0.001
    assert _share_of(picture, (0xC9 / 255, 0xCD / 255, 0xD2 / 255)) > 0.05
    assert save_episode_picture(record, tmp_path / "again.png").read_bytes() == picture.read_bytes()


def _texts(figure):
    return [text.get_text() for text in figure.texts] + [
        text.get_text() for axes in figure.axes for text in axes.texts if text.get_text()
    ]


def test_the_box_holds_the_interaction_and_not_the_whole_map(record):
    first, last = interaction_steps(record)
    assert (first, last) == (0, 247)
    x0, x1, y0, y1 = interaction_box(record)
    assert x0 < 10.0
    assert 183.0 < x1 < 220.0
    assert y1 - y0 >= 40.0


def test_without_a_yield_the_interaction_is_around_the_emvs_stop_line():
    record = hand_made(crossing(), {key: Driven(NORTHBOUND, at_speed(40.0, 5.0, 400)) for key in (EMV, 2)})
    assert interaction_steps(record) == (0, 399)
    events = tuple(Event(step, EventKind.STOP_LINE_CROSSED, actor) for step, actor in [(90, 2), (250, EMV)])
    assert interaction_steps(replace(record, events=events)) == (150, 350)
    assert interaction_steps(replace(record, events=events[:1])) == (0, 399)


def yields_at(*steps):
    """The EMV, one civilian beside it that yields at some steps, and one far away that always does."""
    drives = {EMV: 40.0, 2: 45.0, 3: 110.0}
    made = hand_made(crossing(), {key: Driven(NORTHBOUND, at_speed(at_m, 0.1, 400)) for key, at_m in drives.items()})

    def modes(state):
        mode = np.where(state.actor_id == 3, Mode.YIELD_REACTING, Mode.NOMINAL)
        return np.where((state.actor_id == 2) & (state.step in steps), Mode.YIELD_HOLD, mode).astype(state.mode.dtype)

    return with_states(made, mode=modes)


def test_snapshots_are_where_somebody_yields_near_the_emv():
    assert interaction_steps(yields_at()) == (0, 399)
    assert snapshot_steps(yields_at(5, 260, 399)) == [5, 260, 399]
    assert snapshot_steps(yields_at()) == pytest.approx([67, 200, 333], abs=1), "else in the middle of the thirds"
    assert snapshot_steps(yields_at(200, 201, *range(300, 380)))[1:] == [200, pytest.approx(333, abs=1)]


def test_with_many_events_each_actor_has_one_label_without_a_time(record):
    times = [event.step for event in record.events if event.kind is EventKind.YIELD_STARTED]
    more = tuple(replace(event, step=event.step + k) for event in record.events for k in range(4))
    labels = [text for text in _texts(draw_episode(replace(record, events=more))) if text.startswith("#")]
    assert times
    assert not any(text.endswith(" s") for text in labels)


def test_a_lane_outline_has_the_lanes_area(record):
    lane = record.network.lanes[0]
    x, y = lane_outline(lane).T
    area = abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2.0
    assert area == pytest.approx(lane.length_m * lane.width_m)


def drawn_lines(network):
    """Lines of a road picture, each with whether it is dashed, in any order."""
    axes = Figure().add_subplot()
    draw_roads(axes, network, line_width=1.0)
    lines = [collection for collection in axes.collections if isinstance(collection, LineCollection)]
    return {
        (tuple(map(tuple, line.round(6) + 0.0)), collection.get_linestyle()[0][1] is not None)
        for collection in lines
        for line in collection.get_segments()
    }


def test_where_traffic_keeps_left_the_lines_are_the_mirror_image(record):
    network = record.network
    image = {(tuple((x, -y + 0.0) for x, y in line), dashed) for line, dashed in drawn_lines(mirrored_network(network))}
    drawn = drawn_lines(network)
    assert {dashed for _, dashed in drawn} == {True, False}
    assert image == drawn


def test_labels_never_cover_each_other():
    axes = Figure(figsize=(4, 3), dpi=100).add_axes((0, 0, 1, 1))
    axes.set_xlim(0, 40)
    axes.set_ylim(0, 30)
    placer = LabelPlacer(axes, 6.0)
    placed = [placer.place(20.0, 15.0, f"#{number} 1.0 s", "black") for number in range(60)]
    assert placed[0]
    assert not placed[-1]
    boxes = placer.taken
    assert not any(a.overlaps(b) for row, a in enumerate(boxes) for b in boxes[:row])


def test_nothing_to_draw_is_said_and_only_png_is_written(record, tmp_path):
    with pytest.raises(InputError, match="actor state"):
        draw_episode(replace(record, states=()))
    with pytest.raises(InputError, match=r"\.png"):
        save_episode_picture(record, tmp_path / "episode.txt")
    assert list(tmp_path.iterdir()) == []


TEMPLATES = [load_template(name) for name in available_templates()]


@pytest.fixture(scope="module", params=["town", "signs.osm"])
def network(request) -> RoadNetwork:
    file = None if request.param == "town" else REPOSITORY / "test" / "maps" / request.param
    return network_of_map(file)


def surveys(network: RoadNetwork, count: int = len(TEMPLATES)) -> list[Survey]:
    return [(template, shortcomings(network, template)) for template in TEMPLATES[:count]]


def test_each_panel_counts_what_it_draws(network: RoadNetwork) -> None:
    found = surveys(network)
    panels = draw_site_map([network] * len(TEMPLATES), found).axes
    for axes, (template, sites) in zip(panels, found, strict=True):
        others = places_without_site(network, template.site_kind)
        good = len(good_sites(network, template))
        roads, *drawn = axes.collections
        assert len(roads.get_segments()) > 0
        assert sum(len(ways.get_segments()) for ways in drawn) == len(sites)
        assert sum(len(markers.get_xdata()) for markers in axes.lines) == len(others)
        title = f"{good} good of {len(sites)} sites" if sites else "no site"
        assert axes.texts[-2].get_text() == f"{template.template_id}: {title}"
        legend = [text.get_text() for text in axes.get_legend().get_texts()]
        assert sum(int(text.rsplit(": ", 1)[1]) for text in legend) == len(sites) + len(others)
        colours = [handle.get_color() for handle in axes.get_legend().legend_handles]
        assert len(set(colours)) == len(colours)
        used = {to_hex(ways.get_color()[0]) for ways in drawn if len(ways.get_segments())}
        used |= {markers.get_color() for markers in axes.lines if len(markers.get_xdata())}
        assert used == set(colours), "they tell what is lacking"


def test_the_same_map_gives_the_same_bytes_in_a_png_file(network: RoadNetwork, tmp_path: Path) -> None:
    first, second = (save_site_map([network], surveys(network, 1), tmp_path / "sub" / f"{n}.png") for n in (1, 2))
    assert first.read_bytes() == second.read_bytes()
    with pytest.raises(InputError, match=r"ends in \.png"):
        save_site_map([network], surveys(network, 1), tmp_path / "sites.pdf")


def test_everything_that_the_picture_of_a_busy_episode_shows() -> None:
    found = shown(draw_episode(busy_record()))
    assert_known(Path(__file__).parent / "known" / "birdseye.json", found, digits=4, decimals=2)
