"""Parameter files from strangers: any bytes give a result or an InputError, and soon."""

import os
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.parameters import MAX_YAML_BYTES, read_strict_yaml
from siren_ros.errors import InputError
from siren_ros.running.generation.episode_setup import default_bag_path
from siren_ros.sensing.look import load_look
from siren_ros.sensing.suite import load_suite
from siren_ros.sensing.vehicles.vehicle_shapes import read_drawing
from siren_ros.simulation.dynamics.vehicle_model import read_vehicle_parameters
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.plan import load_drivers
from siren_ros.simulation.world.actors import ActorClass


def load_sedan(path):
    """The vehicles' parameters where one file is a stranger's."""
    with TemporaryDirectory() as folder:
        for kind in ActorClass:
            name = f"{kind.name.lower()}.yaml"
            (Path(folder) / name).symlink_to(path if name == "sedan.yaml" else params_dir() / "vehicles" / name)
        return read_vehicle_parameters(Path(folder))


READERS = {
    "templates": (load_template, "S2"), "presets": (load_preset, "paper"), "suites": (load_suite, "front"),
    "drivers": (load_drivers, "urban"), "looks": (load_look, "clear"), "vehicles": (load_sedan, "sedan"),
    "shapes": (read_drawing, "bus"), "strict": (lambda path: read_strict_yaml(Path(path)), "front"),
}  # fmt: skip
NASTY = [
    *["!!python/object/apply:os.system ['touch hacked']", "a: &a [1, 2]\nb: *a", "a: &a\n  <<: *a"],
    *["? [1, 2]\n: 3", "a: 2001-99-99", "a: 1:99:99", "a: 0o17\nb: 017\nc: 0x_\nd: !!int ''", "a: !!float x"],
    *["a: !!binary ä", "a: !!timestamp x", "a: .nan\nb: .inf"],
    *["lidars: {../x: {mount: {x_m: 0, y_m: 0, z_m: 1}}}", "lidars: {a: {mount: {x_m: .nan, y_m: 0, z_m: 1}}}"],
    *["cameras: {a: {mount: {x_m: 0, y_m: 0, z_m: 1}, width: 1000000000}}", "id: ../../etc/passwd", "[" * 2000],
    *["{a: " * 2000, "- " * 2000, "\0", "\ufeff", "a: 1\na: 2", "---\na: 1\n---\nb: 2", "%YAML 9.9\n---\na: 1"],
    *["x" * (MAX_YAML_BYTES + 1), "a: " + "9" * 5000, "a: 1e999"],
]
texts = st.one_of(
    st.sampled_from(NASTY), st.text(max_size=200), st.text("abc:- \n[]{}&*!?|>'\"#%@`,.0123456789", max_size=200)
)
fuzzed = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def survives(reader, file):
    with suppress(InputError):
        reader(str(file))


@pytest.mark.parametrize("kind", sorted(READERS))
@pytest.mark.parametrize("text", NASTY)
def test_known_attacks_are_refused(kind, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.yaml").write_text(text, encoding="utf-8")
    survives(READERS[kind][0], tmp_path / "file.yaml")
    assert [path.name for path in tmp_path.iterdir()] == ["file.yaml"], "nothing is executed"


@fuzzed
@given(kind=st.sampled_from(sorted(READERS)), text=texts)
def test_any_text(kind, text, tmp_path):
    file = tmp_path / "file.yaml"
    file.write_text(text, encoding="utf-8", errors="surrogatepass")
    survives(READERS[kind][0], file)


def replaced(data, path, value):
    """The data with the value at a place inside, chosen by numbers."""
    if not path or not isinstance(data, dict | list) or not data:
        return value
    if isinstance(data, dict):
        key = list(data)[path[0] % len(data)]
        return {**data, key: replaced(data[key], path[1:], value)}
    place = path[0] % len(data)
    return [*data[:place], replaced(data[place], path[1:], value), *data[place + 1 :]]


scalars = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.dates())
collections = st.lists(st.integers(), max_size=2) | st.dictionaries(st.text(max_size=4), st.integers(), max_size=2)
leaves = scalars | st.binary(max_size=4) | collections


@fuzzed
@given(
    kind=st.sampled_from([kind for kind in READERS if kind != "strict"]),
    path=st.lists(st.integers(0, 50), max_size=6),
    value=leaves,
)
def test_one_wrong_value_in_a_good_file(kind, path, value, tmp_path):
    reader, name = READERS[kind]
    data = yaml.safe_load((params_dir() / kind / f"{name}.yaml").read_text(encoding="utf-8"))
    file = tmp_path / "file.yaml"
    file.write_text(yaml.safe_dump(replaced(data, path, value), allow_unicode=True), encoding="utf-8")
    survives(reader, file)


def test_a_template_cannot_choose_where_files_go(tmp_path):
    text = (params_dir() / "templates" / "S2.yaml").read_text(encoding="utf-8")
    file = tmp_path / "mine.yaml"
    for name in ("../../evil", "/etc/evil", "a/b", "..", "x\\ty"):
        file.write_text(text.replace("id: S2", f'id: "{name}"', 1), encoding="utf-8")
        with pytest.raises(InputError, match="id"):
            default_bag_path(EpisodeRequest(str(file)))


def test_what_is_no_file_is_refused_at_once(tmp_path):
    pipe = tmp_path / "pipe.yaml"
    os.mkfifo(pipe)
    for kind in ("suites", "strict"):
        for path in (str(pipe), str(tmp_path), "\0.yaml", "x" * 5000 + ".yaml"):
            with pytest.raises(InputError):
                READERS[kind][0](path)
