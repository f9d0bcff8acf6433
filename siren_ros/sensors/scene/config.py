"""Numbers of the generated world; metres unless the name says otherwise."""

from dataclasses import dataclass

from siren_ros.errors import InputError


@dataclass(frozen=True)
class SceneConfig:
    """How the static scene is generated. Lengths and heights in metres."""

    ground_margin_m: float = 150.0
    """Grass around the map's bounds."""
    road_extension_m: float = 90.0
    """How far a road goes on, in the picture only, beyond a dead end of the network."""
    kerb_height_m: float = 0.13
    kerb_width_m: float = 0.15
    verge_width_m: float = 2.0
    """Gravel beside the carriageway of maps without sidewalks."""
    line_width_m: float = 0.12
    """Longitudinal lines (RMS, German road markings: 0.12 m in towns)."""
    dash_m: float = 3.0
    """Lane dividers in towns: 3 m line, 6 m gap (RMS)."""
    dash_gap_m: float = 6.0
    solid_before_junction_m: float = 20.0
    """Lane dividers are solid this far before a signal or stop sign."""
    stop_line_depth_m: float = 0.5
    zebra_stripe_m: float = 0.5
    zebra_depth_m: float = 2.6
    """Length of the stripes of crossings that the map does not define."""
    lamp_spacing_m: float = 34.0
    lamp_height_m: float = 7.5
    tree_spacing_m: float = 13.0
    building_setback_m: float = 3.0
    """From the sidewalk's outer edge, or from the verge, to the façade."""
    building_height_m: tuple[float, float] = (6.0, 25.0)
    skyline_m: float = 90.0
    """How far behind the road the second row of buildings reaches."""
    clearance_m: float = 4.6
    """Nothing hangs lower than this over lanes, shoulders and junctions (StVO: 4.5 m headroom)."""
    tile_m: float = 30.0
    """Surfaces are cut to tiles of this size, so that ray casting finds compact triangles."""

    def __post_init__(self) -> None:
        for name in ("ground_margin_m", "road_extension_m", "kerb_height_m", "verge_width_m", "skyline_m"):
            if getattr(self, name) < 0:
                raise InputError(name, getattr(self, name), "a number of metres, at least 0")
        for name in (
            "line_width_m",
            "dash_m",
            "dash_gap_m",
            "lamp_spacing_m",
            "tree_spacing_m",
            "tile_m",
            "zebra_stripe_m",
        ):
            if getattr(self, name) <= 0:
                raise InputError(name, getattr(self, name), "a number of metres above 0")
        low, high = self.building_height_m
        if not 3.0 <= low <= high:
            raise InputError("building_height_m", self.building_height_m, "lowest and highest, at least 3 m")
