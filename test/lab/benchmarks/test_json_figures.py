import argparse
import json
import math
from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.lab.benchmarks.json_figures import add_json, write_json


def test_figures_are_written_where_the_option_is_given(tmp_path: Path) -> None:
    line = argparse.ArgumentParser()
    add_json(line)
    write_json(line.parse_args([]).json, {"a": 1})
    write_json(line.parse_args(["--json", str(tmp_path / "a.json")]).json, {"a": [1.5, math.nan, (math.inf, "x")]})
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == {"a": [1.5, None, [None, "x"]]}
    with pytest.raises(InputError, match="a file that can be written"):
        write_json(tmp_path / "none" / "a.json", {})
