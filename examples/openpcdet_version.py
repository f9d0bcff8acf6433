"""Lets a checkout of OpenPCDet read the dataset of ``siren export nuscenes``, whose version is ``v1.0-siren``.

    cd OpenPCDet && python …/examples/openpcdet_version.py

OpenPCDet knows the versions of nuScenes alone. Three places of its nuScenes dataset change: the version is accepted,
its scenes are those of ``splits.json``, and a test run ends after it has written the results, because nuscenes-devkit
has no split of that name (``siren evaluate detection`` scores them). A second run changes nothing.
"""

import sys
from pathlib import Path

DATASET = Path("pcdet/datasets/nuscenes/nuscenes_dataset.py")
SCENES = """        import json
        names = json.loads((data_path / version / 'splits.json').read_text())
        train_scenes, val_scenes = names['siren_train'], names['siren_val']
"""
CHANGES = (
    ("'v1.0-test', 'v1.0-mini']", "'v1.0-test', 'v1.0-mini', 'v1.0-siren']"),
    ("        raise NotImplementedError\n", SCENES),
    ("VERSION == 'v1.0-test':", "VERSION in ('v1.0-test', 'v1.0-siren'):"),
)


def changed(text: str) -> str:
    """The dataset's code with the changes; ValueError where a place is not there once."""
    for old, new in CHANGES:
        if new in text:
            continue
        if text.count(old) != 1:
            raise ValueError(
                f"{DATASET}: {text.count(old)} lines with {old.strip()!r} instead of one; change it by hand"
            )
        text = text.replace(old, new)
    return text


if __name__ == "__main__":
    try:
        DATASET.write_text(changed(DATASET.read_text(encoding="utf-8")), encoding="utf-8")
    except (OSError, ValueError) as error:
        sys.exit(f"openpcdet_version: {error}")
    print(f"{DATASET} reads v1.0-siren")
