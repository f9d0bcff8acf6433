"""CSP, STDAN and BAT: with the published weights against what their authors' code answers, and with drawn parameters
against the same networks written out for one sample at a time; their files of weights.
"""

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from plain_networks import chosen, drawn, plain_bat_encoder, plain_csp, plain_generator, plain_stdan
from published_files import golden, golden_cells, weights
from torch import Tensor

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.published.networks import (
    Bat,
    BatInput,
    Csp,
    Neighbours,
    NetworkInput,
    Stdan,
)
from siren_ros.scoring.evaluation.prediction.published.predictors import load_weights


def neighbours_of(samples: int, sample: list[int], cell: list[int]) -> Neighbours:
    return Neighbours(torch.tensor(sample, dtype=torch.long), torch.tensor(cell, dtype=torch.long), samples)


def around(others: Tensor, given: Neighbours, number: int) -> dict[int, Tensor]:
    """The neighbours of one sample by their cell."""
    return {int(given.cell[row]): others[:, row] for row in torch.nonzero(given.sample == number).flatten().tolist()}


def assert_close(answers: Any, known: Any) -> None:
    for value, expected in zip(answers, known, strict=True):
        torch.testing.assert_close(value, expected, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize(
    ("sample", "cell"), [([0, 0, 2, 2, 2], [0, 21, 12, 14, 38]), ([], [])], ids=["some neighbours", "nobody"]
)
def test_csp_answers_samples_together_as_each_alone(sample, cell) -> None:
    """Neighbours at both ends of the grid, in all columns; the second of three samples has none."""
    network, generator = drawn(Csp()), torch.Generator().manual_seed(1)
    past, others = (torch.randn((16, count, 2), generator=generator) for count in (3, len(sample)))
    given = neighbours_of(3, sample, cell)
    with torch.inference_mode():
        modes, lateral, longitudinal = network(NetworkInput(past, others, given))
        assert modes.shape == (6, 25, 3, 5)
        for number in range(3):
            known = plain_csp(network, past[:, number], around(others, given, number))
            assert_close((modes[:, :, number], lateral[number], longitudinal[number]), known)


@pytest.mark.parametrize(("sample", "cell"), [([0, 0, 0, 2], [0, 20, 38, 7]), ([], [])])
def test_stdan_attends_to_empty_cells_too(sample, cell) -> None:
    """A cell without a vehicle is a vector of zeros, whose key and value are the biases: it draws attention."""
    network, generator = drawn(Stdan()), torch.Generator().manual_seed(1)
    past, others = (torch.randn((16, count, 5), generator=generator) for count in (3, len(sample)))
    given = neighbours_of(3, sample, cell)
    with torch.inference_mode():
        path, lateral, longitudinal = network(NetworkInput(past, others, given))
        assert path.shape == (25, 3, 5)
        for number in range(3):
            known = plain_stdan(network, past[:, number], around(others, given, number))
            assert_close((path[:, number], lateral[number], longitudinal[number]), known)


@pytest.mark.parametrize(
    ("scene", "sample", "cell"),
    [([0, 0, 1, 2], [0, 0, 0, 1, 3], [3, 19, 30, 21, 38]), ([0, 0], [], [])],
    ids=["scenes of different sizes", "nobody has a neighbour"],
)
def test_bat_attends_within_scenes_and_runs_on_from_sample_to_sample(scene, sample, cell) -> None:
    """The first sample has three neighbours, the second of its scene one; the sample of the second scene has none."""
    network, generator = drawn(Bat()), torch.Generator().manual_seed(1)
    shapes = (16, len(scene), 8), (16, len(sample), 8), (16, len(scene), 39, 6)
    past, others, behaviour = (torch.randn(shape, generator=generator) for shape in shapes)
    given = neighbours_of(len(scene), sample, cell)
    with torch.inference_mode():
        modes, lateral, longitudinal = network(BatInput(past, others, given, behaviour, torch.tensor(scene)))
        assert modes.shape == (9, 25, len(scene), 5)
        for number in sorted(set(scene)):
            members = [place for place, of_scene in enumerate(scene) if of_scene == number]
            parts = [(past[:, place], around(others, given, place), behaviour[:, place]) for place in members]
            for place, encoded in zip(members, plain_bat_encoder(network, parts), strict=True):
                for mode in (5, 7):
                    known = plain_generator(network.g, encoded, (chosen(mode % 3, 3), chosen(mode // 3, 3)))
                    assert_close((modes[mode, :, place], lateral[place], longitudinal[place]), known)


TOLERANCE = 1e-4
RELATIVE = 1e-6
"""Eight digits of single precision differ by the processor."""


def golden_neighbours(known: dict[str, Any]) -> Neighbours:
    sample, cell = golden_cells(known)
    return Neighbours(torch.from_numpy(sample), torch.from_numpy(cell), len(known["mask"]))


def stacked(known: dict[str, Any], *names: str) -> Any:
    return torch.from_numpy(np.concatenate([known[name] for name in names], axis=-1))


def stdan_input(known: dict[str, Any]) -> NetworkInput:
    return NetworkInput(
        stacked(known, "hist", "cls", "va"), stacked(known, "nbrs", "nbrscls", "nbrsva"), golden_neighbours(known)
    )


def bat_input(known: dict[str, Any], scene: Any) -> BatInput:
    return BatInput(
        stacked(known, "hist", "hist_rel", "cls", "va", "lane"),
        stacked(known, "nbrs", "feat_self", "nbrscls", "nbrsva", "nbrslane"),
        golden_neighbours(known),
        stacked(known, "behaviour"),
        scene,
    )


def assert_published(answers: Any, known: Mapping[str, Any], *names: str) -> None:
    """Holds answers against what the authors' code answered."""
    for values, expected in zip(answers, (known[name] for name in names), strict=True):
        assert values.shape == expected.shape
        np.testing.assert_allclose(values.numpy(), expected, rtol=RELATIVE, atol=TOLERANCE)


def test_csp_answers_as_published() -> None:
    known = golden("csp")
    given = NetworkInput(stacked(known, "hist"), stacked(known, "nbrs"), golden_neighbours(known))
    with torch.inference_mode():
        answers = load_weights(Csp(), "csp", weights("csp"))(given)
    assert_published(answers, known, "out_modes", "lat_prob", "lon_prob")


@pytest.mark.parametrize(
    ("model", "network", "inputs", "path"),
    [
        ("stdan", Stdan(), stdan_input, "pred"),
        ("bat", Bat(), lambda known: bat_input(known, torch.zeros(24, dtype=torch.long)), "out_modes"),
    ],
    ids=["stdan", "bat, where the batch is one scene"],
)
def test_stdan_and_bat_answer_as_published(model, network, inputs, path) -> None:
    known = golden(model)
    load_weights(network, model, weights(model))
    with torch.inference_mode():
        answers = *network(inputs(known)), network.gd(inputs(known))
    assert_published(answers, known, path, "lat_prob", "lon_prob", "encoded")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "weights.pt"


def equal(first: Any, second: Any) -> bool:
    pairs = zip(first.state_dict().values(), second.state_dict().values(), strict=True)
    return all(torch.equal(*pair) for pair in pairs)


def assert_refused(path: Path | None, match: str = "checkpoint") -> None:
    with pytest.raises(InputError, match=match):
        load_weights(Csp(), "csp", path)


def test_weights_are_loaded_by_their_names(path) -> None:
    saved, network = Csp(), Csp()
    torch.save(saved.state_dict(), path)
    assert not equal(saved, network)
    load_weights(network, "csp", path)
    assert equal(saved, network)
    assert not network.training


def test_other_layouts_of_published_files(path, tmp_path) -> None:
    csp, network = Csp(), Csp()
    renamed = {name.replace("conv_3x1.", "soc_conv_3x1."): value for name, value in csp.state_dict().items()}
    torch.save({"epoch": 3, "state_dict": renamed, "optim_dict": {}}, path)
    load_weights(network, "csp", path)
    assert equal(csp, network)

    stdan, parts, pair = Stdan(), Stdan(), Stdan()
    torch.save({"gd": stdan.gd.state_dict(), "g": stdan.g.state_dict()}, path)
    load_weights(parts, "stdan", path)
    assert equal(stdan, parts)
    torch.save(stdan.gd.state_dict(), tmp_path / "epoch9_gd.tar")
    torch.save(stdan.g.state_dict(), tmp_path / "epoch9_g.tar")
    for name in ("epoch9_gd.tar", "epoch9_g.tar"):
        load_weights(pair, "stdan", tmp_path / name)
        assert equal(stdan, pair)


def test_one_half_of_a_pair_is_not_enough(tmp_path) -> None:
    torch.save(Stdan().gd.state_dict(), tmp_path / "epoch9_gd.tar")
    with pytest.raises(InputError, match=r"epoch9_g\.tar.*can be read"):
        load_weights(Stdan(), "stdan", tmp_path / "epoch9_gd.tar")


def test_missing_unknown_and_reshaped_weights_are_counted(path) -> None:
    content = dict(Csp().state_dict())
    del content["op_lat.weight"], content["op_lat.bias"]
    content["op.weight"] = torch.zeros(2, 128)
    content["other"] = torch.zeros(1)
    torch.save(content, path)
    assert_refused(path, r"weights of csp \(2 of 22 missing, first op_lat\.weight.*1 unknown, first other")
    assert_refused(path, r"1 of another shape, first op\.weight: \(2, 128\) instead of \(5, 128\)")


@pytest.mark.parametrize(("other", "network"), [(Csp, Stdan), (Stdan, Bat), (Bat, Csp)])
def test_the_weights_of_another_model_are_refused(other, network, path) -> None:
    torch.save(other().state_dict(), path)
    before, untouched = network(), network()
    untouched.load_state_dict(before.state_dict())
    with pytest.raises(InputError, match="weights of it"):
        load_weights(before, "it", path)
    assert equal(before, untouched)


def test_weights_that_are_not_finite_are_refused(path) -> None:
    content = Csp().state_dict()
    content["op.weight"][1, 2] = float("inf")
    content["op.bias"][2] = float("nan")
    torch.save(content, path)
    assert_refused(path, r"2 of 22 are not, first op\.weight")


@pytest.mark.parametrize(
    ("network", "shapes"),
    [
        (Stdan, {"gd.fc.weight": (64, 128), "g.Decoder.lat_linear.weight": (8, 3), "g.Decoder.lon_linear.bias": (8,)}),
        (Bat, {"gd.qff.weight": (192, 64), "gd.second_glu.gated_layer.weight": (64, 192), "gd.fc.weight": (64, 128)}),
        (Bat, {"gd.addAndNorm.normalize.weight": (64,), "gd.kt.bias": (192,), "g.manmapping": (16, 1)}),
    ],
)
def test_weights_that_are_not_used_have_the_shapes_of_the_published_ones(network, shapes) -> None:
    """Without them the authors' files would be refused."""
    content = network().state_dict()
    assert {name: tuple(content[name].shape) for name in shapes} == shapes


class _Touching:
    """Unpickling it makes a file."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.file,)


@pytest.mark.parametrize("protocol", [None, 0, 4])
def test_code_in_a_checkpoint_is_refused_and_does_not_run(protocol, path, tmp_path) -> None:
    file = tmp_path / "file"
    content = {**Csp().state_dict(), "trap": _Touching(file)}
    if protocol is None:
        torch.save(content, path)
    else:
        path.write_bytes(pickle.dumps(content, protocol))
    assert_refused(path)
    assert not file.exists()


@pytest.mark.parametrize(
    "content",
    [
        *(b"", b"x", b"PK\x03\x04" + bytes(40), b"\x80\x02" + b"\xff" * 30, b"{}", b"\x00" * 512),
        *([1, 2], torch.zeros(3), {"op.weight": 3}, {1: torch.zeros(2)}, {"state_dict": 5}),
    ],
)
def test_other_files_are_refused(content, path) -> None:
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        torch.save(content, path)
    assert_refused(path)


def test_a_damaged_file_and_none_are_refused(path, tmp_path) -> None:
    torch.save(Csp().state_dict(), path)
    whole = path.read_bytes()
    for end in (100, len(whole) // 2, len(whole) - 10):
        path.write_bytes(whole[:end])
        assert_refused(path)
    assert_refused(None, r"csp=PATH of its weights")
    for place in (tmp_path / "nothing.pt", tmp_path):
        assert_refused(place, "a file that can be read")
