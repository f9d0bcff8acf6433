"""The camera model, smooth edges, and the renderer without OpenGL."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from siren_ros.sensing import rig as rig_module
from siren_ros.sensing.camera.camera import RaycastRenderer, smooth_edges
from siren_ros.sensing.camera.renderer import RendererUnavailableError
from siren_ros.sensing.meshes.mesh import SemanticClass
from siren_ros.sensing.rig import SensorRig
from siren_ros.sensing.specification import CameraSpec, Mount, map_from_base, optical_from_map, transform
from siren_ros.sensing.suite import SensorSuite, load_suite
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import CameraIntrinsics

CAMERA = CameraIntrinsics.centred(800, 600, 335.64)
coordinate = st.floats(-20.0, 20.0)


def test_the_field_of_view_spans_the_picture_and_rays_come_back_to_their_pixels():
    camera = load_suite("front").cameras[0].intrinsics
    edge = np.tan(np.radians(50.0))
    uv, depth = camera.project(np.array([[-edge, 0.0, 1.0], [edge, 0.0, 1.0], [0.0, 0.0, 2.0]]))
    assert (uv[0, 0], uv[1, 0]) == (pytest.approx(-0.5), pytest.approx(799.5))
    assert uv[2].tolist() == [399.5, 299.5]
    assert depth.tolist() == [1.0, 1.0, 2.0]
    uv, _ = CAMERA.project(CAMERA.pixel_rays().astype(np.float64) * 7.0)
    columns, rows = np.meshgrid(np.arange(800), np.arange(600))
    assert np.allclose(uv[..., 0], columns, atol=1e-3)
    assert np.allclose(uv[..., 1], rows, atol=1e-3)
    ahead_left_above = optical_from_map(map_from_base(5.0, 5.0, 1.0, np.pi / 2)) @ [4.0, 15.0, 2.0, 1.0]
    assert np.allclose(ahead_left_above[:3], [-1.0, -1.0, 10.0])


@given(coordinate, coordinate, st.floats(0.2, 100.0))
def test_the_clip_matrix_puts_points_where_the_camera_projects_them(x, y, z):
    uv, _ = CAMERA.project(np.array([x, y, z]))
    homogeneous = CAMERA.matrix @ [x, y, z]
    assert np.allclose(uv, homogeneous[:2] / homogeneous[2])
    clip = CAMERA.clip_from_optical(0.1, 500.0) @ [x, y, z, 1.0]
    window = (clip[:2] / clip[3] + 1.0) / 2.0 * [800, 600] - 0.5  # OpenGL: pixel centres at half numbers, row 0 first
    assert np.allclose(window, uv, atol=1e-6 * (1 + np.abs(uv).max()))
    assert clip[3] == pytest.approx(z)


SIZE = 64
DARK, BRIGHT = np.array([20, 40, 60, 3]), np.array([220, 200, 180, 7])


def picture(is_bright):
    return np.where(is_bright[..., None], BRIGHT, DARK).astype(np.uint8)


def smoothed(rgba):
    out = np.array(rgba, order="C")
    smooth_edges(out)
    return out


def places(samples):
    """Rows and columns of sample points, ``samples`` along each side of a pixel."""
    along = (np.arange(SIZE * samples) + 0.5) / samples
    return np.meshgrid(along, along, indexing="ij")


HALF_RAD = np.arctan(0.5)


def errors_of_edge(slant_rad, octant, offset):
    """Sums of the errors of a straight edge before and after."""
    turn_rad = octant // 2 * np.pi / 2 + (slant_rad if octant % 2 else -slant_rad)

    def bright(samples):
        y, x = places(samples)
        return (x - SIZE / 2) * np.cos(turn_rad) + (y - SIZE / 2) * np.sin(turn_rad) > offset

    fine = bright(8).reshape(SIZE, 8, SIZE, 8).mean(axis=(1, 3))
    true = DARK[0] + fine * (BRIGHT[0] - DARK[0])
    drawn = picture(bright(1))
    inner = np.s_[8:-8, 8:-8]
    return [np.abs(p[..., 0] - true)[inner].sum() for p in (drawn, smoothed(drawn))]


@settings(max_examples=20, deadline=None)
@given(st.floats(0.06, 0.7), st.integers(0, 7), st.floats(-8.0, 8.0))
def test_a_straight_edge_comes_nearer_to_its_true_coverage(slant_rad, octant, offset):
    """Most where the edge is nearly level; at 45 degrees its steps have the least length."""
    assume(abs(slant_rad - HALF_RAD) > 0.005)  # the next test's
    before, after = errors_of_edge(slant_rad, octant, offset)
    assert after <= 0.75 * before


@pytest.mark.parametrize("octant", range(8))
def test_an_edge_whose_steps_are_all_alike_comes_nearer_by_a_fifth(octant):
    """On an edge with a slope of 1/2 all steps have two pixels, and on some of them the same error each."""
    for offset in np.arange(-1.0, 1.0, 0.25):
        before, after = errors_of_edge(HALF_RAD, octant, offset)
        assert after <= (0.8 + 1e-9) * before


@pytest.mark.parametrize("block", [np.s_[10:40, :], np.s_[:, 10:40], np.s_[10:40, 12:13], np.s_[10:30, 20:50]])
def test_edges_along_rows_and_columns_and_their_corners_stay_sharp(block):
    shape = np.zeros((SIZE, SIZE), bool)
    shape[block] = True
    assert np.array_equal(smoothed(picture(shape)), picture(shape))
    faint = np.full((SIZE, SIZE, 4), 100, np.uint8)
    faint[np.tri(SIZE, dtype=bool)] += 15
    assert np.array_equal(smoothed(faint), faint)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_rows_are_treated_as_columns_and_labels_stay(seed):
    rng = np.random.default_rng(seed)
    drawn = picture(gaussian_filter(rng.standard_normal((SIZE, SIZE)), 4.0) > 0.0)
    out = smoothed(drawn)
    assert (out[..., :3] != drawn[..., :3]).any()
    assert np.array_equal(out[..., 3], drawn[..., 3])
    for turn in (lambda p: p.transpose(1, 0, 2), lambda p: p[:, ::-1], lambda p: p[::-1]):
        assert np.abs(turn(smoothed(turn(drawn))).astype(int) - out).max() <= 2


SMALL_CAMERA = CameraIntrinsics.centred(160, 120, 80.0)
POSE = map_from_base(-3.0, 1.0, 0.0, 0.2) @ transform(np.eye(3), (0.0, 0.0, 1.5))
NETWORK = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")


def test_it_shows_what_opengl_shows(boxes):
    placement = boxes.placed((ActorClass.SEDAN, 7.0, 2.0, 0.7), (ActorClass.BUS, 18.0, -3.0, 1.9))
    cast, drawn = (
        renderer.render(SMALL_CAMERA, POSE, placement, np.zeros(2), {"s": "r"}, 0, labels=True)
        for renderer in (RaycastRenderer(boxes.crossroads(), boxes.shapes()), boxes.renderer(boxes.crossroads()))
    )
    same = cast.instance == drawn.instance
    assert same.mean() > 0.998
    assert (cast.semantic == drawn.semantic).mean() > 0.995
    near = same & (cast.depth_m > 0.0) & (cast.depth_m < 60.0)
    assert np.quantile(np.abs(cast.depth_m - drawn.depth_m)[near], 0.99) < 0.02
    assert np.abs(cast.rgba[..., :3].astype(float) - drawn.rgba[..., :3]).mean() < 25.0


DRAWN_BY = pytest.mark.parametrize("by", ["opengl", "rays"])


def drawn_by(by, boxes, scene, look=None):
    return boxes.renderer(scene, look) if by == "opengl" else RaycastRenderer(scene, boxes.shapes(), look)


def shot(renderer, placement, signals=None, camera=SMALL_CAMERA, pose=POSE, **options):
    return renderer.render(camera, pose, placement, np.zeros(len(placement)), signals or {}, 0, labels=True, **options)


@DRAWN_BY
def test_a_lit_lens_shines_unless_a_vehicle_is_before_it(by, boxes):
    renderer = drawn_by(by, boxes, boxes.crossroads())
    before = boxes.placed((ActorClass.BUS, 3.5, -1.5, 0.2 + np.pi / 2))
    dark, red = (shot(renderer, boxes.placed(), {"s": state}) for state in "Gr")
    lens = dark.semantic == SemanticClass.TRAFFIC_LIGHT
    assert lens.sum() > 5
    assert red.rgba[..., 0][lens].mean() > dark.rgba[..., 0][lens].mean() + 60
    assert np.array_equal(shot(renderer, boxes.placed()).rgba, dark.rgba)
    dark, red = (shot(renderer, before, {"s": state}) for state in "Gr")
    assert (dark.instance[lens] == 1).all()
    assert np.array_equal(red.rgba, dark.rgba)


@DRAWN_BY
@pytest.mark.parametrize(("x_m", "shown"), [(445.0, True), (455.0, False)])
def test_vehicles_beyond_450_m_are_not_drawn(by, boxes, x_m, shown):
    renderer, camera = drawn_by(by, boxes, boxes.scene()), CameraIntrinsics.centred(160, 120, 1600.0)
    ahead = boxes.placed((ActorClass.SEDAN, x_m, 0.0, 0.0))
    image = shot(renderer, ahead, camera=camera, pose=Mount(0.0, 0.0, 1.5).base_from_sensor)
    assert bool(image.instance.any()) is shown


def test_a_machine_without_egl_casts_rays_and_says_so(boxes, monkeypatch):
    def unavailable(*_):
        raise RendererUnavailableError("no EGL here")

    monkeypatch.setattr(rig_module, "Renderer", unavailable)
    camera = CameraSpec("camera_front", Mount(2.5, 0.0, 1.0), width=80, height=60)
    rig = SensorRig(SensorSuite("one", cameras=(camera,), labels=True), NETWORK, 0, scene=boxes.scene())
    rig.prepare()
    (note,) = rig.notes
    assert "no EGL here" in note
    assert rig.account["notes"] == [note]
    states, descriptions = boxes.actors((ActorClass.SEDAN, 0.0, 0.0, 0.0), (ActorClass.SEDAN, 12.0, 0.5, 0.1))
    seen = rig.observe(states, descriptions, (), 1)
    assert (seen.frames[0].rgb.shape, seen.labels["camera_front"].actor_id.tolist()) == ((60, 80, 3), [2])
    assert seen.labels["camera_front"].visible_fraction[0] > 0.95


def test_two_renderers_in_one_thread_do_not_disturb_each_other(boxes):
    placement = boxes.placed((ActorClass.SEDAN, 7.0, 2.0, 0.7))
    first = boxes.renderer(boxes.scene())

    def pixels(renderer):
        return renderer.render(SMALL_CAMERA, POSE, placement, np.zeros(1), {}, 0).rgba.tobytes()

    alone, other = pixels(first), pixels(boxes.renderer(boxes.crossroads()))
    assert pixels(first) == alone != other
