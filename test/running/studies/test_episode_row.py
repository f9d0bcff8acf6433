from dataclasses import fields

import pytest

from siren_ros.errors import InputError
from siren_ros.running.studies.episode_row import SCHEMA, EpisodeRow, Status, manifest_bytes, rows_of_manifest
from siren_ros.running.studies.matrix import PlannedEpisode
from siren_ros.simulation.scenario.episode import EpisodeRequest

DRAWN = EpisodeRequest("S1", "L3", 5, values="emv.speed_mps=12.0")
PLANNED = PlannedEpisode("S1_L3_seed4", "S1_L3", EpisodeRequest("S1", "L3", 4), -1, "ab" * 32)
_TRIED = {"attempts": 2, "retry_reasons": ("its process was killed by SIGKILL",), "versions": {"siren_ros": "0.1.0"}}
_RESULT = {"steps": 800, "simulated_s": 40.0, "predicate_holds": False, "measures": '{"collisions":0}'}
ROWS = (
    EpisodeRow.planned(PLANNED, Status.REFUSED, "no site"),
    EpisodeRow.planned(
        PlannedEpisode("S1_L3_seed5", "S1_L3", DRAWN, 3, "cd" * 32), Status.COMPLETE, **_TRIED, **_RESULT
    ),
)


def test_the_table_keeps_every_row_to_the_last_bit() -> None:
    assert rows_of_manifest(manifest_bytes(reversed(ROWS))) == ROWS
    assert manifest_bytes(ROWS) == manifest_bytes(reversed(ROWS))


def test_the_table_has_a_column_for_every_field() -> None:
    assert {field.name for field in fields(EpisodeRow)} == set(SCHEMA.names)


def test_rows_are_json_too() -> None:
    for row in ROWS:
        assert EpisodeRow.from_json(row.to_json()) == row
    assert EpisodeRow.from_json({**ROWS[0].to_json(), "new_column": 3}) == ROWS[0]


def test_what_is_no_table_is_refused() -> None:
    with pytest.raises(InputError, match="table"):
        rows_of_manifest(b"PAR1, or not")
    with pytest.raises(InputError, match="row"):
        EpisodeRow.from_json({"episode": "x"})
