"""``siren sites``: what stands in the table, and what does not."""

from pathlib import Path

from map_networks import network_of_map
from repository import REPOSITORY

from siren_ros.running.generation.site_choice import good_sites, ranked_sites
from siren_ros.simulation.scenario.templates import load_template

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


def test_a_site_has_its_street_junction_length_and_lanes(siren) -> None:
    line = next(line for line in siren(["sites", "--templates", "S1"]).out.splitlines() if "mill_e_1" in line)
    assert line.split() == ["S1", "mill_e_1..north_e_0", "yes", "North", "Street", "north_west", "203", "2", "no"]
    printed = siren(["sites", "--templates", "S1", "--all"]).out.splitlines()
    lacking = next(line for line in printed if "main_e_2" in line)
    assert lacking.endswith("a shoulder, and others have none")


def test_the_map_is_drawn_where_asked(siren, tmp_path: Path) -> None:
    out = siren(["sites", "--templates", "S7", "--out", str(tmp_path / "sites.png")]).out
    assert out.splitlines()[-1] == str(tmp_path / "sites.png")
    assert (tmp_path / "sites.png").read_bytes().startswith(b"\x89PNG")


def test_where_no_site_is_good_all_are_listed(siren) -> None:
    """On this map every road ends at the map's end."""
    file = str(REPOSITORY / "test" / "maps" / "bends.xodr")
    network = network_of_map(Path(file))
    assert not good_sites(network, load_template("S2"))
    listed = rows(siren(["sites", file, "--templates", "S2"]).out)
    assert [row[:3] for row in listed] == [["S2", "-1..-2", "no"], ["S2", "2..1", "no"]]


def test_a_template_without_a_site_has_no_line(siren) -> None:
    file = str(REPOSITORY / "test" / "maps" / "signs.osm")
    assert rows(siren(["sites", file, "--templates", "S7"]).out) == []


def test_an_unknown_template_is_one_line(siren) -> None:
    assert siren(["sites", "--templates", "S9"], 2).err.startswith("siren sites: template: 'S9' cannot be used")
