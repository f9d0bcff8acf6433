import json
import logging
import shutil

import pytest
from datasets.made_bag import Export

from siren_ros.cli.main import main
from siren_ros.data.datasets.publication import CROISSANT_FILE, check_copy, croissant, files_of
from siren_ros.data.episode_source import LICENCE, LICENCE_URL, UNKNOWN, licence_of_map
from siren_ros.errors import InputError


@pytest.fixture
def dataset(exported: Export, first_made_bag, tmp_path):
    return shutil.copytree(exported("csv", first_made_bag), tmp_path / "csv")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # the reader's own, of its rdflib
@pytest.mark.parametrize("form", ["kitti", "argoverse2"])
def test_mlcommons_reader_accepts_the_metadata(form, made_bags, made_drive, exported: Export, caplog):
    mlcroissant = pytest.importorskip("mlcroissant")
    folder = exported(form, made_drive if form == "argoverse2" else tuple(made_bags))
    with caplog.at_level(logging.WARNING):
        read = mlcroissant.Dataset(jsonld=folder / CROISSANT_FILE)
    assert not read.metadata.ctx.issues.errors
    assert read.metadata.name == f"SIREN {form}"
    assert read.metadata.license == [LICENCE_URL]
    card = json.loads((folder / "dataset.json").read_text())
    episodes = list(read.records("episodes"))
    assert [record["episodes/id"].decode() for record in episodes] == [episode["id"] for episode in card["episodes"]]
    assert [record["episodes/seed"] for record in episodes] == [episode["seed"] for episode in card["episodes"]]


def test_every_file_is_named_with_its_hash(dataset):
    named = {file["contentUrl"]: file for file in json.loads((dataset / CROISSANT_FILE).read_text())["distribution"]}
    assert {file.path for file in files_of(dataset)} == set(named)
    assert {"README.md", "dataset.json"} < set(named)
    assert CROISSANT_FILE not in named
    assert all(len(file["sha256"]) == 64 for file in named.values())


def test_a_whole_copy_passes(dataset, capsys):
    assert main(["check", str(dataset)]) == 0
    assert "whole" in capsys.readouterr().out
    (dataset / "more.txt").write_text("mine")
    (dataset / ".git").mkdir()
    for hidden in (".DS_Store", ".git/config"):
        (dataset / hidden).write_text("hidden")
    assert check_copy(dataset).further == ("more.txt",)
    assert main(["check", str(dataset)]) == 0


def test_a_changed_and_a_missing_file_are_named(dataset, capsys):
    readme = dataset / "README.md"
    text = readme.read_bytes()
    readme.write_bytes(text[:-1] + b"x")
    found = check_copy(dataset)
    assert (found.changed, found.missing, found.is_whole) == (("README.md",), (), False)
    assert main(["check", str(dataset)]) == 1
    assert "README.md: changed" in capsys.readouterr().err
    readme.unlink()
    assert check_copy(dataset).missing == ("README.md",)


def test_a_folder_that_is_no_dataset_is_refused(tmp_path):
    with pytest.raises(InputError, match=CROISSANT_FILE):
        check_copy(tmp_path)
    (tmp_path / CROISSANT_FILE).write_text('{"distribution": [{}]}')
    with pytest.raises(InputError, match=CROISSANT_FILE):
        check_copy(tmp_path)


@pytest.mark.parametrize(
    ("name", "file", "licence"),
    [
        ("town", "", LICENCE),
        ("city", "city", LICENCE),
        ("motorway", "", LICENCE),
        ("town", "maps/town.net.xml", UNKNOWN),
        ("Town10HD_Opt", "../maps/Town10HD_Opt.xodr", "CC-BY, CARLA's assets"),
        ("Town01", "Town01.xodr", "CC-BY, CARLA's assets"),
        ("Townsville", "Townsville.xodr", UNKNOWN),
        ("berlin", "berlin.osm.gz", "ODbL-1.0, © OpenStreetMap contributors"),
    ],
)
def test_maps_keep_their_licences(name, file, licence):
    assert licence_of_map(name, file) == licence


def test_the_metadata_have_the_licence_of_the_card(tmp_path):
    for licence, named in ((LICENCE, LICENCE_URL), (UNKNOWN, UNKNOWN)):
        assert croissant(tmp_path, {"name": "n", "what": "Things", "licence": licence}, "1")["license"] == named
