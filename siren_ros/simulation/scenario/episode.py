"""What a user asks for, what identifies an episode, how it ended, and what it is for.

The fields of a request are declared here and nowhere else. A split follows from the episode alone, so that it stays
when a study grows. Every part that splits episodes asks this module: exports, trainings, and evaluations, which say
what a model has seen.
"""

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, Final

from siren_ros.base.numerics.arrays import Brief
from siren_ros.base.params import parameters
from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFiles, RecordedFiles, files_from_json, parameter
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.paper import EmergencyLevel, level_name
from siren_ros.simulation.world.actors import NO_ACTOR

DEFAULT_LOOK: Final = "clear"
_LEVELS: Final = ("", *EmergencyLevel.__members__)
_AV_KINDS: Final = ("", "civilian")
MAX_SEED: Final = 2**31 - 1
SHIPPED_DETECTOR: Final = "pillars"
"""Name of the shipped detector, in a request and in the parameters of the node ``detector``."""
_LEFT_OUT: Final = frozenset({"site", "values", "demand", "demand_begin_s", "predictor", "detector"})
"""Fields that a record leaves out where they are empty, so that records without such a choice keep their bytes."""


@dataclass(frozen=True)
class EpisodeRequest:
    """The choices that define an episode. The nodes that take a request inherit these fields as parameters."""

    template: str = parameter("S2", "Interaction template: an id such as S2 or the path of a template file.")
    level: str = parameter(
        "", "Emergency level, also 2 or l2 for L2; empty: the template's own.", choices=_LEVELS, read=level_name
    )
    seed: int = parameter(0, "Seed of everything random in the episode.", minimum=0, maximum=MAX_SEED)
    map: str = parameter(
        "",
        "Path of a SUMO net, OpenDRIVE or OpenStreetMap file, or town, city or motorway, which are built in; empty: "
        "the template's own, the town for S1 to S7.",
    )
    site: str = parameter(
        "", "Where on the map it happens: a name that siren sites prints; empty: the seed draws one of the good sites."
    )
    demand: str = parameter(
        "", "Own background traffic: path of a SUMO route file or .sumocfg; empty: the template's own."
    )
    demand_begin_s: float = parameter(
        0.0,
        "SUMO's time at which the warm-up with it begins; 0: that of the .sumocfg, else the first departure.",
        minimum=0.0,
        maximum=1e7,
    )
    duration_s: float = parameter(0.0, "Simulated duration; 0: the template's own.", minimum=0.0, maximum=3600.0)
    preset: str = parameter("paper", "How civilians react: a name in params/presets or the path of a preset file.")
    sensors: str = parameter("front", "Sensor suite: a name in params/suites or the path of a suite file.")
    look: str = parameter(DEFAULT_LOOK, "Weather and time of day: a name in params/looks or the path of a look file.")
    av: str = parameter(
        "",
        "Who an external controller drives: the civilian that the EMV has to pass; empty: nobody.",
        choices=_AV_KINDS,
    )
    av_sensors: str = parameter("none", "Sensor suite of that vehicle: as for sensors; its topics begin with /av.")
    values: str = parameter(
        "",
        "Values of parameters of the template, in place of the seed's own, and of drivers: "
        "emv.speed_mps=12.5,duration_s=60.",
    )
    predictor: str = parameter(
        "", "Program that takes part and says at every frame on /predictions where vehicles will be; empty: none."
    )
    detector: str = parameter(
        "",
        "Detector of vehicles in the sweeps of the running episode, on /emv/detections: pillars, or the path of an "
        "ONNX file; empty: none.",
    )
    salt: str = parameter("", "File with a secret of 128 bits or more that seals the episode; empty: not sealed.")

    def __post_init__(self) -> None:
        object.__setattr__(self, "level", level_name(self.level))

    @staticmethod
    def within(config: "EpisodeRequest") -> "EpisodeRequest":
        """The plain request that a configuration with further fields contains."""
        return EpisodeRequest(**{field.name: getattr(config, field.name) for field in fields(EpisodeRequest)})

    def to_json(self) -> dict[str, Any]:
        """The request as JSON types, for the record. Empty values and programs are left out, and the secret's file."""
        values = asdict(self)
        del values["salt"]
        return {name: value for name, value in values.items() if name not in _LEFT_OUT or value}


def values_of(text: str) -> dict[str, float]:
    """The values in the text of a request's field ``values``, by the dotted path of the parameter.

    Raises:
        InputError: Not ``path=number`` by commas, or a path twice.
    """
    values: dict[str, float] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        path, _, number = part.partition("=")
        try:
            value = float(number)
        except ValueError as error:
            raise InputError("values", part, "PATH=NUMBER, several by commas: emv.speed_mps=12.5") from error
        if path.strip() in values:
            raise InputError("values", part, "each parameter once")
        values[path.strip()] = value
    return values


def text_of_values(values: Mapping[str, float]) -> str:
    """Inverse of ``values_of``, to the last bit; sorted, so that the same values are the same text."""
    return ",".join(f"{path}={float(value)!r}" for path, value in sorted(values.items()))


FILES_PARAMETER: Final = "files"
"""Key of ``EpisodeDescription.parameters`` with the text and the hash of every parameter file."""
CROSSING_PARAMETER: Final = "crossing"
"""Key of the EMVs from a side street and of the junction where they cross. It is missing where there are none."""
DEMAND_PARAMETER: Final = "demand"
"""Key of the user's own traffic (``OwnDemand``). It is missing where the template's is used."""
MAP_SOURCE_PARAMETER: Final = "map_source_sha256"
"""Key of the hash of the map file before it was compiled, unpacked where it was packed."""


class KittiLayout(StrEnum):
    """The layouts of the KITTI export that nodes write while the episode runs."""

    KITTI = "kitti"
    """The layout of the object benchmark."""
    PAPER = "paper"


class EpisodeEnd(StrEnum):
    """Why an episode ended."""

    COMPLETE = "complete"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True)
class EpisodeDescription(Brief):
    """Everything that is needed to make the same episode again."""

    template: str
    level: EmergencyLevel
    seed: int
    map_name: str
    map_sha256: str
    """SHA-256 of the compiled SUMO net."""
    duration_s: float
    sensor_suite: str
    preset: str
    emv_ids: tuple[int, ...]
    parameters: Mapping[str, object] = field(default_factory=dict)
    """The request, the template's values, the predicate and the parameter files; JSON types only."""
    versions: Mapping[str, str] = field(default_factory=dict)
    site: Mapping[str, object] = field(default_factory=dict)
    """The place where it happens: kind, name, junction, route edges, stretch."""

    def facts(self) -> dict[str, object]:
        """The description without its parameter files and versions."""
        names = ("template", "level", "seed", "map_name", "duration_s", "sensor_suite", "preset", "emv_ids")
        return {**{name: getattr(self, name) for name in names}, "site": self.site.get("name", "")}

    @property
    def files(self) -> InputFiles:
        """The recorded parameter files; those on disk for a description without any.

        Raises:
            BagError: The recorded files are damaged.
        """
        stored = self.parameters.get(FILES_PARAMETER)
        return FILES_ON_DISK if stored is None else RecordedFiles(files_from_json(stored))

    @property
    def av_id(self) -> int:
        """Id of the civilian that an external controller drives; NO_ACTOR in episodes without one."""
        av = self.parameters.get("av")
        return int(av["actor_id"]) if isinstance(av, Mapping) else NO_ACTOR

    @property
    def crossed_junctions(self) -> Mapping[int, str]:
        """For each EMV from a side street, by its id: the junction where it crosses the way of the others."""
        crossing = self.parameters.get(CROSSING_PARAMETER)
        if not isinstance(crossing, Mapping):
            return {}
        return {int(emv_id): str(crossing["junction"]) for emv_id in crossing["emv_ids"]}

    @property
    def asked(self) -> Mapping[str, object]:
        """The request from which the episode was made; empty where the description does not have it."""
        request = self.parameters.get("request")
        return request if isinstance(request, Mapping) else {}

    @property
    def predictor(self) -> str:
        """The program whose predictions are recorded; empty in episodes without one."""
        return str(self.asked.get("predictor", ""))

    @property
    def detector(self) -> str:
        """The detector whose boxes are recorded; empty in episodes without one."""
        return str(self.asked.get("detector", ""))

    @property
    def draw(self) -> str:
        """The values that the request gave to parameters of the template in place of the seed's; empty without any."""
        return str(self.asked.get("values", ""))

    @property
    def pinned(self) -> str:
        """The pinned site and the given values as text for people; empty where the seed draws all."""
        return " ".join(filter(None, (str(self.asked.get("site", "")), self.draw)))

    @property
    def template_values(self) -> Mapping[str, float]:
        """Values of the template's parameters by path. Values that are not numbers are left out."""
        values = self.parameters.get("template")
        items = values.items() if isinstance(values, Mapping) else ()
        return {str(name): float(value) for name, value in items if type(value) in (int, float)}

    @property
    def av_sensor_suite(self) -> str:
        """Sensor suite of the AV under test; empty in episodes without one."""
        av = self.parameters.get("av")
        return str(av["sensors"]) if isinstance(av, Mapping) else ""


@dataclass(frozen=True)
class EpisodeOutcome(Brief):
    """How an episode ended, as stored at the end of its bag."""

    end: EpisodeEnd
    reason: str
    steps: int
    predicate_holds: bool | None
    """Whether the interaction happened; None where the predicate could not be evaluated."""
    measures: Mapping[str, float | int | str] = field(default_factory=dict)
    """Numbers of the interaction: predicate parts, collisions, residual percentiles, travel time."""

    @property
    def shortcomings(self) -> tuple[str, ...]:
        """What a finished episode lacks, in words; empty where its interaction happened without a collision."""
        far = ("no vehicle of the own demand came near an EMV",) * (self.measures.get("demand.near_emv") == 0)
        return (*shortcomings(self.predicate_holds, int(self.measures.get("collisions", 0))), *far)


def shortcomings(predicate_holds: bool | None, collisions: int) -> tuple[str, ...]:
    """The texts of ``EpisodeOutcome.shortcomings``, for a verdict and a number of collisions."""
    happened = {
        True: "",
        False: "the interaction did not happen",
        None: "whether the interaction happened could not be judged",
    }[predicate_holds]
    collided = f"{collisions} collision{'s' if collisions > 1 else ''}" if collisions else ""
    return tuple(filter(None, (happened, collided)))


_FILE: Final = "splits.yaml"
_PERCENT: Final = 100
_TOWN: Final = "town"


class Split(StrEnum):
    """What an episode is used for, or how it relates to the training data of a model."""

    TRAIN = "train"
    VAL = "val"
    """Episodes that were looked at during training and decided nothing."""
    TEST_SEED = "test-seed"
    """Episodes with the maps and templates of the training, but other seeds or parameters."""
    TEST_MAP = "test-map"
    """Episodes on maps that the training does not use."""
    TEST_TEMPLATE = "test-template"
    """Episodes of templates that the training does not use."""


@dataclass(frozen=True, order=True)
class EpisodeIdentity:
    """What decides an episode's split. The level does not: episodes of one seed begin alike at all levels."""

    map_name: str
    template: str
    seed: int
    values: str = ""
    """Values of parameters in place of those that the seed draws, as a request has them."""
    map_sha256: str = field(default="", compare=False)
    """SHA-256 of the compiled map, which a file's name cannot hide; empty where it is not known."""

    @staticmethod
    def of(episode: EpisodeDescription) -> "EpisodeIdentity":
        """The identity of a recorded episode."""
        return EpisodeIdentity(episode.map_name, episode.template, episode.seed, episode.draw, episode.map_sha256)

    @staticmethod
    def of_request(request: EpisodeRequest, template: str = "") -> "EpisodeIdentity":
        """The identity of a requested episode; ``template`` is the id of a template that the request names by a file.

        An empty map is the town.
        """
        map_name = Path(request.map).name.split(".")[0] if request.map else _TOWN
        return EpisodeIdentity(map_name, template or request.template, request.seed, request.values)

    @property
    def text(self) -> str:
        """The identity in one line, with sorted parameters: ``town S2 103``, ``town S2 103 emv.speed_mps=12.5``."""
        return f"{self.map_name} {self.template} {self.seed} {text_of_values(values_of(self.values))}".rstrip()

    @property
    def content(self) -> str:
        """The same with the map's hash in place of its name; empty where it is not known."""
        return replace(self, map_name=self.map_sha256).text if self.map_sha256 else ""


@dataclass(frozen=True)
class SplitRule:
    """The content of ``params/splits.yaml``."""

    test_maps: frozenset[str]
    test_templates: frozenset[str]
    val_percent: int
    test_seed_percent: int

    def split_of(self, episode: EpisodeIdentity) -> Split:
        """The split of an episode, by its own map, template, seed and parameters alone."""
        if episode.template in self.test_templates:
            return Split.TEST_TEMPLATE
        if episode.map_name in self.test_maps:
            return Split.TEST_MAP
        place = int.from_bytes(hashlib.sha256(episode.text.encode()).digest()[:8], "big") % _PERCENT
        if place < self.val_percent:
            return Split.VAL
        return Split.TEST_SEED if place < self.val_percent + self.test_seed_percent else Split.TRAIN


@cache
def split_rule() -> SplitRule:
    """The project's own rule, read from ``params/splits.yaml``."""
    content = parameters.load_yaml(parameters.read_yaml_text(params_dir() / _FILE))
    return SplitRule(
        frozenset(content["test_maps"]),
        frozenset(content["test_templates"]),
        int(content["val_percent"]),
        int(content["test_seed_percent"]),
    )


def split_of(episode: EpisodeIdentity) -> Split:
    """The split of an episode by the rule of the project."""
    return split_rule().split_of(episode)


@dataclass(frozen=True)
class SeenEpisodes:
    """The episodes that a model has seen, as its card lists them."""

    trained: frozenset[str]
    """``EpisodeIdentity.text`` of the episodes of the training, and ``content`` where the card has it."""
    watched: frozenset[str] = frozenset()
    """``EpisodeIdentity.text`` of the episodes that were looked at during its training."""

    @staticmethod
    def of_card(card: Mapping[str, Any]) -> "SeenEpisodes | None":
        """What the card of a trained network lists under ``data``; None where it lists no episodes."""
        data = card.get("data", {})
        trained, watched = (data.get(split, {}).get("keys") for split in (Split.TRAIN, Split.VAL))
        contents = data.get(Split.TRAIN, {}).get("contents", ())
        return None if trained is None else SeenEpisodes(frozenset((*trained, *contents)), frozenset(watched or ()))

    @property
    def maps(self) -> frozenset[str]:
        """Names of the maps that it was trained on, and their hashes where the card has them."""
        return frozenset(_words(self.trained, 0))

    def split_of(self, episode: EpisodeIdentity) -> Split:
        """How an episode relates to the model: the split that the episode would have by this model's training.

        Where the card has hashes of maps, these decide and not the names of files.
        """
        maps = self.maps
        hashed = bool(episode.map_sha256) and any(len(name) == _SHA256_DIGITS for name in maps)
        if (episode.content if hashed else episode.text) in self.trained:
            return Split.TRAIN
        if episode.text in self.watched:
            return Split.VAL
        if episode.template not in _words(self.trained, 1):
            return Split.TEST_TEMPLATE
        return Split.TEST_SEED if (episode.map_sha256 if hashed else episode.map_name) in maps else Split.TEST_MAP


_SHA256_DIGITS: Final = 64


def _words(texts: Collection[str], place: int) -> set[str]:
    return {text.split()[place] for text in texts}


def counted_standings(standings: Collection[Split]) -> dict[Split, int]:
    """Number of scored episodes by their relation to the model, with every split named.

    Empty where no relation is known.
    """
    return {split: list(standings).count(split) for split in Split} if standings else {}


def overlap_warning(model: str, counts: Mapping[Split, int]) -> str:
    """A warning line where scored episodes (``counted_standings``) belong to the model's own training.

    Otherwise empty.
    """
    inside, total = counts.get(Split.TRAIN, 0), sum(counts.values())
    return f"WARNING: {model} was trained on {inside} of these {total} episodes: its scores say too much" * bool(inside)
