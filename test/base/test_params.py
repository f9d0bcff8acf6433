"""Files of parameters and of users: where they lie, what is read of them, and how faults are named."""

import hashlib
import json
import os
import stat
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from known_outputs import assert_known

from siren_ros.base.params import plain_files
from siren_ros.base.params.folders import (
    default_cache_dir,
    find_params_dir,
    named_params_file,
    params_dir,
    private_folder,
    user_folder,
)
from siren_ros.base.params.parameters import (
    FILES_ON_DISK,
    InputFile,
    NotedFiles,
    RecordedFiles,
    check_fields,
    checked_value,
    defaults_of,
    files_from_json,
    files_to_json,
    parameter,
    parse_strict_yaml,
    read_strict_yaml,
)
from siren_ros.base.params.plain_files import open_network, write_network
from siren_ros.errors import BagError, InputError
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import SHIPPED
from siren_ros.sensing.look import load_look
from siren_ros.sensing.suite import load_suite
from siren_ros.simulation.dynamics.vehicle_model import read_vehicle_parameters
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.plan import load_drivers


@pytest.mark.parametrize(
    "text", ['{"\\ud800": 1}', '["a\\uDFFF"]', '["\\udc00\\ud800"]', b'["\xed\xa0\x80"]', '["\ud800"]']
)
def test_halves_of_characters_are_refused(text: str | bytes) -> None:
    with pytest.raises(ValueError, match=r"surrogate|utf-8"):
        plain_files.load_json(text)


def test_whole_characters_are_read_however_they_are_written_and_nothing_that_is_no_json(tmp_path: Path) -> None:
    for text in ('["\\ud83d\\ude91 \\\\ud800"]', '["🚑 \\\\ud800"]', '["🚑 \\\\ud800"]'.encode("utf-16")):
        assert plain_files.load_json(text) == ["🚑 \\ud800"]
    for text in ("[" * 200_000, '{"a":' * 200_000, "", "{"):
        (tmp_path / "x.json").write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=r"."):
            plain_files.read_json(tmp_path / "x.json")


def test_arrays_within_the_limit_are_read_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    np.savez_compressed(path, a=np.zeros(1000), b=np.array("é"))
    arrays = plain_files.read_arrays(path, 9_000)
    assert (arrays["a"].shape, str(arrays["b"])) == ((1000,), "é")
    for most, told in ((8_000, "more than 8000"), (9_000, "allow_pickle")):
        with pytest.raises(ValueError, match=told):
            plain_files.read_arrays(path, most)
        np.savez(path, a=np.array([print], dtype=object))
    for content in (b"PK no archive", b""):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"no \.npz file"):
            plain_files.read_arrays(path, 9_000)
    with pytest.raises(OSError, match="No such file"):
        plain_files.read_arrays(tmp_path / "none", 9_000)


def test_a_table_within_the_limits_is_read_and_a_larger_one_is_not(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    given = pa.table({"a": [1.0] * 5000, "b": ["x" * 100] * 5000})
    pq.write_table(given, path)
    assert plain_files.read_table(path, 5000, 200).equals(given)
    assert plain_files.read_table(path, 5000, 10, columns=["a"]).equals(given.select(["a"]))
    with pytest.raises(ValueError, match="5000 rows, more than 4999"):
        plain_files.read_table(path, 4999, 200)
    with pytest.raises(ValueError, match="bytes in memory"):
        plain_files.read_table(path, 5000, 50)
    pq.write_table(given.slice(0, 0), path)
    assert plain_files.read_table(path, 0, 0).column_names == ["a", "b"]


def test_a_small_file_of_long_lists_is_refused_at_its_first_batch(tmp_path: Path) -> None:
    """80 MB in memory, thousandths of it in the file."""
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table({"x": [[0.0] * 1000] * 10_000}), path, compression="zstd")
    assert path.stat().st_size < 200_000
    with pytest.raises(ValueError, match="bytes in memory for a row"):
        plain_files.read_table(path, 10_000, 1_000)


FILES = (InputFile("looks", "/a/ä.yaml", "fog: 1\n"), InputFile("presets", "paper", "title: ä\n"))


@pytest.mark.parametrize(
    "stored",
    [
        None,
        {},
        [7],
        [{"folder": "looks", "name": "a", "text": ""}],
        [{"folder": "looks", "name": "a", "sha256": "0" * 64, "text": ""}],
        [{"folder": "looks", "name": 1, "sha256": "", "text": ""}],
        files_to_json([InputFile("looks", "a", "x" * 256_001)]),
    ],
)
def test_files_come_back_from_json_and_damaged_ones_are_refused(stored: Any) -> None:
    largest = InputFile("looks", "a", "x" * 256_000)
    assert files_from_json(files_to_json((*FILES, largest))) == (*FILES, largest)
    with pytest.raises(BagError):
        files_from_json(stored)


def test_recorded_files_are_found_by_folder_and_name() -> None:
    recorded = RecordedFiles(FILES)
    assert recorded.read("preset", "presets", "paper").mapping().text("title") == "ä"
    for folder, name in (("looks", "paper"), ("presets", "realistic")):
        with pytest.raises(InputError, match="presets/paper"):
            recorded.read("preset", folder, name)
    noted = NotedFiles(recorded)
    assert [noted.has("presets", "paper"), noted.has("looks", "paper"), noted.seen] == [True, False, ()]
    assert NotedFiles(FILES_ON_DISK).has("looks", "clear")
    (file,) = files_from_json(files_to_json([InputFile("presets", "mine.yaml", "a: 1\nb: x\n")]))
    with pytest.raises(InputError, match=r"mine\.yaml of the record:2: b"):
        file.mapping().number("b", 0.0, 1.0)


def test_noted_files_are_those_that_were_read(tmp_path: Path) -> None:
    mine = tmp_path / "own.yaml"
    mine.write_text("title: own\n", encoding="utf-8")
    noted = NotedFiles(FILES_ON_DISK)
    assert noted.seen == ()
    for folder, name in (("presets", str(mine)), ("presets", "paper"), ("presets", str(mine)), ("looks", str(mine))):
        noted.read("preset", folder, name)
    of_presets = [("presets", str(mine)), ("presets", "paper")]
    assert [(file.folder, file.name) for file in noted.seen] == [("looks", str(mine)), *of_presets]
    assert noted.seen[0].text == "title: own\n"


def test_what_is_written_can_be_opened_and_written_again(tmp_path) -> None:
    weights = (params_dir() / SHIPPED).read_bytes()
    card = {"name": "mine", "sha256": hashlib.sha256(weights).hexdigest()}
    path = tmp_path / "deep" / "mine.onnx"
    for name in ("mine", "other"):
        write_network(path, weights, {**card, "name": name})
        network = open_network(path)
        assert network.card == {**card, "name": name}
        assert {output.name for output in network.session.get_outputs()} == {"xy_m", "probability"}
    assert json.loads(path.with_name("mine.json").read_text(encoding="utf-8"))["name"] == "other"
    with pytest.raises(InputError, match="a folder"):
        write_network(path / "a.onnx", b"", {})


def read_with(text: str, reader: str, *how: Any, **more: Any) -> Any:
    """The value of the key ``a`` of a YAML text, as one of the readers gives it."""
    return getattr(parse_strict_yaml(text, "f.yaml"), reader)("a", *how, **more)


@pytest.mark.parametrize(
    ("texts", "reader", "how", "said"),
    [
        (("b: 1\na: 2\na: 3",), "number", (0, 9), "f.yaml:3: a: 'a'.*each key once"),
        (("[1]: 2",), "number", (0, 9), "f.yaml:1: .*keys that are texts"),
        (("b: &x 1\na: *x",), "number", (0, 9), "an alias"),
        (("a: " + "[" * 32 + "]" * 32,), "words", (), "more than 32 levels"),
        (("b: 1",), "number", (0, 9), "a: .*the key is missing"),
        (("a: 0.9", "a: 9.1", "a: true", "a: '2'", "a: .nan"), "number", (1, 9), "a number from 1 to 9"),
        (("a: 0", "a: 10", "a: 2.0", "a: 08", "a: x"), "integer", (1, 9), "whole number from 1 to 9"),
        (("a: 1", "a: 'true'", "a: [true]"), "flag", (), "true or false"),
        (("a: ''", "a: 1", "a: [x]"), "text", (), "a text that is not empty"),
        *[(("a: z",), "text", (("x", "y"),), "one of x, y"), (("a: 1",), "mapping", (), "f.yaml:1: a: '1'.*a mapping")],
        (("a:\n- {b: 1}\n- 2",), "mappings", (), r"f.yaml:3: a\[1\]"),
        (
            ("a: [1]", "a: [1, 2, 3]", "a: 7", "a: [1, x]", "a: [-1, 2]", "a: [1, 10]"),
            "numbers",
            (2, 0, 9),
            "of 2 numb",
        ),
        (("a: []", "a: {b: 1}", "a: [x, '']", "a: [x, [y]]"), "words", (), "a word, or a list of words"),
    ],
)
def test_values_of_another_kind_or_out_of_range_are_refused_at_their_line(
    texts: tuple[str, ...], reader: str, how: tuple[Any, ...], said: str
) -> None:
    for text in texts:
        with pytest.raises(InputError, match=said):
            read_with(text, reader, *how)


def test_values_within_their_range_are_read() -> None:
    for text, value in (("1", 1.0), ("9.0", 9.0), ("2.5", 2.5)):
        assert read_with(f"a: {text}", "number", 1, 9) == value
    for text, value in (("1", 1), ("1_000", 1000), ("0x1F", 31)):
        assert read_with(f"a: {text}", "integer", 1, 1000) == value
    assert [read_with(f"a: {text}", "flag") for text in ("true", "yes", "On", "no")] == [True, True, True, False]
    assert [read_with("b: 1", "flag", default) for default in (True, False)] == [True, False]
    assert (read_with("a: y", "text", ("x", "y")), read_with("a: [0, 9]", "numbers", 2, 0, 9)) == ("y", (0.0, 9.0))
    assert (read_with("a: 7", "words"), read_with("a: [x, 1]", "words")) == (("7",), ("x", "1"))


def test_numbers_may_come_several_times_and_places_are_named_from_the_top() -> None:
    assert read_with("a: [1, 2, 3, 4]", "numbers", 2, 0, 9, times=True) == (1.0, 2.0, 3.0, 4.0)
    for text in ("a: []", "a: [1, 2, 3]"):
        with pytest.raises(InputError, match="2 numbers or a multiple"):
            read_with(text, "numbers", 2, 0, 9, times=True)
    top = parse_strict_yaml("b: 1\na:\n  c:\n  - {d: 3}\n  e: 4", "f.yaml")
    inner = top.mapping("a")
    (item,) = inner.mappings("c")
    assert (item.where("d"), inner.where("e"), top.where("x")) == ("f.yaml:4: a.c[0].d", "f.yaml:5: a.e", "f.yaml:1: x")
    assert [top.has("b"), top.has("x"), top.is_mapping("a"), top.is_mapping("b")] == [True, False, True, False]
    with pytest.raises(InputError, match=r"f.yaml:5: a.e: '4' .*keys c"):
        inner.finish()
    top.finish()


def test_the_largest_file_of_parameters_is_read_and_one_byte_more_is_not(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_bytes(b"a: x\n" + b" " * 255_995)
    assert read_strict_yaml(file).text("a") == "x"
    file.write_bytes(b"a: x\n" + b" " * 255_996)
    with pytest.raises(InputError, match="at most 256000 bytes"):
        read_strict_yaml(file)


def test_the_hash_of_a_folder_is_of_its_files_names_and_bytes(tmp_path: Path) -> None:
    def hash_of(**files: str) -> str:
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        for name, text in files.items():
            (folder / name).write_text(text)
        return plain_files.sha256_of(folder)

    same = hash_of(a="1", b="2", c="3")
    assert hash_of(c="3", b="2", a="1") == same
    assert len({same, hash_of(a="2", b="1", c="3"), hash_of(a="1", b="2", d="3"), hash_of(a="1", b="2")}) == 4


@dataclass
class Config:
    rate: float = parameter(2.0, "A number.", minimum=0.5, maximum=4.0)
    count: int = parameter(3, "A whole number.", minimum=1)
    on: bool = parameter(False, "A flag.")
    kind: str = parameter("a", "A choice.", choices=("a", "b"), read=lambda word: str(word).lower())
    names: list[str] = parameter(["x"], "A list.")  # noqa: RUF009 - it is a field
    text: str = parameter("", "A text.")


@pytest.mark.parametrize(
    ("name", "taken", "refused", "allowed"),
    [
        ("rate", [(0.5, 0.5), (4, 4.0)], (0.4, 4.1, 5, float("nan"), True, "2"), "a number from 0.5 to 4"),
        ("count", [(1, 1), (10**9, 10**9)], (0, 2.0, True, "2"), "an integer of at least 1"),
        ("on", [(True, True)], (1, "true", None), "true or false"),
        ("kind", [("B", "b")], ("c", ""), "one of 'a', 'b'"),
        ("names", [(None, []), (("y", 2), ["y", "2"])], ("y", 2), "a list of strings"),
        ("text", [("2", "2")], (2, True, None, ["2"]), "a string"),
    ],
)
def test_a_parameter_takes_values_of_its_kind_within_its_range_alone(name, taken, refused, allowed) -> None:
    field, default = Config.__dataclass_fields__[name], getattr(Config(), name)
    for given, value in taken:
        found = checked_value(field, default, given)
        assert (found, type(found)) == (value, type(default))
    for given in refused:
        with pytest.raises(InputError) as error:
            checked_value(field, default, given)
        assert (error.value.parameter, error.value.allowed) == (name, allowed)
    check_fields(Config())
    with pytest.raises(InputError, match=name):
        check_fields(replace(Config(), **{name: refused[0]}))


def test_each_config_has_lists_of_its_own() -> None:
    assert defaults_of(Config) == {"rate": 2.0, "count": 3, "on": False, "kind": "a", "names": ["x"], "text": ""}
    Config().names.append("y")
    assert Config().names == ["x"]


READERS = {"templates": load_template, "presets": load_preset, "suites": load_suite, "looks": load_look}
READERS |= {"drivers": load_drivers}


@pytest.mark.parametrize("kind", READERS)
def test_an_unknown_key_is_refused_with_its_line(kind: str, tmp_path: Path) -> None:
    good = min((params_dir() / kind).glob("*.yaml")).read_text(encoding="utf-8").rstrip("\n")
    file = tmp_path / "mine.yaml"
    file.write_text(f"{good}\nsurprise: 1\n", encoding="utf-8")
    line = good.count("\n") + 2
    with pytest.raises(InputError, match=rf"mine\.yaml:{line}: surprise"):
        READERS[kind](str(file))


def test_an_unknown_key_of_a_vehicle_is_refused_with_its_line(tmp_path: Path) -> None:
    for file in (params_dir() / "vehicles").glob("*.yaml"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    good = (tmp_path / "van.yaml").read_text(encoding="utf-8").rstrip("\n")
    (tmp_path / "van.yaml").write_text(f"{good}\nsurprise: 1\n", encoding="utf-8")
    with pytest.raises(InputError, match=rf"van\.yaml:{good.count(chr(10)) + 2}: surprise"):
        read_vehicle_parameters(tmp_path)


def test_a_file_that_was_changed_is_read_anew(tmp_path: Path) -> None:
    for text in ("one", "other"):
        (tmp_path / "mine.yaml").write_text(f"key: {text}\n", encoding="utf-8")
        assert read_strict_yaml(tmp_path / "mine.yaml").text("key") == text


@pytest.mark.parametrize(
    "name", ["\0.yaml", "x" * 5000 + ".yaml", "~nobody-here/a.yaml", "S99", "../templates/S1", "."]
)
def test_a_name_that_is_no_file_is_answered_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError, match="S1, S2"):
        named_params_file("template", "templates", name)


def test_the_folder_of_parameters_is_beside_the_package_or_in_its_prefix_or_in_the_index(tmp_path: Path) -> None:
    def made(folder: str) -> Path:
        (tmp_path / folder).mkdir(parents=True)
        return tmp_path / folder

    package, package_of_index = made("source/siren_ros"), made("anywhere/siren_ros")
    with pytest.raises(InputError, match=r"installation: .*siren_ros.*params"):
        find_params_dir(package / "__init__.py", "")
    checkout = made("source/params")
    (tmp_path / "source/package.xml").touch()
    made("build")
    (tmp_path / "build/siren_ros").symlink_to(package)
    for checked_out in (package, tmp_path / "build/siren_ros"):
        assert find_params_dir(checked_out / "__init__.py", "") == checkout
    second, third, own = (made(f"{name}/share/siren_ros/params") for name in ("second", "third", "install"))
    installed = made("install/lib/python3.12/site-packages/siren_ros")
    index = ":".join(["", *(str(tmp_path / name) for name in ("first", "second", "third"))])
    assert find_params_dir(installed / "__init__.py", index) == own
    assert find_params_dir(package_of_index / "__init__.py", index) == second != third


@pytest.fixture(autouse=True)
def _temporary(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


def test_a_users_folder_lies_below_the_home_or_among_temporary_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    assert user_folder(".cache/x") == home / ".cache/x"
    assert (home / ".cache/x").is_dir()
    monkeypatch.delenv("HOME")
    monkeypatch.setattr("pathlib.Path.home", lambda: (_ for _ in ()).throw(RuntimeError("no such user")))
    assert user_folder(".ros/log") == tmp_path / f"siren_ros_{os.geteuid()}" / ".ros/log"
    monkeypatch.setenv("HOME", str(tmp_path / "none"))
    (tmp_path / "file").touch()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))
    with pytest.raises(InputError, match=r"^HOME: .* or a folder for temporary files, that can be written"):
        user_folder("log")


@pytest.mark.parametrize("blocked", ["absent", "a file in the way"])
def test_a_home_that_cannot_be_written_is_left_alone(
    blocked: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    home = tmp_path / "home"
    if blocked != "absent":
        home.mkdir()
        (home / ".cache").touch()
    monkeypatch.setenv("HOME", str(home))
    own = tmp_path / f"siren_ros_{os.geteuid()}"
    assert user_folder(".cache/x") == user_folder(".cache/x") == own / ".cache/x"
    assert (own / ".cache/x").is_dir()
    assert stat.S_IMODE(own.stat().st_mode) == 0o700
    assert home.exists() == (blocked != "absent")


@pytest.mark.parametrize("planted", ["a link", "a file", "open to others"])
def test_a_private_folder_is_never_one_that_others_can_reach(planted: str, tmp_path: Path) -> None:
    name, theirs = f"x-{planted.replace(' ', '-')}", tmp_path / "theirs"
    theirs.mkdir()
    if planted == "a link":
        (tmp_path / name).symlink_to(theirs)
    elif planted == "a file":
        (tmp_path / name).touch()
    else:
        (tmp_path / name).mkdir()
        (tmp_path / name).chmod(0o777)
    folder = private_folder(name)
    assert folder != tmp_path / name
    assert not folder.is_symlink()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert private_folder(name) == folder, "one process has one"
    folder.rmdir()
    assert private_folder(name).is_dir(), "and another one where that is gone"
    assert list(theirs.iterdir()) == []
    own = tmp_path / f"own-{name}"
    own.mkdir(mode=0o755)
    assert (private_folder(own.name), stat.S_IMODE(own.stat().st_mode)) == (own, 0o700)


def test_the_environment_says_where_the_cache_is(monkeypatch, tmp_path):
    monkeypatch.setenv("SIREN_CACHE_DIR", str(tmp_path / "own"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert default_cache_dir() == tmp_path / "own"
    monkeypatch.delenv("SIREN_CACHE_DIR")
    assert default_cache_dir() == tmp_path / "xdg" / "siren"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_cache_dir() == tmp_path / ".cache" / "siren"


VALUES = """
whole: 7
below: -3
hexadecimal: 0x1F
octal: 017
grouped: 1_000
real: 2.5
infinite: .inf
none: null
yes: true
word: left
quoted: "7"
blank: ""
words: [a, 2, c]
numbers: [1, 2.5, 3, 4]
wide: [1, 2.5, 300, 4]
empty: []
table: {a: 1}
tables: [{a: 1}, {b: 2}]
mixed: [{a: 1}, 5]
"""
ANSWERS = {
    "number": lambda at, key: at.number(key, -2.0, 100.0),
    "integer": lambda at, key: at.integer(key, 0, 100),
    "flag": lambda at, key: at.flag(key),
    "text": lambda at, key: at.text(key),
    "choice": lambda at, key: at.text(key, ("left", "7"), str),
    "mapping": lambda at, key: list(at.mapping(key).values),
    "mappings": lambda at, key: [list(one.values) for one in at.mappings(key)],
    "four numbers": lambda at, key: at.numbers(key, 4, 0.0, 10.0),
    "pairs": lambda at, key: at.numbers(key, 2, 0.0, 10.0, times=True),
    "words": lambda at, key: at.words(key),
}


def test_what_every_reader_says_of_every_value() -> None:
    found: dict[str, dict[str, object]] = {}
    for key in (*parse_strict_yaml(VALUES, "a.yaml").values, "absent"):
        for name, read in ANSWERS.items():
            at = parse_strict_yaml(f"inside:{VALUES}".replace("\n", "\n  "), "a.yaml").mapping("inside")
            try:
                found.setdefault(name, {})[key] = read(at, key)
            except InputError as error:
                found.setdefault(name, {})[key] = str(error)
    assert_known(Path(__file__).parent / "known" / "readers.json", found)
