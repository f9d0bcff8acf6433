"""Reading templates from YAML, strictly: every mistake is refused with file, line and what is allowed."""

import re
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final, TypeVar

from siren_ros.base.params.folders import names_in_params
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFiles, StrictMapping, read_strict_yaml
from siren_ros.errors import InputError, SirenError
from siren_ros.simulation.roads.maps.map_compiler import BUILT_IN_MAPS
from siren_ros.simulation.roads.maps.road_space import SPACES
from siren_ros.simulation.roads.sites import SiteKind
from siren_ros.simulation.scenario.driver_parameters import DRIVER_PARAMETERS
from siren_ros.simulation.scenario.paper import EmergencyLevel, level_name
from siren_ros.simulation.scenario.scenario import (
    DECLARED_PREDICATES,
    STANDS_MAX,
    BehaviourFamily,
    CivilianResponseDemand,
    Demand,
    DemandGroup,
    EmvDemand,
    GroupAnchor,
    JamDemand,
    PeopleDemand,
    Placement,
    PredicateDemand,
    SignalDemand,
    StartReference,
    Template,
    ValueRange,
    VarietyDemand,
    draw_values,
    realised,
)
from siren_ros.simulation.world.actors import EMERGENCY_CLASSES, PEOPLE_CLASSES, ActorClass

__all__ = ["Template", "available_templates", "draw_values", "load_template", "read_template", "realised"]

_ID: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")
_SHARE_TOLERANCE: Final = 1e-6
_MAX_SPEED_MPS: Final = 60.0
_MAX_VEHICLES: Final = 500
_MAX_EMVS: Final = 8
_MAX_AFTER_S: Final = 60.0
_MAX_RED_S: Final = 120.0
_MAX_PER_LANE_KM: Final = 60.0
_DISTRICT: Final = "district_per_lane_km"
_PEOPLE: Final = "people"
_VARIETY: Final = "variety"


def available_templates() -> tuple[str, ...]:
    """Names of the templates in ``params/templates``."""
    return names_in_params("templates")


def load_template(name_or_path: str, files: InputFiles = FILES_ON_DISK) -> Template:
    """A template with its default values, by its name or from a YAML file.

    Raises:
        InputError: unknown template; or a file with an unknown or missing key, a value out of range or
            of the wrong type, or no predicate: names file, line, key, value and what is allowed.
    """
    return _template(files.read("template", "templates", name_or_path).mapping())


def own_level(template: str) -> str:
    """The level that a template's file states; empty where the template is not one of the project's."""
    try:
        return load_template(template).level.name
    except SirenError:
        return ""


def read_template(file: Path) -> Template:
    """A template from a YAML file; raises InputError as ``load_template`` does."""
    return _template(read_strict_yaml(file))


def _template(top: StrictMapping) -> Template:
    parameters = _Parameters({}, {})
    ranges, drawn = parameters.ranges, parameters.drawn
    site_kind = SiteKind(top.text("site", list(SiteKind)))
    name = top.text("id")  # the id becomes part of file names, so it has to be a plain name
    if not _ID.fullmatch(name):
        raise InputError(top.where("id"), name, "letters, digits, - and _, at most 64")
    template = Template(
        template_id=name,
        title=top.text("title"),
        family=BehaviourFamily(top.text("family", list(BehaviourFamily))),
        level=EmergencyLevel[top.text("level", EmergencyLevel.__members__, level_name)],
        site_kind=site_kind,
        duration_s=parameters.number(top, "duration_s", 1.0, 3600.0),
        warm_up_s=top.number("warm_up_s", 0.0, 600.0),
        emv=_emv(top.mapping("emv"), parameters),
        demand=_demand(top.mapping("demand"), parameters),
        response=_response(top.mapping("response"), parameters),
        predicate=_predicate(top.mapping("predicate")),
        drivers=_drivers(top.mapping("drivers"), parameters) if top.has("drivers") else {},
        signal=_signal(top.mapping("signal"), parameters) if top.has("signal") else None,
        jam=_jam(top.mapping("jam"), parameters) if top.has("jam") else None,
        map_name=top.text("map", BUILT_IN_MAPS) if top.has("map") else "",
        shoulders_in_use=top.has("shoulders") and top.text("shoulders", ["free", "in_use"]) == "in_use",
        spaces=_spaces(top) if top.has("spaces") else (),
        ranges=ranges,
        drawn=drawn,
    )
    top.finish()
    if "duration_s" in drawn:
        raise InputError(top.mapping("duration_s").where("draw"), "a range", "no draw: seeds differ in what happens")
    if site_kind in {SiteKind.MULTI_LANE_ROAD, SiteKind.MOTORWAY_STRETCH}:
        _refuse_stop_line(top, template)
    most = sum(int(ranges[f"demand.{group.name}.vehicles"].maximum) for group in template.demand.groups)
    least = ranges["demand.background_vehicles"].minimum
    if most > least:
        where = top.mapping("demand").where("background_vehicles")
        raise InputError(where, f"{least:g} at least", f"no fewer than the {most} vehicles that the groups may have")
    return template


def _spaces(top: StrictMapping) -> tuple[str, ...]:
    words = top.words("spaces")
    if unknown := [word for word in words if word not in SPACES]:
        raise InputError(top.where("spaces"), unknown[0], ", ".join(SPACES))
    return words


def _refuse_stop_line(top: StrictMapping, template: Template) -> None:
    """Refuses starts and groups that refer to a stop line where the site is a road, which has no junction.

    Raises:
        InputError: the template has one of these.
    """
    junction_only = {Placement.SAME_DIRECTION, Placement.CROSSING, Placement.TURNING_LANES}
    groups = template.demand.groups
    wrong = [g.name for g in groups if g.anchor is not GroupAnchor.EMV or g.placement in junction_only]
    wrong += ["emv.start_from"] * (template.emv.start_from is StartReference.STOP_LINE)
    if wrong:
        allowed = "a site at a junction; start or groups refer to a stop line: " + ", ".join(wrong)
        raise InputError(top.where("site"), template.site_kind.value, allowed)


@dataclass(frozen=True)
class _Parameters:
    """Reads ``{default: …, range: […, …], draw: […, …]}`` and remembers the ranges.

    Where ``draw`` is missing every seed has the default.
    """

    ranges: dict[str, ValueRange]
    drawn: dict[str, ValueRange]

    def number(self, section: StrictMapping, key: str, low: float, high: float) -> float:
        """A real parameter; default and range lie within ``[low, high]``."""
        entry = section.mapping(key)
        limits = ValueRange(*_range(entry, "range", low, high))
        default = entry.number("default", limits.minimum, limits.maximum)
        self._remember(entry, limits)
        return default

    def integer(self, section: StrictMapping, key: str, low: int, high: int) -> int:
        """A whole-numbered parameter."""
        entry = section.mapping(key)
        minimum, maximum = _range(entry, "range", low, high)
        if minimum != round(minimum) or maximum != round(maximum):
            raise InputError(entry.where("range"), f"[{minimum:g}, {maximum:g}]", "whole numbers")
        default = entry.integer("default", round(minimum), round(maximum))
        self._remember(entry, ValueRange(minimum, maximum, integer=True))
        return default

    def _remember(self, entry: StrictMapping, limits: ValueRange) -> None:
        if entry.has("draw"):
            drawn = _range(entry, "draw", limits.minimum, limits.maximum)
            self.drawn[entry.path] = ValueRange(*drawn, limits.integer)
        entry.finish()
        self.ranges[entry.path] = limits


def _range(entry: StrictMapping, key: str, low: float, high: float) -> tuple[float, float]:
    minimum, maximum = entry.numbers(key, 2, low, high)
    if minimum > maximum:
        raise InputError(entry.where(key), f"[{minimum:g}, {maximum:g}]", "[minimum, maximum] in this order")
    return minimum, maximum


_Section = TypeVar("_Section")


def _finished(section: StrictMapping, value: _Section) -> _Section:
    """The value that was read from a section, after a check that the section has no further keys."""
    section.finish()
    return value


def _emv(section: StrictMapping, parameters: _Parameters) -> EmvDemand:
    emergency = [member.name.lower() for member in ActorClass if member.is_emergency]
    emv = EmvDemand(
        actor_class=ActorClass[section.text("class", emergency).upper()],
        count=parameters.integer(section, "count", 1, _MAX_EMVS)
        if section.is_mapping("count")  # older templates, also those in bags, state only the number of EMVs
        else section.integer("count", 1, _MAX_EMVS),
        start_m=parameters.number(section, "start_m", -500.0, 500.0),
        speed_mps=parameters.number(section, "speed_mps", 1.0, _MAX_SPEED_MPS),
        depart_speed_mps=parameters.number(section, "depart_speed_mps", 0.0, _MAX_SPEED_MPS),
        headway_s=parameters.number(section, "headway_s", 0.5, 60.0),
        start_from=StartReference(_option(section, "start_from", StartReference.SITE_START)),
        crossing=parameters.integer(section, "crossing", 0, 1) if section.has("crossing") else 0,
        crossing_after_s=parameters.number(section, "crossing_after_s", -_MAX_AFTER_S, _MAX_AFTER_S)
        if section.has("crossing_after_s")
        else 0.0,
    )
    return _finished(section, emv)


def _option(section: StrictMapping, key: str, default: StartReference | GroupAnchor) -> str:
    """One of the texts of an enumeration; the default where the key is missing."""
    return section.text(key, list(type(default))) if section.has(key) else default.value


def _signal(section: StrictMapping, parameters: _Parameters) -> SignalDemand:
    red_s = parameters.number(section, "red_before_arrival_s", -_MAX_RED_S, _MAX_RED_S)
    return _finished(section, SignalDemand(red_s))


def _jam(section: StrictMapping, parameters: _Parameters) -> JamDemand:
    jam = JamDemand(
        moves=parameters.integer(section, "moves", 0, 1),
        roll_s=parameters.number(section, "roll_s", 0.0, 600.0),
        roll_mps=parameters.number(section, "roll_mps", 0.0, _MAX_SPEED_MPS),
        stand_s=parameters.number(section, "stand_s", 0.1, 600.0),
    )
    return _finished(section, jam)


def _demand(section: StrictMapping, parameters: _Parameters) -> Demand:
    groups = section.mapping("groups")
    demand = Demand(
        background_vehicles=parameters.integer(section, "background_vehicles", 0, _MAX_VEHICLES),
        speed_limit_mps=parameters.number(section, "speed_limit_mps", 3.0, _MAX_SPEED_MPS),
        speed_factor=parameters.number(section, "speed_factor", 0.1, 2.0),
        classes=_classes(section.mapping("classes")),
        groups=tuple(_group(groups.mapping(name), name, parameters) for name in groups.values),
        district_per_lane_km=parameters.number(section, _DISTRICT, 0.0, _MAX_PER_LANE_KM)
        if section.has(_DISTRICT)
        else 0.0,
        people=_people(section, parameters),
        variety=_variety(section, parameters),
    )
    return _finished(section, demand)


def _people(demand: StrictMapping, parameters: _Parameters) -> PeopleDemand:
    """Reads the section ``people``. Every template has its parameters, with 0 where the file does not state them."""
    section = demand.mapping(_PEOPLE) if demand.has(_PEOPLE) else None
    values = {}
    for name in (field.name for field in fields(PeopleDemand)):
        if section is not None and section.has(name):
            values[name] = parameters.integer(section, name, 0, _MAX_VEHICLES)
        else:
            values[name] = 0
            parameters.ranges[f"demand.{_PEOPLE}.{name}"] = ValueRange(0, _MAX_VEHICLES, integer=True)
    if section is not None:
        section.finish()
    return PeopleDemand(**values)


_MOST_VARIETY: Final = {"size_spread": 0.15, "parked_share": 1.0, "clutter_per_100_m": 50.0, "colour_share": 1.0}


def _variety(demand: StrictMapping, parameters: _Parameters) -> VarietyDemand:
    """Reads the section ``variety``. Every template has its parameters, with 0 where the file does not state them."""
    section = demand.mapping(_VARIETY) if demand.has(_VARIETY) else None
    values = dict.fromkeys(_MOST_VARIETY, 0.0)
    for name, most in _MOST_VARIETY.items():
        if section is not None and section.has(name):
            values[name] = parameters.number(section, name, 0.0, most)
        else:
            parameters.ranges[f"demand.{_VARIETY}.{name}"] = ValueRange(0.0, most)
    if section is not None:
        section.finish()
    return VarietyDemand(**values)


def _group(section: StrictMapping, name: str, parameters: _Parameters) -> DemandGroup:
    if name in {_PEOPLE, _VARIETY}:
        raise InputError(section.where("placement"), name, f"another name for a group: {name} is no group")
    section.path = f"demand.{name}"
    placement = Placement(section.text("placement", list(Placement)))
    crossing = placement is Placement.CROSSING
    anchor = GroupAnchor(_option(section, "from", GroupAnchor.STOP_LINE if crossing else GroupAnchor.EMV))
    if crossing and anchor is not GroupAnchor.STOP_LINE:
        raise InputError(section.where("from"), anchor.value, "stop_line for a crossing group")
    optional = section.flag("optional", default=False)
    if optional and placement is Placement.EMV_LANE:
        raise InputError(section.where("optional"), True, "false for emv_lane, a lane that there always is")
    group = DemandGroup(
        name=name,
        placement=placement,
        vehicles=parameters.integer(section, "vehicles", 0, 100),
        first_gap_m=parameters.number(section, "first_gap_m", 0.0, 500.0),
        spacing_m=parameters.number(section, "spacing_m", 1.0, 200.0),
        speed_mps=parameters.number(section, "speed_mps", 1.0, _MAX_SPEED_MPS),
        anchor=anchor,
        standing=section.flag("standing", default=False),
        optional=optional,
    )
    return _finished(section, group)


def _classes(section: StrictMapping) -> tuple[tuple[ActorClass, float], ...]:
    others = EMERGENCY_CLASSES | PEOPLE_CLASSES
    civilian = [(member, member.name.lower()) for member in ActorClass if member not in others]
    shares = tuple((member, section.number(name, 0.0, 1.0)) for member, name in civilian if section.has(name))
    section.finish()
    total = sum(share for _, share in shares)
    if abs(total - 1.0) > _SHARE_TOLERANCE:
        where = f"{section.file}:{section.node.start_mark.line + 1}: {section.path}"
        raise InputError(where, round(total, 6), "shares of vehicle classes that add up to 1")
    return shares


def _response(section: StrictMapping, parameters: _Parameters) -> CivilianResponseDemand:
    response = CivilianResponseDemand(
        response_distance_m=parameters.number(section, "response_distance_m", 1.0, 300.0),
        extra_delay_s=parameters.number(section, "extra_delay_s", 0.0, 30.0),
        compliance=parameters.number(section, "compliance", 0.0, 1.0),
        duty=parameters.integer(section, "duty", 0, 1) if section.has("duty") else 0,
    )
    return _finished(section, response)


def _drivers(section: StrictMapping, parameters: _Parameters) -> dict[str, float]:
    """Parameters of drivers by their dotted names."""
    section.path, names = "", DRIVER_PARAMETERS
    values = {}
    for name in section.values:
        if name not in names:
            raise InputError(section.where(name), name, f"parameters of drivers: {', '.join(names)}")
        values[name] = parameters.number(section, name, names[name].minimum, names[name].maximum)
    return values


def _predicate(section: StrictMapping) -> PredicateDemand:
    name = section.text("name", DECLARED_PREDICATES)
    limits = DECLARED_PREDICATES[name].thresholds
    thresholds = {key: section.number(key, low, high) for key, (low, high) in limits.items()}
    if section.has(STANDS_MAX):
        thresholds[STANDS_MAX] = section.number(STANDS_MAX, 0.0, 600.0)
    return _finished(section, PredicateDemand(name, thresholds))
