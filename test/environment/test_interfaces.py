"""The message packages that are built here are, to other ROS machines, the published ones."""

import json
import os
import sys
from pathlib import Path

import pytest

# Type hashes (REP 2016) of ROS 2 Jazzy's packages; two machines talk only where these are equal.
PUBLISHED = {
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "vision_msgs/msg/Classification": "f74db28d0eaef3afb78f48bf2161cd709a1383a0309d3454383b25be11345143",
    "vision_msgs/msg/Detection2DArray": "214274120007f4a683866481336b70310268cfa107aebe9d594a6acf75bda968",
    "vision_msgs/msg/Detection3DArray": "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018",
    "vision_msgs/msg/LabelInfo": "3d37df4015cdf660cc851c51897f2acd957e1ca6205ba0a99aebffb9406b0783",
    "vision_msgs/msg/VisionInfo": "95d3116a17484ad91c9a2686e1d54890bbfc3ff6c6a2de137738c4950d45d284",
}


@pytest.mark.parametrize("type_name", PUBLISHED)
def test_type_hash_is_the_published_one(type_name: str) -> None:
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    descriptions = [Path(prefix) / "share" / f"{type_name}.json" for prefix in prefixes if prefix]
    present = [path for path in descriptions if path.is_file()]
    assert present, f"{type_name} is not installed"
    hashes = {entry["type_name"]: entry["hash_string"] for entry in json.loads(present[0].read_text())["type_hashes"]}
    assert hashes[type_name] == f"RIHS01_{PUBLISHED[type_name]}"
