"""``siren generate`` and ``siren sites``: many episodes from one description, and the places where they can happen.

A study has one table of what became of its episodes. Other commands that make studies take options of its matrix, too.
"""

import argparse
import shlex
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from tqdm import tqdm

from siren_ros.base.params.folders import named_params_file
from siren_ros.base.tables import Row, Table
from siren_ros.cli.command import Command, complain
from siren_ros.cli.options import add_processes, check_numbers
from siren_ros.errors import EXIT_FAILED, EXIT_OK, InputError, MapError, whole_file, writing
from siren_ros.running.generation.episode_setup import plan_length
from siren_ros.running.generation.site_choice import count_lacks, has_shoulder, proposed, shortcomings
from siren_ros.running.generation.template_map import map_of_template
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import (
    MOST_SAMPLES,
    TOWN,
    DrawPlan,
    Method,
    Study,
    grid_of,
    levels_of,
    ranges_of,
    read_study,
    seeds_of,
)
from siren_ros.running.studies.run_study import (
    RETRIES,
    TIMEOUT_S,
    DaskWorkers,
    LocalWorkers,
    StudyBar,
    WorkerOptions,
    Workers,
    connected,
    on_slurm,
    run_study,
)
from siren_ros.running.studies.study_folder import MANIFEST, LocalFolder, StudyFolder, folder_at
from siren_ros.simulation.roads.maps.amended_map import ADDITIONS, additions_of, amended_map
from siren_ros.simulation.roads.maps.map_compiler import BUILT_IN_MAPS, CompiledMap, compile_map
from siren_ros.simulation.roads.maps.map_source import maps_in
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork, right_hand_image
from siren_ros.simulation.roads.sites import Lack, Site
from siren_ros.simulation.scenario.episode import MAX_SEED, EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.scenario.scenario import Template
from siren_ros.simulation.scenario.templates import available_templates, load_template

BUILT_IN: Final = "{}, {} or {}".format(*BUILT_IN_MAPS)
"""Names of the built-in maps, as a text for help."""
MATRIX: Final[Mapping[str, Callable[[Any], Any]]] = {
    "templates": tuple,
    "levels": levels_of,
    "seeds": seeds_of,
    "maps": tuple,
    "sites": tuple,
    "preset": str,
    "sensors": str,
    "look": str,
    "duration_s": float,
    "demand": str,
    "values": str,
    "salt": str,
}
"""Options of the matrix, by the study's fields that they stand for, and how their words are read."""


def add_matrix(matrix: "argparse._ArgumentGroup", templates: str, levels: str, seeds: str) -> None:
    """Adds the options of the matrix. The texts name the values that hold without an option."""
    matrix.add_argument(
        "--templates", nargs="+", metavar="ID", help=f"S1 to S8, or template files (default: {templates})"
    )
    matrix.add_argument("--levels", nargs="+", metavar="L", help=f"L0 to L3, or 0 to 3, or own (default {levels})")
    matrix.add_argument("--seeds", nargs="+", metavar="N|A:B", help=f"seeds; 0:5 are 0 to 4 (default {seeds})")
    matrix.add_argument("--maps", nargs="+", metavar="FILE", help=f"map files, or {BUILT_IN} (default {TOWN})")
    matrix.add_argument("--sites", nargs="+", metavar="NAME", help="names that siren sites prints, or drawn (default)")
    matrix.add_argument("--preset", help="how civilians react (default paper)")
    matrix.add_argument("--sensors", help="suite of sensors (default none)")
    matrix.add_argument("--look", help="weather and time of day (default clear)")
    matrix.add_argument(
        "--duration-s", type=float, metavar="S", help="simulated time of each episode (default: its own)"
    )
    matrix.add_argument("--demand", metavar="FILE", help="own background traffic: a SUMO route file or .sumocfg")
    matrix.add_argument(
        "--values",
        metavar="PATH=N,…",
        help="values of the templates' parameters, which the seeds then do not draw: emv.speed_mps=12.5,duration_s=60",
    )
    matrix.add_argument("--salt", metavar="FILE", help="secret of 16 bytes or more in hexadecimal: seals the episodes")


def asked_of(arguments: argparse.Namespace, matrix: Mapping[str, Callable[[Any], Any]] = MATRIX) -> dict[str, Any]:
    """The fields of the study that the command line sets."""
    words = {name: getattr(arguments, name) for name in matrix}
    return {name: matrix[name](word) for name, word in words.items() if word is not None}


_SITES_HEAD = ("template", "site", "good", "street", "junction", "control", "length m", "lanes", "shoulder", "lacks")


def add_sites(verb: Command) -> None:
    """Adds the description and the options of the command."""
    verb.description = (
        "Lists the sites of a map for each template, the best first. A seed draws one of the good ones; a name "
        "pins the site: -p site:=NAME, or siren generate --sites NAME. The last column says what the others lack. For "
        "several maps, it counts their sites, and the places that lack something. Where a map has no good site for a "
        "template, a command is proposed that adds what it lacks; on a city, for templates that are named."
    )
    verb.add_argument(
        "maps", nargs="*", metavar="MAP", help=f"map file, folder with map files, or {BUILT_IN} (default: town)"
    )
    verb.add_argument("--templates", nargs="+", metavar="ID", help="S1 to S8, or template files (default: all)")
    verb.add_argument("--all", action="store_true", help="also sites that lack something, which no seed draws")
    verb.add_argument(
        "--out", type=Path, metavar="FILE.png", help="also draw the map with its sites, and what places lack"
    )
    where = "; ".join(f"{kind}: {name}" for kind, name in ADDITIONS.items())
    verb.add_argument("--mend", type=Path, metavar="OUT.net.xml", help="write a SUMO net with what --add says; list it")
    verb.add_argument("--add", nargs="+", default=[], metavar="KIND:NAME", help=f"what --mend adds, and where: {where}")
    verb.set_defaults(run=list_sites)


def list_sites(arguments: argparse.Namespace) -> int:
    """Prints the tables; a template without a line has no site on the map."""
    templates = [load_template(name) for name in arguments.templates or available_templates()]
    named = [Path(name) for name in arguments.maps]
    files = [file for path in named for file in (maps_in(path) if path.is_dir() else (path,))]
    if len(files) > 1 or any(path.is_dir() for path in named):
        if option := next((name for name in ("out", "mend") if getattr(arguments, name) is not None), ""):
            raise InputError(option, str(getattr(arguments, option)), "one map; several have a table alone")
        print("\n".join("\n".join((*table.text(), "")) for table in _survey(files, templates)))
        return EXIT_OK
    file = files[0] if files else None
    if arguments.mend is not None or arguments.add:
        file = _mended(file, arguments.mend, arguments.add)
    compiled = compile_map(file)
    net = compiled.read_bytes()
    if added := additions_of(net):
        print("added to the map:", *added)
    networks = [_network_of(template, compiled, file) for template in templates]
    found = [(on, shortcomings(right_hand_image(network), on)) for on, network in zip(templates, networks, strict=True)]
    surveys = zip(networks, found, strict=True)
    rows = tuple(row for network, survey in surveys for row in _site_rows(network, *survey, lacking=arguments.all))
    print(*Table("sites", "", _SITES_HEAD, rows, specs={"length m": ".0f"}).text(), sep="\n")
    if arguments.out is not None:
        from siren_ros.scoring.pictures.birdseye import save_site_map  # noqa: PLC0415 - matplotlib takes as long as the table

        print(save_site_map(networks, found, arguments.out))
    soon = arguments.templates or len(net) <= _SOON_BYTES
    rows = tuple(_proposal_row(net, file, template) for template, sites in found if soon and all(sites.values()))
    if rows := tuple(filter(None, rows)):
        print("", *Table("proposals", "", _PROPOSALS_HEAD, rows).text(), sep="\n")
    return EXIT_OK


_SOON_BYTES: Final = 5_000_000
"""Size of a net up to which additions are tried for all templates: some seconds for each; a city of 3 km² is larger."""
_PROPOSALS_HEAD: Final = ("template", "site", "lacks", "what adds it")


def _proposal_row(net: bytes, file: Path | None, template: Template) -> Row:
    shown = str(file or TOWN)
    name, lacks, additions = proposed(net, template, shown)
    words = ("siren", "sites", shown, "--templates", template.template_id, "--mend", "OUT.net.xml", "--add", *additions)
    return (template.template_id, name, lacks, shlex.join(words)) if additions else ()


def _mended(file: Path | None, out: Path | None, additions: Sequence[str]) -> Path:
    """Writes a map with additions, and returns its file."""
    if out is None or not additions:
        raise InputError("mend", str(out), "a file to write together with --add, what to add")
    net = amended_map(compile_map(file).read_bytes(), additions, str(file or TOWN))
    with writing(out, parameter="mend"), whole_file(out) as new:
        new.write_bytes(net)
    return out


def _network_of(template: Template, compiled: CompiledMap, source: Path | None) -> RoadNetwork:
    """The roads of a map as a template uses them."""
    return parse_road_network(map_of_template(template, compiled, source).read_bytes())


def _survey(files: Sequence[Path], templates: Sequence[Template]) -> Iterator[Table]:
    """Good sites of each map and template, and what the other places lack.

    A map that cannot be used has its reason in the last column.
    """
    names = [template.template_id for template in templates]
    rows, good = list[Row](), {name: set[Path]() for name in names}
    lacks = list[tuple[str, str, Path, int, int]]()
    for file in tqdm(files, unit="map", desc="sites", disable=None):
        cells = []
        try:
            compiled = compile_map(file)
            networks = [right_hand_image(_network_of(template, compiled, file)) for template in templates]
        except MapError as error:
            rows.append((file.name, *("" for _ in names), error.allowed))
            continue
        for template, network in zip(templates, networks, strict=True):
            sites = shortcomings(network, template)
            places, alone = count_lacks(network, template, sites)
            number = sum(not lacking for lacking in sites.values())
            cells.append(f"{number}/{len(sites)}")
            good[template.template_id] |= {file} if number else set()
            lacks += [(template.template_id, text, file, places[text], alone[text]) for text in places]
        rows.append((file.name, *cells, ""))
    has = Counter(file for maps in good.values() for file in maps)
    yield Table("maps", "Good sites of all sites", ("map", *names, "refused"), tuple(rows))
    counts = (
        *(len(good[name]) for name in names),
        len(has),
        sum(count >= _SEVERAL for count in has.values()),
        len(files),
    )
    yield Table("maps with a good site", "Maps with a good site", (*names, "any", "three or more", "maps"), (counts,))
    yield Table("lacks", "What places lack", _LACKS_HEAD, tuple(_lack_rows(lacks, good)))


def _lack_rows(lacks: Sequence[tuple[str, str, Path, int, int]], good: Mapping[str, Collection[Path]]) -> list[Row]:
    """Counts for each template and reason; first those that alone stand between most maps and a good site."""
    weighed = []
    for (name, text), found in groupby(sorted(lacks, key=lambda lack: lack[:2]), key=lambda lack: lack[:2]):
        counts = [(file not in good[name], places, alone) for *_, file, places, alone in found]
        without = sum(lacks_all for lacks_all, _, _ in counts)
        won = sum(lacks_all and alone > 0 for lacks_all, _, alone in counts)
        places, alone = (sum(count[column] for count in counts) for column in (1, 2))
        weighed.append((name, (-won, -without, -len(counts), -alone, -places), text))
    return [(name, text, *(-weight for weight in weights)) for name, weights, text in sorted(weighed)]


_LACKS_HEAD: Final = ("template", "lacks", "maps won", "maps without", "maps", "alone", "places")
"""``maps without`` have no good site for the template; ``maps won`` are those of them that would get one, because a
site lacks this ``alone``."""
_SEVERAL: Final = 3


def _site_rows(
    network: RoadNetwork, template: Template, found: Mapping[Site, Sequence[Lack]], *, lacking: bool
) -> Iterator[Row]:
    # Where no site is good, episodes take the best of these sites.
    for site, missing in found.items():
        if lacking or not missing or all(found.values()):
            yield _site_row(network, template, site, missing)


def _site_row(network: RoadNetwork, template: Template, site: Site, missing: Sequence[Lack]) -> Row:
    street = network.edges[site.site_edge].name
    lanes = str(len(site.connections)) if site.connections else ""
    shoulder = "yes" if has_shoulder(network, site) else "no"
    place = street, site.junction or "", site.control or ""
    good, lacks = "no" if missing else "yes", "; ".join(map(str, missing))
    return template.template_id, site.name, good, *place, site.length_m, lanes, shoulder, lacks


RISK_VIDEOS = "risk_videos"
"""Name of the folder with risk videos inside the study's folder."""
_MOST_NAMED: Final = 20
"""Most episodes that standard error names."""
_LIMITS: Final = {
    "workers": (1, 10_000),
    "retries": (0, 1000),
    "timeout_s": (1.0, 1e6),
    "risk_videos": (0, MOST_SAMPLES),
    "random": (1, MOST_SAMPLES),
    "lhs": (1, MOST_SAMPLES),
    "draw_seed": (0, MAX_SEED),
}

_MATRIX: Final[Mapping[str, Callable[[Any], Any]]] = {**MATRIX, "risk_videos": int}


def add_arguments(verb: Command) -> None:
    """Adds the description and the options of the command."""
    verb.add_variant("risk", "generate_risk.add_arguments")
    verb.epilog = (
        "`siren generate risk` makes a set of front-camera videos with risk labels; see `siren generate risk --help`."
    )
    verb.description = (
        "Makes all episodes of a study: templates x levels x seeds x maps x sites x draws of parameters. Each episode "
        "has its own process. The same command continues a study: it keeps finished episodes whose hashes are correct, "
        "and makes the others. DIR/manifest.parquet is the table of all episodes. Options of the matrix and of the "
        "draws override the study file. The exit code is 1 if an episode is missing; with --strict also if an "
        "interaction did not happen or vehicles collided."
    )
    verb.add_argument(
        "study", nargs="?", metavar="STUDY", help="study file (YAML), or a name in params/studies such as v1"
    )
    verb.add_argument("--out", required=True, metavar="DIR", help="folder or fsspec URL, new or of the same study")
    matrix = verb.add_argument_group("the matrix")
    add_matrix(matrix, "S1 to S7", "own", "0")
    matrix.add_argument(
        "--risk-videos", type=int, metavar="N", help=f"also make N risk videos of each template, in DIR/{RISK_VIDEOS}"
    )
    draws = verb.add_argument_group("draws of the templates' parameters")
    draws.add_argument("--grid", nargs="+", metavar="PATH=V,V", help="every combination of these values")
    draws.add_argument("--random", type=int, metavar="N", help="N random draws")
    draws.add_argument("--lhs", type=int, metavar="N", help="N draws as a Latin hypercube")
    draws.add_argument(
        "--range",
        nargs="+",
        metavar="PATH=A:B",
        default=[],
        help="ranges to draw from (default: those of the templates)",
    )
    draws.add_argument("--draw-seed", type=int, default=0, metavar="N", help="seed of the draws (default 0)")
    work = verb.add_argument_group("the work")
    add_processes(work)
    work.add_argument("--scheduler", metavar="ADDRESS", help="Dask cluster that does the work: tcp://HOST:8786")
    work.add_argument("--slurm", action="store_true", help="start --workers Slurm jobs through Dask")
    work.add_argument(
        "--retries", type=int, default=RETRIES, metavar="N", help="tries after a crash (default %(default)s)"
    )
    work.add_argument(
        "--timeout-s",
        type=float,
        default=TIMEOUT_S,
        metavar="S",
        help="longest wall time of one episode's process (default %(default)g)",
    )
    work.add_argument(
        "--strict", action="store_true", help="exit code 1 also if an interaction did not happen or vehicles collided"
    )
    verb.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Runs the study; exit code 1 where an episode could not be made, or with ``--strict`` lacks something."""
    check_numbers(arguments, _LIMITS)
    study = study_of(arguments)
    folder = folder_at(arguments.out)
    make_risk_set = _risk_set_of(study, folder, arguments)
    options = WorkerOptions(arguments.retries, arguments.timeout_s)
    with _workers(arguments) as workers, tqdm(unit="episode", desc="generate", disable=None) as bar:
        result = run_study(study, folder, workers, options, StudyBar(bar))
    print(*_summary(result.rows), sep="\n")
    kept = f", {result.kept} of them from before" if result.kept else ""
    maps = ", ".join(dict.fromkeys(row.map_name for row in result.rows))
    print(f"{folder.place}/{MANIFEST}: {len(result.rows)} episodes on {maps}{kept}")
    missing = [row for row in result.rows if row.status is not Status.COMPLETE]
    for row in missing[:_MOST_NAMED]:
        complain(f"siren generate: {row.episode}: {row.status}: {row.reason}")
    lacking = [row for row in result.rows if row.status is Status.COMPLETE and row.shortcomings]
    for row in lacking[: _MOST_NAMED if arguments.strict else 0]:
        complain(f"siren generate: {row.episode}: {' and '.join(row.shortcomings)}")
    complete = make_risk_set()
    return EXIT_FAILED if missing or not complete or (arguments.strict and lacking) else EXIT_OK


def _risk_set_of(study: Study, folder: StudyFolder, arguments: argparse.Namespace) -> Callable[[], bool]:
    """Makes the risk videos that a study asks for, with the settings of its first episodes except preset and sensors.

    What is returned says whether the set is complete.

    Raises:
        InputError: They are asked for on several maps, or behind a URL.
    """
    if study.risk_videos == 0:
        return lambda: True
    if not isinstance(folder, LocalFolder):
        raise InputError("risk_videos", f"in {folder.place}", "a local folder; then copy the set")
    if study.values:
        raise InputError("risk_videos", f"with values {study.values}", "none; the videos draw values of their own")
    if len(study.maps) > 1:
        raise InputError("risk_videos", f"on {len(study.maps)} maps", "one map")
    map_file = "" if study.maps[0] == TOWN else study.maps[0]
    from siren_ros.cli.generate_risk import make_and_print  # noqa: PLC0415 - takes as long to load as all else here
    from siren_ros.running.studies.risk_set.make_set import RiskSetRequest  # noqa: PLC0415 - as above
    from siren_ros.running.studies.risk_set.search import papers_balance  # noqa: PLC0415 - as above

    balance, seed = papers_balance(len(study.templates), study.risk_videos), study.seeds[0]
    request = RiskSetRequest(study.templates, balance, seed=seed, map_file=map_file, retries=arguments.retries)
    return lambda: make_and_print(request, Path(folder.place) / RISK_VIDEOS, arguments.workers)


@contextmanager
def _workers(arguments: argparse.Namespace) -> Iterator[Workers]:
    if arguments.scheduler and arguments.slurm:
        raise InputError("slurm", "with --scheduler", "one of both")
    if not arguments.scheduler and not arguments.slurm:
        yield LocalWorkers(arguments.workers)
        return
    with connected(arguments.scheduler) if arguments.scheduler else on_slurm(arguments.workers) as client:
        yield DaskWorkers(client)


def study_of(arguments: argparse.Namespace) -> Study:
    """The study of the study file, or of all templates; options of the command line replace its fields."""
    named = arguments.study
    study = Study(TEMPLATES) if named is None else read_study(named_params_file("study", "studies", named))
    return replace(study, **asked_of(arguments, _MATRIX), draws=_draws_of(arguments) or study.draws)


def _draws_of(arguments: argparse.Namespace) -> DrawPlan | None:
    asked = [name for name in ("grid", "random", "lhs") if getattr(arguments, name) is not None]
    if len(asked) > 1:
        raise InputError("draws", " and ".join(asked), "one of grid, random, lhs")
    if not asked and arguments.range:
        raise InputError("range", arguments.range[0], "ranges together with --random or --lhs")
    if not asked or asked == ["grid"]:
        return grid_of(arguments.grid) if asked else None
    method = Method.RANDOM if asked == ["random"] else Method.LATIN_HYPERCUBE
    samples, ranges = getattr(arguments, asked[0]), ranges_of(arguments.range)
    return DrawPlan(method, samples=samples, ranges=ranges, seed=arguments.draw_seed)


def _summary(rows: Iterable[EpisodeRow]) -> Iterator[str]:
    """One line for each template and level.

    An episode that ``duration_s`` ends before its template does is cut short where its interaction did not happen.
    """
    own_steps = cache(lambda template, values: plan_length(EpisodeRequest(template=template, values=values)))
    groups: dict[str, list[EpisodeRow]] = {}
    for row in rows:
        groups.setdefault(row.group, []).append(row)
    width = max(map(len, groups), default=0)
    for group, episodes in sorted(groups.items()):
        complete = [row for row in episodes if row.status is Status.COMPLETE]
        holds = sum(bool(row.predicate_holds) for row in complete)
        cut = sum(not row.predicate_holds and row.steps < own_steps(row.template, row.values) for row in complete)
        collided = sum(row.collisions > 0 for row in complete)
        parts = [f"{len(complete)}/{len(episodes)} complete"]
        parts += [f"predicate holds in {holds}/{len(complete) - cut}"] if len(complete) > cut else []
        parts += [f"{cut} cut short by duration_s"] if cut else []
        parts += [f"collisions in {collided}"] if collided else []
        people = [row.people["met"] > 0 for row in complete if row.people]
        parts += [f"people met in {sum(people)}/{len(people)}"] if people else []
        times = [row.process_s / row.simulated_s for row in complete if row.simulated_s]
        cpu = [row.cpu_s / row.simulated_s for row in complete if row.simulated_s]
        parts += [f"at most {max(times):.2f} s for a simulated second ({max(cpu):.2f} s of CPU)"] if times else []
        retried = sum(row.attempts - 1 for row in episodes)
        parts += [f"{retried} retried"] if retried else []
        yield f"{group:<{width}}  {', '.join(parts)}"
