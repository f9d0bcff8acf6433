"""``siren generate`` and ``siren sites``."""

import json
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from made_crossing import made_net
from map_networks import network_of_map
from repository import REPOSITORY

from siren_ros.base.params.folders import named_params_file
from siren_ros.cli import generate, generate_risk
from siren_ros.cli.main import main
from siren_ros.running.generation.site_choice import good_sites, ranked_sites, shortcomings
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import DrawPlan, Method, PlannedEpisode, Study, plan_study, read_study
from siren_ros.running.studies.risk_set.make_set import RiskSetRequest
from siren_ros.running.studies.risk_set.search import Balance
from siren_ros.running.studies.run_study import StudyResult
from siren_ros.running.studies.study_folder import LocalFolder, read_table
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.templates import load_template

SHORT = ["--duration-s", "0.5", "--workers", "2"]


def test_a_matrix_is_made_and_made_once(tmp_path: Path, siren) -> None:
    out = tmp_path / "study"
    words = ["generate", "--templates", "S2", "--levels", "L0", "own", "--out", str(out), *SHORT]
    first = siren(words).out
    assert "S2_L0  1/1 complete, 1 cut short by duration_s, at most " in first
    assert first.splitlines()[-1] == f"{out}/manifest.parquet: 2 episodes on town"
    times = [row.begun_at for row in read_table(LocalFolder(out))]
    kept = siren(words).out.splitlines()[-1]
    assert kept == f"{out}/manifest.parquet: 2 episodes on town, 2 of them from before"
    assert [row.begun_at for row in read_table(LocalFolder(out))] == times


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--duration-s", "nan"], "duration_s: nan cannot be used; allowed: a number from 0 to 3600"),
        (["--timeout-s", "inf"], "timeout_s: inf cannot be used; allowed: a number from 1 to 1000000"),
        (["--random", "0"], "random: 0 cannot be used; allowed: an integer from 1 to 10000000"),
        (["--lhs", "1", "--draw-seed", "-1"], "draw_seed: -1 cannot be used; allowed: an integer from 0 to 2147483647"),
        (["--values", "emv.speed_mps=nan"], "emv.speed_mps: nan cannot be used; allowed: a number from 11 to 16.7"),
        (["--values", "emv.speed=12"], "emv.speed: 12.0 cannot be used; allowed: "),
        (["v9"], "study: 'v9'"),
        (["--templates", "S9"], "template: 'S9'"),
        (["--workers", "0"], "workers: 0"),
        (["--seeds", "a"], "seeds: 'a'"),
        (["--range", "emv.speed_mps=12:13"], "range: "),
        (["--grid", "emv.speed_mps=12", "--lhs", "4"], "draws: 'grid and lhs'"),
        (["--risk-videos", "-1"], "risk_videos: -1"),
        (["--risk-videos", "1", "--maps", "town", "other.xodr"], "risk_videos: 'on 2 maps'"),
        (["--risk-videos", "1", "--values", "emv.speed_mps=12"], "risk_videos: 'with values"),
        (["--risk-videos", "1", "--out", "memory://study"], "risk_videos: 'in memory"),
        (["--values", "emv.speed_mps=12", "--grid", "emv.speed_mps=13"], "values: "),
    ],
)
def test_bad_input_is_refused_by_its_own_name_before_anything_is_made(words, line, tmp_path, capsys) -> None:
    out = tmp_path / "study"
    assert main(["generate", "--templates", "S2", "--out", str(out), *words]) == 2
    assert capsys.readouterr().err.startswith(f"siren generate: {line}")
    assert not out.exists()


def stand_in(monkeypatch: pytest.MonkeyPatch, *judged: tuple[bool | None, int | dict[str, int], int]) -> None:
    """Puts rows in the place of a study: whether the predicate holds, the collisions or other measures, the steps."""
    (episode,) = plan_study(Study(("S2",)))
    rows = []
    for number, (holds, measured, steps) in enumerate(judged):
        measures = json.dumps(measured if isinstance(measured, dict) else {"collisions": measured})
        known = {"predicate_holds": holds, "steps": steps, "measures": measures}
        rows.append(EpisodeRow.planned(replace(episode, name=f"e{number}"), Status.COMPLETE, **known))
    monkeypatch.setattr(generate, "run_study", lambda *_: StudyResult(tuple(rows), 0))


WHOLE, CUT = 900, 80


@pytest.mark.parametrize(
    ("judged", "summary"),
    [
        ([(True, 0, WHOLE), (False, 0, WHOLE), (None, 0, WHOLE)], "3/3 complete, predicate holds in 1/3"),
        ([(True, 0, WHOLE), (True, 2, CUT)], "2/2 complete, predicate holds in 2/2, collisions in 1"),
        ([(True, 0, CUT), (False, 0, CUT)], "2/2 complete, predicate holds in 1/1, 1 cut short by duration_s"),
        ([(False, 0, CUT)], "1/1 complete, 1 cut short by duration_s"),
        (
            [(True, {}, WHOLE), (True, {"people.met": 0}, WHOLE), (True, {"people.met": 3}, WHOLE)],
            "3/3 complete, predicate holds in 3/3, people met in 1/2",
        ),
    ],
)
def test_the_table_says_how_many_hold_and_how_many_could_not(judged, summary, tmp_path, monkeypatch, siren) -> None:
    stand_in(monkeypatch, *judged)
    assert siren(["generate", "--templates", "S2", "--out", str(tmp_path)]).out.splitlines()[0] == f"S2_L2  {summary}"


@pytest.mark.parametrize(
    ("judged", "code", "line"),
    [
        ((True, 0, WHOLE), 0, ""),
        ((False, 0, CUT), 1, "siren generate: e0: the interaction did not happen\n"),
        ((True, 3, WHOLE), 1, "siren generate: e0: 3 collisions\n"),
        ((None, 0, WHOLE), 1, "siren generate: e0: whether the interaction happened could not be judged\n"),
    ],
)
def test_what_happened_counts_where_the_command_is_strict(judged, code, line, tmp_path, monkeypatch, siren) -> None:
    stand_in(monkeypatch, judged)
    words = ["generate", "--templates", "S2", "--out", str(tmp_path)]
    assert siren(words).err == ""
    assert siren([*words, "--strict"], code).err == line


def test_a_study_with_risk_videos_makes_them_after_its_episodes(tmp_path, monkeypatch) -> None:
    sets, whole = [], [True, False]

    def make(request: RiskSetRequest, out: Path, workers: int) -> bool:
        sets.append((request, out, workers, len(read_table(LocalFolder(tmp_path)))))
        return whole.pop(0)

    monkeypatch.setattr(generate_risk, "make_and_print", make)
    words = ["--templates", "S2", "S4", "--seeds", "7", "--risk-videos", "21", "--retries", "5"]
    codes = [main(["generate", *words, "--out", str(tmp_path), "--duration-s", "0.1", "--workers", "1"]) for _ in "12"]
    assert codes == [0, 1]
    expected = RiskSetRequest(("S2", "S4"), Balance((30, 10, 2), 21), seed=7, retries=5)
    assert sets == [(expected, tmp_path / "risk_videos", 1, 2)] * 2


def test_the_command_line_stands_above_the_study_file(tmp_path, monkeypatch, capsys) -> None:
    asked: list[Study] = []

    def run(study: Study, *_: object) -> StudyResult:
        asked.append(study)
        planned = [PlannedEpisode("", "S1_L3", EpisodeRequest("S1", map=file), -1, "") for file in study.maps]
        return StudyResult(tuple(EpisodeRow.planned(episode, Status.COMPLETE) for episode in planned), 0)

    monkeypatch.setattr(generate, "run_study", run)
    monkeypatch.setattr(generate_risk, "make_and_print", lambda *_: pytest.fail("no videos were asked for"))
    paper = read_study(named_params_file("study", "studies", "v1"))
    words = ["--maps", "maps/Town10HD_Opt.xodr", "--seeds", "3:5", "--risk-videos", "0", "--sensors", "none"]
    assert main(["generate", "v1", *words, "--lhs", "2", "--out", str(tmp_path)]) == 0
    changed = {"maps": ("maps/Town10HD_Opt.xodr",), "seeds": (3, 4), "risk_videos": 0, "sensors": "none"}
    draws = DrawPlan(Method.LATIN_HYPERCUBE, samples=2)
    assert asked == [replace(paper, **changed, draws=draws)]
    assert capsys.readouterr().out.splitlines()[-1] == f"{tmp_path}/manifest.parquet: 1 episodes on Town10HD_Opt"


def test_an_episode_that_is_missing_fails_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--templates", "S2", "--timeout-s", "1", "--retries", "0", "--duration-s", "3000"]
    assert main(["generate", "--out", str(tmp_path), *words]) == 1
    assert "S2_L2_seed0: crashed: its process gave no answer for 1 s" in capsys.readouterr().err


def test_a_study_that_is_terminated_says_so_in_a_line_and_leaves_nothing_half_made(tmp_path: Path) -> None:
    words = ["--templates", "S5", "--duration-s", "3000", "--workers", "1", "--out", str(tmp_path / "study")]
    command = [sys.executable, "-m", "siren_ros.cli.main", "generate", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
        while not list(tmp_path.glob("study/.work/*/.*.partial/*.mcap")):
            assert running.poll() is None
            time.sleep(0.05)
        running.terminate()
        _, printed = running.communicate()
    assert (running.returncode, printed.splitlines()[-1]) == (143, "siren generate: terminated")
    assert "Traceback" not in printed
    assert sorted(path.name for path in (tmp_path / "study").iterdir()) == ["manifest.parquet", "study.json"]


TEMPLATE = load_template("S5")


def rows(printed: str) -> list[list[str]]:
    return [line.split() for line in printed.splitlines()[1:]]


def test_the_good_sites_of_a_template_are_listed_and_all_where_asked(siren) -> None:
    town = network_of_map()
    good = [site.name for site in good_sites(town, TEMPLATE)]
    listed = rows(siren(["sites", "--templates", "S5"]).out)
    assert [row[:3] for row in listed] == [["S5", name, "yes"] for name in good]
    everything = rows(siren(["sites", "--templates", "S5", "--all"]).out)
    assert [row[1] for row in everything] == [site.name for site, _ in ranked_sites(town, TEMPLATE)]
    assert {row[1] for row in everything if row[2] == "yes"} == set(good)


def test_a_site_has_its_street_junction_length_and_lanes_and_is_drawn(siren, tmp_path) -> None:
    line = next(line for line in siren(["sites", "--templates", "S1"]).out.splitlines() if "mill_e_1" in line)
    assert line.split() == ["S1", "mill_e_1..north_e_0", "yes", "North", "Street", "north_west", "203", "2", "no"]
    out = str(tmp_path / "sites.png")
    *printed, drawn = siren(["sites", "--templates", "S1", "--all", "--out", out]).out.splitlines()
    assert drawn == out
    assert Path(out).read_bytes().startswith(b"\x89PNG")
    lacking = next(line for line in printed if "main_e_2" in line)
    assert lacking.endswith("a shoulder, and others have none")


def test_where_no_site_is_good_all_are_listed(siren) -> None:
    """On this map every road ends at the map's end."""
    file = str(REPOSITORY / "test" / "maps" / "bends.xodr")
    network = network_of_map(Path(file))
    assert not good_sites(network, load_template("S2"))
    listed = rows(siren(["sites", file, "--templates", "S2"]).out)
    assert [row[:3] for row in listed] == [["S2", "-1..-2", "no"], ["S2", "2..1", "no"]]
    file = str(REPOSITORY / "test" / "maps" / "signs.osm")
    table, _, proposal = siren(["sites", file, "--templates", "S7"]).out.partition("\n\n")
    assert (rows(table), proposal.splitlines()[1][:2]) == ([], "S7")


def test_several_maps_have_a_line_each_and_a_table_of_what_places_lack(siren, tmp_path: Path) -> None:
    for name in ("bends.xodr", "signs.osm"):
        shutil.copy(REPOSITORY / "test" / "maps" / name, tmp_path)
    (tmp_path / "torn.net.xml").write_text("<net>")
    (tmp_path / "notes.txt").write_text("no map")
    printed = siren(["sites", str(tmp_path), "town", "--templates", "S2", "S5"]).out.splitlines()
    town = network_of_map()
    counts = [
        f"{len(good_sites(town, load_template(name)))}/{len(ranked_sites(town, load_template(name)))}"
        for name in ("S2", "S5")
    ]
    assert [line.split()[:2] for line in printed[2:5]] == [
        ["bends.xodr", "0/2"],
        ["signs.osm", "0/0"],
        ["torn.net.xml", "a"],
    ]
    assert printed[5].split() == ["town", *counts]
    assert printed[printed.index("Maps with a good site") + 2].split()[-1] == "4"
    assert any(line.startswith("S2") and "one driving lane" in line for line in printed)


def test_what_alone_is_lacking_comes_first(siren) -> None:
    """Town lacks nothing for S2, so the other map alone is without a good site; it lacks one thing or several."""
    file = str(REPOSITORY / "test" / "maps" / "bends.xodr")
    printed = siren(["sites", file, "town", "--templates", "S2"]).out.splitlines()
    lines = [line.split()[-5:] for line in printed[printed.index("What places lack") + 2 :] if line]
    won = [int(line[0]) for line in lines]
    assert won == sorted(won, reverse=True)
    sites = shortcomings(network_of_map(Path(file)), load_template("S2")).values()
    assert sum(int(line[3]) for line in lines) >= sum(len(lacking) == 1 for lacking in sites)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["town", "city", "--out", "sites.png"], "out: "),
        (["town", "--add", "signal:a"], "mend: "),
        (["town", "--mend", "x.net.xml"], "mend: "),
        (["--templates", "S9"], "template: 'S9' cannot be used"),
    ],
)
def test_sites_that_cannot_be_listed_are_named(siren, words: list[str], named: str) -> None:
    assert siren(["sites", *words], 2).err.startswith(f"siren sites: {named}")


def test_the_proposed_command_writes_a_map_with_a_good_site(siren, tmp_path: Path) -> None:
    file, out = tmp_path / "crossing.net.xml", tmp_path / "mended.net.xml"
    nodes = {"a": (0, 0), "n": (0, 300), "s": (0, -300), "w": (-300, 0), "e": (300, 0)}
    file.write_bytes(made_net(tmp_path, nodes, ("a n", "a e", "a s", "a w")))
    (command,) = [
        line for line in siren(["sites", str(file), "--templates", "S5"]).out.splitlines() if "--mend" in line
    ]
    words = shlex.split(command[command.index("siren sites") :])
    assert words[-4:] == ["--mend", "OUT.net.xml", "--add", "all_way_stop:a"]
    first, *lines = siren([str(out) if word == "OUT.net.xml" else word for word in words[1:]]).out.splitlines()
    assert first == "added to the map: all_way_stop:a"
    assert "yes" in lines[1].split()
    assert siren(["sites", str(out), "--templates", "S5"]).out.splitlines() == [first, *lines]
