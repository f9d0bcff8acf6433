"""Files of an earlier run, which may be of somebody else."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.lab.training.data_files import read_arrays, write_arrays


def test_what_was_written_is_read(tmp_path: Path) -> None:
    write_arrays(tmp_path / "new" / "a.npz", {"about": np.array('{"seed": 1}'), "values": np.arange(3)})
    about, arrays = read_arrays(tmp_path / "new" / "a.npz", "about")
    assert about == {"seed": 1}
    assert {name: values.tolist() for name, values in arrays.items()} == {"values": [0, 1, 2]}


@pytest.mark.parametrize(
    "arrays",
    [{"about": np.array("[" * 200_000)}, {"about": np.array([print], dtype=object)}, {"other": np.zeros(1)}],
    ids=["deep", "objects", "no head"],
)
def test_other_files_are_refused(tmp_path: Path, arrays: dict[str, Any]) -> None:
    write_arrays(tmp_path / "a.npz", arrays)
    with pytest.raises(InputError, match="a file of an earlier run"):
        read_arrays(tmp_path / "a.npz", "about")
