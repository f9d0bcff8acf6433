"""Drops include folders that do not exist from the CMake files that the ROS wheels install.

The wheels' exported targets name the Python and numpy headers of the machine that they were built on, and CMake refuses
a target whose include folder is missing. The packages that are built here find Python by themselves. Running this again
changes nothing.

    mend_cmake_exports.py PREFIX
"""

import re
import sys
from pathlib import Path

INCLUDE_DIRS = re.compile(r'(INTERFACE_INCLUDE_DIRECTORIES ")([^"]*)(")')


def without_missing_dirs(text: str) -> str:
    """A CMake export file's text without the absolute include folders that this machine lacks."""

    def keep_existing(match: re.Match[str]) -> str:
        folders = match[2].split(";")
        kept = [folder for folder in folders if not folder.startswith("/") or Path(folder).is_dir()]
        return f"{match[1]}{';'.join(kept)}{match[3]}"

    return INCLUDE_DIRS.sub(keep_existing, text)


def mend(prefix: Path) -> list[Path]:
    """Mends every export file below a prefix; returns the changed ones. A file is replaced in one step."""
    changed = []
    for path in sorted(prefix.glob("share/*/cmake/*.cmake")):
        text = path.read_text(encoding="utf-8")
        mended = without_missing_dirs(text)
        if mended != text:
            temporary = path.with_suffix(".new")
            temporary.write_text(mended, encoding="utf-8")
            temporary.replace(path)
            changed.append(path)
    return changed


if __name__ == "__main__":
    for changed_path in mend(Path(sys.argv[1])):
        sys.stdout.write(f"mended {changed_path}\n")
