"""Draws sensor data at one instant of a recorded episode: cameras, and LiDARs coloured by height and instance.

Suite and look may differ from the recording's, so that a bag without sensors can be viewed too.
"""

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from PIL import Image

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, whole_file, writing
from siren_ros.sensing.lidar.lidar import LidarSweep
from siren_ros.sensing.look import Look
from siren_ros.sensing.rig import Observations, SensorRig
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.sensing.specification import Mount, optical_from_map
from siren_ros.sensing.suite import SensorSuite
from siren_ros.simulation.world.carrier import CameraIntrinsics

_PANEL: Final = (800, 600)
_COLUMNS: Final = 2
_GAP_PX: Final = 8
_BACKGROUND: Final = (16, 18, 26)
_STATIC: Final = (84, 90, 100)
_EYE: Final = Mount(-26.0, 0.0, 20.0, pitch_rad=float(np.radians(32.0)))
"""Viewpoint of a drawn point cloud in the sensor's frame: behind and above."""
_FOCAL_PX: Final = 560.0
_HEIGHTS_M: Final = (-2.5, 9.0)
_NEAREST_M: Final = 1.0

Picture = npt.NDArray[np.uint8]


def observe_at(
    record: EpisodeRecord, time_s: float, suite: SensorSuite, look: Look, carrier_id: int | None = None
) -> Observations:
    """Simulate a suite at a simulated time: at the last earlier step at which all its sensors are due.

    The carrier is the first emergency vehicle where None. Raises InputError for a time outside the episode, or a
    carrier that is not there at that time.
    """
    if not 0.0 <= time_s < record.duration_s:
        raise InputError("time", time_s, f"a time from 0 to {record.duration_s:g} s")
    row = min(steps_from_s(time_s), record.steps - 1) // suite.common_period_steps * suite.common_period_steps
    states, traffic = record.states[row], record.traffic[row]
    carrier = record.emv_ids[0] if carrier_id is None else carrier_id
    if suite.station is None and carrier not in states.actor_id:
        raise InputError("carrier", carrier, f"an actor that is on the map at {time_s:g} s")
    described = record.description
    config = scene_config_of(described.template_values)
    rig = SensorRig(suite, record.network, described.seed, config, look=look, site=described.site)
    return rig.observe(states, record.actors, traffic.signals, carrier)


def sheet(seen: Observations) -> Picture:
    """Join all pictures and point clouds to one image, ``(H, W, 3)``; InputError without cameras and LiDARs."""
    panels = [_fitted(frame.rgb) for frame in seen.frames]
    for sweep in seen.sweeps:
        panels.extend((cloud_by_height(sweep), cloud_by_instance(sweep)))
    if not panels:
        raise InputError("suite", "no cameras and no LiDARs", "a suite with a camera or a LiDAR")
    width, height = _PANEL
    rows = -(-len(panels) // _COLUMNS)
    columns = min(_COLUMNS, len(panels))
    whole = np.empty((rows * (height + _GAP_PX) - _GAP_PX, columns * (width + _GAP_PX) - _GAP_PX, 3), np.uint8)
    whole[:] = _BACKGROUND
    for number, panel in enumerate(panels):
        top = number // _COLUMNS * (height + _GAP_PX)
        left = number % _COLUMNS * (width + _GAP_PX)
        whole[top : top + height, left : left + width] = panel
    return whole


def save_sheet(seen: Observations, path: Path) -> Path:
    """Write a sheet as PNG or JPEG, by its suffix; InputError for another suffix or a missing folder."""
    if path.suffix.lower() not in {".png", ".jpg", ".jpeg"}:
        raise InputError("out", path, "a name that ends in .png or .jpg")
    with writing(path), whole_file(path) as file:
        Image.fromarray(sheet(seen)).save(file, optimize=True, quality=88)
    return path


def cloud_by_height(sweep: LidarSweep) -> Picture:
    """Draw a point cloud from behind and above, coloured by height."""
    low, high = _HEIGHTS_M
    share = np.clip((sweep.points["z"].astype(np.float64) - low) / (high - low), 0.0, 1.0)
    return _cloud(sweep, _coloured("turbo", share))


def cloud_by_instance(sweep: LidarSweep) -> Picture:
    """Draw a point cloud from behind and above, with one colour per vehicle."""
    instance = sweep.points["instance"].astype(np.int64)
    colours = _coloured("hsv", instance * 0.618034 % 1.0)
    colours[instance == 0] = _STATIC
    return _cloud(sweep, colours)


def _cloud(sweep: LidarSweep, colours: Picture) -> Picture:
    camera = CameraIntrinsics.centred(*_PANEL, _FOCAL_PX)
    ones = np.ones(len(sweep.points))
    points = np.stack([*(sweep.points[axis].astype(np.float64) for axis in "xyz"), ones], axis=1)
    uv, depth = camera.project((points @ optical_from_map(_EYE.base_from_sensor).T)[:, :3])
    picture = np.empty((camera.height, camera.width, 3), np.uint8)
    picture[:] = _BACKGROUND
    pixel = np.rint(uv).astype(np.int64)
    shown = (depth > _NEAREST_M) & np.all((pixel >= 0) & (pixel < (camera.width, camera.height)), axis=1)
    order = np.flatnonzero(shown)[np.argsort(-depth[shown], kind="stable")]
    picture[pixel[order, 1], pixel[order, 0]] = colours[order]
    return picture


def _coloured(name: str, share: Floats) -> Picture:
    return np.asarray(mpl.colormaps[name](share, bytes=True))[:, :3].copy()


def _fitted(rgb: Picture) -> Picture:
    """Shrink a picture to a panel's size and centre it."""
    image = Image.fromarray(rgb)
    image.thumbnail(_PANEL)
    panel = Image.new("RGB", _PANEL, _BACKGROUND)
    panel.paste(image, ((_PANEL[0] - image.width) // 2, (_PANEL[1] - image.height) // 2))
    return np.asarray(panel)
