import numpy as np

from siren_ros.sensing import rig as rig_module
from siren_ros.sensing.camera.raycast_renderer import RaycastRenderer
from siren_ros.sensing.camera.renderer import RendererUnavailableError
from siren_ros.sensing.rig import SensorRig
from siren_ros.sensing.specification import CameraSpec, Mount, map_from_base, transform
from siren_ros.sensing.suite import SensorSuite
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.measurements import CameraIntrinsics

CAMERA = CameraIntrinsics.centred(160, 120, 80.0)
POSE = map_from_base(-3.0, 1.0, 0.0, 0.2) @ transform(np.eye(3), (0.0, 0.0, 1.5))
NETWORK = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")


def test_it_shows_what_opengl_shows(boxes):
    placement = boxes.placed((ActorClass.SEDAN, 7.0, 2.0, 0.7), (ActorClass.BUS, 18.0, -3.0, 1.9))
    cast, drawn = (
        renderer.render(CAMERA, POSE, placement, np.zeros(2), {"s": "r"}, 0, labels=True)
        for renderer in (RaycastRenderer(boxes.crossroads(), boxes.shapes()), boxes.renderer(boxes.crossroads()))
    )
    same = cast.instance == drawn.instance
    assert same.mean() > 0.998
    assert (cast.semantic == drawn.semantic).mean() > 0.995
    near = same & (cast.depth_m > 0.0) & (cast.depth_m < 60.0)
    assert np.quantile(np.abs(cast.depth_m - drawn.depth_m)[near], 0.99) < 0.02
    assert np.abs(cast.rgba[..., :3].astype(float) - drawn.rgba[..., :3]).mean() < 25.0


def test_a_machine_without_egl_casts_rays_and_says_so(boxes, monkeypatch):
    def unavailable(*_):
        raise RendererUnavailableError("no EGL here")

    monkeypatch.setattr(rig_module, "Renderer", unavailable)
    camera = CameraSpec("camera_front", Mount(2.5, 0.0, 1.0), width=80, height=60)
    rig = SensorRig(SensorSuite("one", cameras=(camera,), labels=True), NETWORK, 0, scene=boxes.scene())
    rig.prepare()
    assert len(rig.notes) == 1
    assert "no EGL here" in rig.notes[0]
    assert "cast rays" in rig.notes[0]
    assert rig.account["notes"] == list(rig.notes)
    assert "no OpenGL" in str(rig.account["pictures_by"])
    states, descriptions = boxes.actors((ActorClass.SEDAN, 0.0, 0.0, 0.0), (ActorClass.SEDAN, 12.0, 0.5, 0.1))
    seen = rig.observe(states, descriptions, (), 1)
    assert (seen.frames[0].rgb.shape, seen.labels["camera_front"].actor_id.tolist()) == ((60, 80, 3), [2])
    assert seen.labels["camera_front"].visible_fraction[0] > 0.95


def test_two_renderers_in_one_thread_do_not_disturb_each_other(boxes):
    placement = boxes.placed((ActorClass.SEDAN, 7.0, 2.0, 0.7))
    first = boxes.renderer(boxes.scene())

    def pixels(renderer):
        return renderer.render(CAMERA, POSE, placement, np.zeros(1), {}, 0).rgba.tobytes()

    alone, other = pixels(first), pixels(boxes.renderer(boxes.crossroads()))
    assert pixels(first) == alone != other
