import pickle
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.published.networks import Bat, Csp, Stdan
from siren_ros.scoring.evaluation.prediction.published.predictors import load_weights


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "weights.pt"


def equal(first: Any, second: Any) -> bool:
    pairs = zip(first.state_dict().values(), second.state_dict().values(), strict=True)
    return all(torch.equal(*pair) for pair in pairs)


def assert_refused(path: Path, match: str = "checkpoint") -> None:
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


@pytest.mark.parametrize("protocol", [None, 0, 2, 4])
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
    "content", [b"", b"x", b"PK\x03\x04" + bytes(40), b"\x80\x02" + b"\xff" * 30, b"{}", b"\x00" * 512]
)
def test_other_files_are_refused(content, path) -> None:
    path.write_bytes(content)
    assert_refused(path)


def test_a_damaged_file_is_refused(path) -> None:
    torch.save(Csp().state_dict(), path)
    whole = path.read_bytes()
    for end in (100, len(whole) // 2, len(whole) - 10):
        path.write_bytes(whole[:end])
        assert_refused(path)


@pytest.mark.parametrize("content", [[1, 2], torch.zeros(3), {"op.weight": 3}, {1: torch.zeros(2)}, {"state_dict": 5}])
def test_files_of_torch_with_something_else_are_refused(content, path) -> None:
    torch.save(content, path)
    assert_refused(path)


def test_a_file_that_is_not_there_is_refused(tmp_path) -> None:
    for place in (tmp_path / "nothing.pt", tmp_path):
        assert_refused(place, "a file that can be read")
