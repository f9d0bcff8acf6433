"""Writes measured figures and generated tables into the documents: ``./env python tools/write_documents.py``.

It takes figures from ``docs/results.json`` and tables from the code, and names each document that it changes.
``siren reproduce`` calls it at its end. With ``--release`` it first records how large the wings of the library are.
"""

import sys
from pathlib import Path

from docsite.code_tables import TABLES
from docsite.documents import documents_of, rewrite
from docsite.house import record_sizes
from siren_ros.errors import SirenError
from siren_ros.lab.reproduction.results import read_results

REPOSITORY = Path(__file__).resolve().parents[1]


def main() -> str | None:
    """Writes the documents; gives what cannot be written."""
    if sys.argv[1:] == ["--release"]:
        record_sizes(REPOSITORY / "docs" / "sizes.json", REPOSITORY / "siren_ros")
    results = read_results(REPOSITORY / "docs" / "results.json")
    try:
        for document in documents_of(REPOSITORY):
            if rewrite(document, REPOSITORY, results, TABLES):
                print(f"wrote {document.relative_to(REPOSITORY)}")
    except SirenError as error:
        return str(error)
    return None


if __name__ == "__main__":
    sys.exit(main())
