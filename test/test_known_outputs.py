"""Known outputs: what differs is named, whatever is stored anew is said."""

import enum
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from known_outputs import assert_known

FLAG = enum.Enum("FLAG", "UP DOWN")


@dataclass(frozen=True)
class Result:
    rows: npt.NDArray[np.float64]
    flags: dict[FLAG, bool]
    none: list[float]
    least: float


def _result(row: float = 2.0, *, up: bool = True, none: tuple[float, ...] = ()) -> Result:
    return Result(np.array([[1.0, row], [-0.25, np.nan]]), {FLAG.UP: up, FLAG.DOWN: False}, list(none), 1e-12)


def test_a_whole_result_is_compared_and_what_differs_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "known" / "result.json"
    monkeypatch.setenv("SIREN_WRITE_KNOWN", "1")
    with pytest.raises(pytest.fail.Exception, match="written, look at the change"):
        assert_known(file, _result())
    assert file.read_text() == (
        '{"rows": [[1.0, 2.0], [-0.25, "nan"]], "flags": {"UP": true, "DOWN": false}, "none": [], "least": 0.0}\n'
    )

    monkeypatch.delenv("SIREN_WRITE_KNOWN")
    assert_known(file, _result(2.000009), digits=6)
    for other, message in (
        (_result(2.00003), r"1 of 8 values differ.*\n  rows\[0\]\[1\]: was 2.0, is 2.00003$"),
        (_result(up=False), r"flags.UP: was True, is False$"),
        (_result(none=(3.0,)), r"2 of 8 .*\n  none: was \[\], is nothing\n  none\[0\]: was nothing, is 3.0$"),
        (_result(np.inf), r"rows\[0\]\[1\]: was 2.0, is inf$"),
    ):
        with pytest.raises(pytest.fail.Exception, match=message):
            assert_known(file, other)
    assert_known(file, _result(2.09), digits=2)
    assert_known(file, _result(2.09), decimals=1)
