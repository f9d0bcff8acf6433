"""Caches static scenes as files next to the compiled maps, because building a town's scene takes seconds."""

import hashlib
import io
import json
import logging
import zipfile
from contextlib import suppress
from dataclasses import astuple
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from siren_ros.base.user_folder import default_cache_dir, store_in_cache
from siren_ros.errors import InputError
from siren_ros.sensing.meshes.mesh import LampColour, Mesh, SignalLamp, StaticScene
from siren_ros.sensing.scene.static_scene import static_scene
from siren_ros.sensing.scene.surfaces import SceneConfig
from siren_ros.simulation.roads.road_network import RoadNetwork

KEPT: Final = 24
"""Number of files that are kept, those used most recently; a town's file has 5 MB."""
CODE: Final = ("base/numerics", "simulation/roads", "simulation/world", "sensing/meshes", "sensing/scene")
"""Folders of the library whose code builds the triangles."""
_PACKAGES: Final = ("numpy", "shapely", "mapbox-earcut")
_COLUMNS: Final = ("vertices_m", "triangles", "material", "colour_rgb")
"""The arrays of ``Mesh`` that a file holds."""
_UNREADABLE: Final = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    TypeError,
    zipfile.BadZipFile,
    shapely.errors.GEOSException,
)


def kept_scene(network: RoadNetwork, seed: int, config: SceneConfig | None = None) -> StaticScene:
    """``static_scene`` with a cache: it loads the file of an earlier call, or builds the scene and leaves a file.

    The file's name is a hash of all that makes the scene: the net, the seed, the numbers, the code and the packages
    that it calls. A file that is damaged is made again; where the folder cannot be written, nothing is left. A network
    that is not as ``parse_road_network`` made it is always built, and so are scenes with parked vehicles, whose sizes
    are those of a parameter file.
    """
    numbers = config or SceneConfig()
    if not network.net_sha256 or numbers.parked_share:
        return static_scene(network, seed, config)
    key = hashlib.sha256("\0".join((network.net_sha256, str(seed), repr(numbers), recipe())).encode()).hexdigest()
    file = default_cache_dir() / f"scene-{key[:32]}.npz"
    with suppress(*_UNREADABLE):
        scene = _read(file.read_bytes(), key)
        file.touch()
        return scene
    logging.getLogger("siren_ros").info("building the static scene; later calls have it from the cache")
    scene = static_scene(network, seed, config)
    with suppress(OSError, InputError):
        store_in_cache(file, _written(scene, key))
        used_last = sorted(file.parent.glob("scene-*.npz"), key=lambda one: one.stat().st_mtime_ns, reverse=True)
        for old in used_last[KEPT:]:
            old.unlink(missing_ok=True)
    return scene


@cache
def recipe() -> str:
    """What decides the result of a build: the source code, and the versions of the packages that it calls."""
    library = Path(__file__).parents[2]
    code = hashlib.sha256()
    for file in sorted(file for name in CODE for file in (library / name).rglob("*.py")):
        code.update(file.read_bytes())
    return "\0".join((code.hexdigest(), *map(version, _PACKAGES), shapely.geos_version_string))


def _written(scene: StaticScene, key: str) -> bytes:
    content = io.BytesIO()
    columns: dict[str, Any] = {name: getattr(scene.mesh, name) for name in _COLUMNS}
    head = {"key": key, "lamps": list(map(astuple, scene.signal_lamps)), "raised_m": scene.raised_m}
    raised = np.frombuffer(shapely.to_wkb(scene.raised), np.uint8)
    np.savez(content, head=np.array(json.dumps(head)), raised=raised, **columns)
    return content.getvalue()


def _read(content: bytes, key: str) -> StaticScene:
    with np.load(io.BytesIO(content)) as file:
        head = json.loads(str(file["head"]))
        if head["key"] != key:
            raise ValueError(head["key"])
        raised = shapely.from_wkb(file["raised"].tobytes())
        mesh = Mesh(**{name: file[name] for name in _COLUMNS})
    shapely.prepare(raised)
    lamps = tuple(
        SignalLamp(signal, link, LampColour(colour), start, stop) for signal, link, colour, start, stop in head["lamps"]
    )
    return StaticScene(mesh, lamps, raised, head["raised_m"])
