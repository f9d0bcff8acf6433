"""The page of the project's own message types: the definitions, as ROS reads them."""

from pathlib import Path
from typing import Final

_INTRODUCTION: Final = """# Message types

The package `siren_msgs`. `./env ros2 interface show siren_msgs/msg/StepDone` prints one of them. The packages of all
other types are ROS's own.
"""


def message_page(folder: Path) -> str:
    """The page as Markdown, with a heading for each type.

    Args:
        folder: The folder of the ``.msg`` files.
    """
    return "\n".join(
        [
            _INTRODUCTION,
            *(
                f"## `siren_msgs/{path.stem}`\n\n```text\n{path.read_text(encoding='utf-8').strip()}\n```\n"
                for path in sorted(folder.glob("*.msg"))
            ),
        ]
    )
