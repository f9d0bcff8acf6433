"""Tries random road networks: whether maps, sites and episodes are made, or refused by an error of the project's own.

    ./env python tools/random_maps.py --seeds 0:200 --episodes-of 4

Makes one net per seed with SUMO's netgenerate or netconvert: grids, spiders, random networks, and chains of roads whose
numbers of lanes differ. Of every net all templates' sites are looked for; of every fourth net, episodes of all
templates are made without sensors and checked as ``siren verify`` does. Prints every failure and how many there were.
"""

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import siren_ros  # noqa: F401 - before numpy, so that it computes alike everywhere

import numpy as np  # isort: skip

from siren_ros.base.processes.process_pool import ProcessPool, side_by_side
from siren_ros.errors import MapError, SirenError
from siren_ros.lab.benchmarks.templates import EpisodeFigures, figures_of, seeds_of_option
from siren_ros.running.generation.closed_loop import closed_loop, record_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.generation.site_choice import count_lacks, shortcomings
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.netconvert import run_netconvert, sumo_home
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import right_hand_image
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import TEMPLATES
from siren_ros.simulation.scenario.templates import load_template

DURATION_S: Final = 30.0
READY: Final = "siren_ros.running.studies.ready_worker"
JUNCTIONS: Final = (
    "traffic_light", "priority", "right_before_left", "left_before_right", "allway_stop", "priority_stop",
    "unregulated", "zipper",
)  # fmt: skip
Rng = np.random.Generator
Key = TypeVar("Key", int, str)


class Outcome(NamedTuple):
    """What became of a map or an episode."""

    tried: str
    end: str
    wrong: str
    """Empty where nothing is."""


def _grid(rng: Rng) -> list[str]:
    numbers = f"--grid.x-number={rng.integers(1, 5)}", f"--grid.y-number={rng.integers(2, 5)}"
    lengths = f"--grid.length={rng.integers(40, 400)}", f"--grid.attach-length={rng.choice([0, 50, 250])}"
    return ["--grid", *numbers, *lengths]


def _spider(rng: Rng) -> list[str]:
    numbers = f"--spider.arm-number={rng.integers(3, 9)}", f"--spider.circle-number={rng.integers(1, 4)}"
    centre = ["--spider.omit-center"] if rng.random() < 0.3 else []
    return ["--spider", *numbers, f"--spider.space-radius={rng.integers(60, 300)}", *centre]


def _random(rng: Rng) -> list[str]:
    distances = f"--rand.min-distance={rng.integers(20, 100)}", f"--rand.max-distance={rng.integers(120, 500)}"
    drawn = [flag for flag in ("--rand.random-lanenumber", "--rand.random-priority") if rng.random() < 0.5]
    return ["--rand", f"--rand.iterations={rng.integers(10, 40)}", *distances, *drawn]


KINDS: Final[tuple[Callable[[Rng], list[str]], ...]] = (_grid, _spider, _random)


def _generated(rng: Rng, net: Path) -> None:
    """Make a net with netgenerate."""
    kind = KINDS[rng.integers(len(KINDS))]
    lanes = f"--default.lanenumber={rng.integers(1, 5)}", f"--default.speed={rng.choice([8.33, 13.89, 27.78])}"
    more = [f"--default-junction-type={rng.choice(JUNCTIONS)}"] if rng.random() < 0.6 else ["--tls.guess"]
    if rng.random() < 0.4:
        more += [f"--turn-lanes={rng.integers(1, 3)}", f"--turn-lanes.length={rng.integers(10, 80)}"]
    chances = {"--lefthand": 0.2, "--no-turnarounds": 0.5, "--sidewalks.guess": 0.2}
    more += [flag for flag, chance in chances.items() if rng.random() < chance]
    if rng.random() < 0.3:
        more += ["--perturb-x=normal(0,8)", "--perturb-y=normal(0,8)"]
    program = str(sumo_home() / "bin" / "netgenerate")
    seed = f"--seed={rng.integers(1 << 30)}"
    command = [program, *kind(rng), *lanes, *more, seed, f"--output-file={net}"]
    subprocess.run(command, check=False, capture_output=True)  # noqa: S603 - SUMO's own program, drawn options


def _chain(rng: Rng, net: Path) -> None:
    """Make a road whose number of lanes changes at joints, with a street that crosses it somewhere."""
    count, x_m, nodes, edges = int(rng.integers(3, 8)), 0.0, "", ""
    crossed = int(rng.integers(1, count))
    for k in range(count + 1):
        kind = f'type="{rng.choice(JUNCTIONS[:-1])}"' if k == crossed else f'radius="{rng.choice([0, 1.5, 4, 15])}"'
        nodes += f'<node id="{k}" x="{x_m}" y="{rng.normal(0.0, 2.0)}" {kind}/>'
        x_m += float(rng.choice([40.0, 60.0, 200.0, 400.0]))
    edge = '<edge id="{0}" from="{1}" to="{2}" numLanes="{3}" speed="13.9" spreadType="{4}"/>'
    spread = rng.choice(["right", "roadCenter"])
    lanes = rng.integers(1, 5, 2)
    for k in range(count):
        lanes = np.clip(lanes + rng.integers(-1, 2, 2), 1, 5)
        edges += edge.format(f"a{k}", k, k + 1, lanes[0], spread) + edge.format(f"b{k}", k + 1, k, lanes[1], spread)
    crossed_m = float(nodes.split(f'id="{crossed}" x="')[1].split('"')[0])
    for name, y_m in (("n", 200.0), ("s", -200.0)):
        nodes += f'<node id="{name}" x="{crossed_m}" y="{y_m}"/>'
        edges += edge.format(f"{name}0", name, crossed, 1, "right") + edge.format(f"{name}1", crossed, name, 1, "right")
    options = ["--lefthand"] if rng.random() < 0.2 else []
    for kind, content in (("node", nodes), ("edge", edges)):
        plain = net.with_suffix(f".{kind}.xml")
        plain.write_text(f"<{kind}s>{content}</{kind}s>", encoding="utf-8")
        options.append(f"--{kind}-files={plain}")
    net.write_bytes(run_netconvert(options, net, net.name))


def random_net(seed: int, folder: Path) -> Path:
    """The net file of a seed in a folder; it is missing where SUMO's program refuses what was drawn."""
    rng, net = np.random.default_rng(seed), folder / f"random{seed}.net.xml"
    (_chain if rng.random() < 0.3 else _generated)(rng, net)
    return net


def good_sites_of(net: Path) -> Mapping[str, int]:
    """Number of good sites of each template on a map, as ``siren sites`` finds them; SirenError if it is refused."""
    network = right_hand_image(parse_road_network(compile_map(net).read_bytes()))
    found = {}
    for name in TEMPLATES:
        template = load_template(name)
        lacking = shortcomings(network, template)
        count_lacks(network, template, lacking)
        found[name] = sum(not lacks for lacks in lacking.values())
    return found


def short_episode(request: EpisodeRequest) -> EpisodeFigures:
    """The figures of an episode's record; an episode that is refused has its error."""
    try:
        setup = set_up_episode(request)
        record = record_of(setup, list(closed_loop(setup, setup.steps)))
    except SirenError as error:
        return EpisodeFigures(request.template, request.seed, error=f"{type(error).__name__}: {error}")
    return figures_of(record, request, float("nan"))


def attempts(calls: Mapping[Key, tuple[Callable[..., Any], Any]], pool: ProcessPool, workers: int) -> Mapping[Key, Any]:
    """Results of functions with one argument each, of a pool's processes, or the errors that they raise."""

    def attempt(function: Callable[..., Any], argument: Any) -> Any:
        try:
            return pool.call(function, argument)
        except SirenError as error:
            return error

    return side_by_side({key: partial(attempt, *call) for key, call in calls.items()}, workers, pool.stop)


def try_nets(
    nets: Mapping[int, Path], templates: Sequence[str], episodes_of: int, pool: ProcessPool, workers: int = 1
) -> Iterator[Outcome]:
    """Look for sites on all nets and make episodes on some; yields what was tried, how it ended, and what is wrong."""
    sites = attempts({seed: (good_sites_of, net) for seed, net in nets.items()}, pool, workers)
    for seed, found in sites.items():
        wrong = found if isinstance(found, SirenError) and not isinstance(found, MapError) else ""
        yield Outcome(nets[seed].name, type(found).__name__ if isinstance(found, SirenError) else "read", str(wrong))
    requests = {
        f"{nets[seed].name} {name}": EpisodeRequest(
            name, "", seed, str(nets[seed]), sensors="none", duration_s=DURATION_S
        )
        for seed, found in sites.items()
        if seed % episodes_of == 0 and not isinstance(found, SirenError)
        for name in templates
        if found[name]
    }
    episodes = {key: (short_episode, one) for key, one in requests.items()}
    for tried, figures in attempts(episodes, pool, workers).items():
        error = str(figures) if isinstance(figures, SirenError) else figures.error
        wrong = error or "; ".join(figures.violations)
        yield Outcome(tried, error.partition(":")[0] if error else "unsound" if wrong else "sound", wrong)


def main(argv: Sequence[str] | None = None) -> int:
    """Try the nets of some seeds and print what fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds_of_option, default=range(200), help="first:last, the last not included")
    parser.add_argument("--episodes-of", type=int, default=4, metavar="N", help="episodes on every Nth net")
    parser.add_argument("--templates", nargs="+", default=list(TEMPLATES[:6]), metavar="ID")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--folder", type=Path, help="where the nets stay")
    options = parser.parse_args(argv)
    pool = ProcessPool(options.workers, fresh=True, preload=READY)
    with tempfile.TemporaryDirectory() as made, pool:
        folder = options.folder or Path(made)
        folder.mkdir(parents=True, exist_ok=True)
        nets = {seed: random_net(seed, folder) for seed in options.seeds}
        there = {seed: net for seed, net in nets.items() if net.is_file()}
        counts: Counter[str] = Counter()
        for outcome in try_nets(there, options.templates, options.episodes_of, pool, options.workers):
            counts[outcome.end] += 1
            if outcome.wrong:
                print(f"{outcome.tried}: {outcome.wrong}", flush=True)
    print(*(f"{count:5d} {what}" for what, count in sorted(counts.items())), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
