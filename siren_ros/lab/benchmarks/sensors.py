"""Measures the speed of LiDAR and cameras: ``python -m siren_ros.benchmarks.sensors [--map FILE]``."""

import argparse
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import simplejpeg

from siren_ros.base.numerics.arrays import Matrix
from siren_ros.sensing.camera.renderer import RenderedImage, Renderer
from siren_ros.sensing.lidar.embree import RaycastWorld, RayHits, TriangleTree, tiles
from siren_ros.sensing.lidar.lidar import Lidar
from siren_ros.sensing.meshes.mesh import Catalogue, Mesh, StaticScene, VehiclePlacement, VehicleShape
from siren_ros.sensing.scene.static_scene import static_scene
from siren_ros.sensing.specification import map_from_base
from siren_ros.sensing.suite import load_suite
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorDescription, ActorStates
from siren_ros.simulation.world.carrier import CameraIntrinsics

_ROUNDS = 60
_CARRIER_ID = 1
_NEIGHBOURHOOD_LANES = 14
_SPACING_M = 9.0


def traffic(
    network: RoadNetwork, shapes: dict[ActorClass, VehicleShape], vehicles: int
) -> tuple[ActorStates, dict[int, ActorDescription]]:
    """An ambulance, and vehicles on the lanes around it, as measured traffic."""
    rng = np.random.default_rng(0)
    lanes = [lane for lane in network.lanes if lane.kind == LaneKind.DRIVING and lane.length_m > 40.0]
    middle = np.array([lane.centre.at(lane.length_m / 2.0) for lane in lanes])
    busiest = int(np.argmin(np.linalg.norm(middle - middle.mean(axis=0), axis=1)))
    near = np.argsort(np.linalg.norm(middle - middle[busiest], axis=1), kind="stable")[:_NEIGHBOURHOOD_LANES]
    places = [
        (*lanes[row].centre.at(s), float(lanes[row].centre.heading_rad(s)))
        for row in near
        for s in np.arange(5.0, lanes[row].length_m - 5.0, _SPACING_M)
    ]
    chosen = [0, *(1 + rng.permutation(len(places) - 1)[:vehicles])]
    classes = [ActorClass.AMBULANCE, *(ActorClass(int(code)) for code in rng.integers(0, 8, len(chosen) - 1))]
    x_m, y_m, yaw_rad = np.array([places[i] for i in chosen]).T.copy()
    known = {"actor_id": np.arange(1, len(chosen) + 1, dtype=np.uint32), "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad}
    arrays: dict[str, Any] = {
        name: known.get(name, np.zeros(len(chosen), dtype)) for name, dtype in ACTOR_STATE_DTYPES.items()
    }
    descriptions = {}
    for actor_id, kind in enumerate(classes, start=1):
        s = shapes[kind]
        size = (s.length_m, s.width_m, s.height_m)
        descriptions[actor_id] = ActorDescription(actor_id, f"v{actor_id}", kind, *size, (120, 130, 150))
    return ActorStates(step=0, **arrays), descriptions


def milliseconds(*works: Callable[[], object]) -> list[float]:
    """Median time of each function; they alternate, so that all run under the same load."""
    times: list[list[float]] = [[] for _ in works]
    for _ in range(_ROUNDS):
        for work, taken in zip(works, times, strict=True):
            start = time.perf_counter()
            work()
            taken.append(time.perf_counter() - start)
    return [1e3 * float(np.median(taken)) for taken in times]


def whole_scene(static: StaticScene, shapes: dict[ActorClass, VehicleShape], placement: VehiclePlacement) -> Mesh:
    """Static scene and vehicles as one mesh."""
    parts = [static.mesh]
    for row in range(len(placement)):
        pose = map_from_base(placement.x_m[row], placement.y_m[row], placement.z_m[row], float(placement.yaw_rad[row]))
        shape = shapes[ActorClass(int(placement.actor_class[row]))].at_rest
        parts.append(shape.transformed(pose[:3, :3], pose[:3, 3]))
    return Mesh.joined(*parts)


def lidar_figures(
    static: StaticScene,
    shapes: dict[ActorClass, VehicleShape],
    states: ActorStates,
    descriptions: dict[int, ActorDescription],
    base: Matrix,
) -> None:
    """Print rays per second of a whole sweep and, for comparison, of only casting the same rays.

    The bare casts are Open3D's ``cast_rays`` and our own packets; all of them use all cores.
    """
    spec = load_suite("lidar").lidars[0]
    lidar = Lidar(spec, RaycastWorld(static, shapes), 0)
    catalogue = Catalogue(shapes)
    pose = base @ spec.mount.base_from_sensor
    mesh = whole_scene(static, shapes, catalogue.place(states, descriptions, _CARRIER_ID))
    import open3d as o3d  # noqa: PLC0415 - loads slowly, and only this comparison needs it

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor.from_numpy(mesh.vertices_m), o3d.core.Tensor.from_numpy(mesh.triangles))
    rays = lidar.rays(pose).copy()
    tensor = o3d.core.Tensor.from_numpy(rays)
    tree = TriangleTree([(mesh.vertices_m, mesh.triangles)])
    hits, order = RayHits.for_rays(len(rays)), tiles(spec.columns, spec.channels)

    def sweep() -> object:
        return lidar.scan(0, pose, catalogue.place(states, descriptions, _CARRIER_ID)).payload

    sweep()
    open3d_ms, packets_ms, ours_ms = milliseconds(
        lambda: scene.cast_rays(tensor), lambda: tree.cast(rays, hits, order), sweep
    )
    print(f"LiDAR, {len(rays)} rays, {len(mesh)} triangles, {len(states)} vehicles")
    for name, ms in (("Open3D's cast_rays", open3d_ms), ("bare packets", packets_ms), ("sweep to payload", ours_ms)):
        print(f"  {name:20} {ms:6.2f} ms  {len(rays) / ms / 1e3:6.2f} M rays/s")
    print(f"  sweep's rate to cast_rays' {open3d_ms / ours_ms:6.2f}, to the bare packets' {packets_ms / ours_ms:.2f}")


def camera_figures(
    static: StaticScene,
    shapes: dict[ActorClass, VehicleShape],
    states: ActorStates,
    descriptions: dict[int, ActorDescription],
    base: Matrix,
) -> None:
    """Print the time of each camera's picture: drawing with read-back, with labels, and the JPEG.

    The vehicles are placed again for every picture; in an episode up to four cameras share one placement.
    """
    start = time.perf_counter()
    renderer = Renderer(static, shapes)
    catalogue = Catalogue(shapes)
    print(f"cameras on {renderer.device}, ready after {time.perf_counter() - start:.1f} s")
    for spec in load_suite("full").cameras:
        camera, pose = spec.intrinsics, base @ spec.mount.base_from_sensor

        def draw(labels: bool, camera: CameraIntrinsics = camera, pose: Matrix = pose) -> RenderedImage:
            placement = catalogue.place(states, descriptions, _CARRIER_ID)
            return renderer.render(camera, pose, placement, np.zeros(len(placement)), {}, 0, labels=labels)

        image = draw(False)
        colour_ms, bare_ms, labels_ms, jpeg_ms = milliseconds(
            lambda draw=draw: draw(False),  # type: ignore[misc]  # a default binds this camera's function
            lambda camera=camera: renderer.draw_again(camera),  # type: ignore[misc]  # likewise
            lambda draw=draw: draw(True),  # type: ignore[misc]  # a default binds this camera's function
            lambda image=image, spec=spec: simplejpeg.encode_jpeg(image.rgba, spec.jpeg_quality, "RGBX", "420"),  # type: ignore[misc]  # likewise
        )
        ratio = f"{colour_ms / bare_ms:4.2f} of the bare draw's {bare_ms:5.1f} ms"
        print(f"  {spec.name:18} {colour_ms:6.1f} ms, {ratio}; with labels {labels_ms:6.1f} ms; JPEG {jpeg_ms:4.1f} ms")


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description="Speed of LiDAR and cameras on this machine.")
    parser.add_argument("--map", type=Path, help="SUMO net, OpenDRIVE or OpenStreetMap file; the town without it")
    parser.add_argument("--vehicles", type=int, default=40)
    options = parser.parse_args()
    network = parse_road_network(compile_map(options.map).read_bytes())
    shapes = {kind: vehicle_shape(kind) for kind in ActorClass}
    start = time.perf_counter()
    static = static_scene(network, 0)
    print(f"scene of {len(static.mesh)} triangles in {time.perf_counter() - start:.1f} s")
    states, descriptions = traffic(network, shapes, options.vehicles)
    base = map_from_base(float(states.x_m[0]), float(states.y_m[0]), 0.0, float(states.yaw_rad[0]))
    lidar_figures(static, shapes, states, descriptions, base)
    camera_figures(static, shapes, states, descriptions, base)
    print(f"memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
