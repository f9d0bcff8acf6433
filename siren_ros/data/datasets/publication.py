"""Prepares a dataset for publication: Croissant metadata with the hash of every file, a datasheet, a check of copies.

Croissant is MLCommons' format for metadata of datasets (https://docs.mlcommons.org/croissant/docs/croissant-spec.html,
version 1.1). Data catalogues and loaders read it; the hashes in it are those that a check of a copy uses.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.base.params import plain_files
from siren_ros.base.params.plain_files import sha256_of_file
from siren_ros.data.episode_source import LICENCE, LICENCE_URL
from siren_ros.errors import InputError, write_text, writing

CROISSANT_FILE: Final = "croissant.json"
CARD_FILE: Final = "dataset.json"
README_FILE: Final = "README.md"
_SPECIFICATION: Final = "http://mlcommons.org/croissant/1.1"
_CONTEXT: Final = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "name": {"@container": "@language"},
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
_MEDIA_TYPES: Final = {
    ".csv": "text/csv",
    ".json": "application/json",
    ".md": "text/markdown",
    ".mp4": "video/mp4",
    ".parquet": "application/x-parquet",
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".txt": "text/plain",
    ".xml": "application/xml",
}
_CITE_AS: Final = (
    "Y. Zhu, T. Zhao, H. Leng, F. Zuo, T. Li, Z. Bian: SIREN-Bench: Behavior-Driven Generation and Evaluation of "
    "Emergency-Vehicle Interactions, 2026"
)
_NOT_DATA: Final = frozenset({"search", "replies", CROISSANT_FILE})
"""Names at the top of a folder that are not data: the journal of a search, a model's replies, the metadata itself."""


@dataclass(frozen=True)
class DatasetFile:
    """A file of a dataset."""

    path: str
    """Path below the dataset's folder, with slashes."""
    size: int
    sha256: str


def files_of(folder: Path) -> Iterator[DatasetFile]:
    """The files of a dataset in the order of their paths, without hidden ones; OSError where one cannot be read."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if path.is_file() and parts[0] not in _NOT_DATA and not any(part.startswith(".") for part in parts):
            yield DatasetFile("/".join(parts), path.stat().st_size, sha256_of_file(path))


def croissant(folder: Path, content: Mapping[str, Any], version: str) -> dict[str, Any]:
    """Croissant metadata of a dataset whose files are complete.

    Args:
        folder: The dataset's folder.
        content: Its card (``dataset.json``): ``name``, ``what``, ``licence``, and where it has them ``episodes``.
        version: Version of SIREN.

    Raises:
        OSError: A file cannot be read.
    """
    files = list(files_of(folder))
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": _SPECIFICATION,
        "name": content["name"],
        "description": f"{content['what']}. {ORIGIN}",
        "license": LICENCE_URL if content["licence"] == LICENCE else content["licence"],
        "citeAs": _CITE_AS,
        "creator": {"@type": "sc:Organization", "name": "SIREN maintainers"},
        "version": version,
        "isLiveDataset": False,
        "distribution": [
            {
                "@type": "cr:FileObject",
                "@id": file.path,
                "name": file.path,
                "contentUrl": file.path,
                "contentSize": f"{file.size} B",
                "encodingFormat": _MEDIA_TYPES.get(Path(file.path).suffix, "application/octet-stream"),
                "sha256": file.sha256,
            }
            for file in files
        ],
        "recordSet": [
            *_episode_records(content.get("episodes", ())),
            *(
                _table_records(file.path, pq.read_schema(folder / file.path))
                for file in files
                if "/" not in file.path and file.path.endswith(".parquet")
            ),
        ],
    }


_EPISODE_TYPES: Final = {"seed": "sc:Integer", "planned_duration_s": "sc:Float"}


def _episode_records(episodes: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """The episodes of a card as a Croissant table."""
    if not episodes:
        return
    names = [name for name, value in episodes[0].items() if isinstance(value, str | int | float)]
    yield {
        "@type": "cr:RecordSet",
        "@id": "episodes",
        "name": "episodes",
        "description": "The episodes of the dataset, as its card has them.",
        "key": {"@id": "episodes/id"},
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"episodes/{name}",
                "name": name,
                "dataType": _EPISODE_TYPES.get(name, "sc:Text"),
                "source": {"fileObject": {"@id": CARD_FILE}, "extract": {"jsonPath": f"$.episodes[*].{name}"}},
            }
            for name in names
        ],
    }


def _table_records(path: str, schema: pa.Schema) -> dict[str, Any]:
    """A Parquet file as a Croissant table; arrays get their shapes where the file states them."""
    fields = []
    for column in schema:
        about = plain_files.load_json((column.metadata or {}).get(b"siren", b"{}"))
        shape = about.get("shape", [-1] if pa.types.is_list(column.type) else [])
        field: dict[str, Any] = {
            "@type": "cr:Field",
            "@id": f"{path}/{column.name}",
            "name": column.name,
            "description": about.get("meaning", column.name),
            "dataType": _data_type(column.type),
            "source": {"fileObject": {"@id": path}, "extract": {"column": column.name}},
        }
        if shape:
            field |= {"isArray": True, "arrayShape": ",".join(map(str, shape))}
        fields.append(field)
    name = Path(path).stem
    return {"@type": "cr:RecordSet", "@id": path.replace(".", "_"), "name": name, "field": fields}


def _data_type(kind: pa.DataType) -> str:
    flat = kind.value_type if pa.types.is_list(kind) else kind
    if pa.types.is_boolean(flat):
        return "sc:Boolean"
    if pa.types.is_integer(flat):
        return "sc:Integer"
    return "sc:Float" if pa.types.is_floating(flat) else "sc:Text"


ORIGIN: Final = (
    "The episodes are recorded simulations of an emergency vehicle in traffic, not measurements of real traffic."
)


def datasheet(content: Mapping[str, Any]) -> str:
    """A datasheet: questions and answers about a dataset (T. Gebru et al., Datasheets for Datasets, Commun.

    ACM 64 (2021) 86).
    """
    maps = sorted({(str(item["map"]), str(item["map_licence"])) for item in content.get("episodes", (content,))})
    answers = {
        "Why was it made?": "To measure perception, prediction and risk understanding around emergency vehicles, and "
        "to train models for it.",
        "What is in it?": f"{content['what']}. {ORIGIN}",
        "Does it have data of people?": "No. Pedestrians, cyclists and drivers are simulated; there are no names, "
        "faces, number plates or recordings of real places.",
        "How was it collected?": "SIREN simulated each episode from its seed and recorded it. The card has the command "
        "and the versions that make it again.",
        "How was it labelled?": "By the simulator's state; nobody labelled anything by hand.",
        "What is it not for?": "Claims about the frequency of accidents or the behaviour of real drivers: behaviour is "
        "a model. A model that is trained on it alone is not fit for a real vehicle.",
        "Under which licence?": f"{content['licence']}.",
        "Which maps does it show?": "; ".join(f"{name}: {licence}" for name, licence in maps),
        "How is a copy checked?": f"`siren check DIR` compares its files with the hashes in `{CROISSANT_FILE}`.",
        "Who maintains it?": "Whoever published it; defects of the generator belong to the project SIREN.",
    }
    return "\n\n".join(["## Datasheet", *(f"**{question}** {answer}" for question, answer in answers.items())])


def write_croissant(folder: Path, content: Mapping[str, Any], version: str) -> None:
    """Write ``croissant.json`` after all other files; InputError if the folder cannot be used."""
    with writing(folder, "folder"):
        metadata = croissant(folder, content, version)
    write_text(folder / CROISSANT_FILE, json.dumps(metadata, indent=1, ensure_ascii=False) + "\n")


@dataclass(frozen=True)
class CopyCheck:
    """Differences between a copy of a dataset and its metadata."""

    files: int
    """Number of files that the metadata names."""
    missing: tuple[str, ...]
    changed: tuple[str, ...]
    further: tuple[str, ...]
    """Files that the metadata does not name."""

    @property
    def is_whole(self) -> bool:
        """Whether every named file is present and unchanged; further files do not matter."""
        return not self.missing and not self.changed


def check_copy(folder: Path) -> CopyCheck:
    """Compares the files of a dataset with the sizes and hashes of its metadata.

    Raises:
        InputError: No metadata of a dataset in the folder, or a file that cannot be read.
    """
    allowed = f"a folder with the {CROISSANT_FILE} of a dataset"
    try:
        metadata = plain_files.read_json(folder / CROISSANT_FILE)
        stated = {
            str(file["contentUrl"]): (int(str(file["contentSize"]).removesuffix(" B")), str(file["sha256"]))
            for file in metadata["distribution"]
        }
        there = {file.path: (file.size, file.sha256) for file in files_of(folder)}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError("dataset", str(folder), f"{allowed} ({error})") from error
    return CopyCheck(
        len(stated),
        tuple(sorted(stated.keys() - there.keys())),
        tuple(sorted(path for path, state in there.items() if path in stated and stated[path] != state)),
        tuple(sorted(there.keys() - stated.keys())),
    )
