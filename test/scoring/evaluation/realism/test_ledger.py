"""The ledger: its file, intervals of published values, verdicts, and shares of saved time."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from busy_record import busy_record, driven, turned
from known_outputs import assert_known

from siren_ros.base.tables import text_of
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.realism.distributions import (
    distribution_table,
    distributions,
    distributions_as_json,
    samples_of_tracks,
)
from siren_ros.scoring.evaluation.realism.ledger import (
    AGREES,
    CANNOT,
    DIFFERS,
    UNDECIDED,
    LedgerLine,
    compare,
    ledger_table,
    read_ledger,
    shown_value,
    sources_table,
    unanswered_table,
    verdict_counts,
)
from siren_ros.scoring.evaluation.realism.quantities import SAMPLES, RealismEpisode
from siren_ros.scoring.evaluation.realism.road_tracks import RoadTracks

LINE = LedgerLine("X1", "a gap", 2.0, "m", 10, 1.5, 2.5, "here", 2020, "somebody", "abstract", "standing_gap_m", "mean")


def episode(values: dict[str, list[float]], level: str = "L1", own: bool = True, seed: int = 0) -> RealismEpisode:
    samples = {name: np.array(values.get(name, [])) for name in SAMPLES}
    return RealismEpisode(level, own, ("S3", "town", str(seed), ""), samples)


def gaps(*of_episodes: float) -> list[RealismEpisode]:
    return [episode({"standing_gap_m": [gap - 0.1, gap + 0.1]}) for gap in of_episodes]


def test_shipped_ledger_answers_25_lines_and_gives_every_line_a_source_or_a_reason() -> None:
    lines = read_ledger()
    assert len({line.line_id for line in lines}) == len(lines)
    assert sum(not line.cannot for line in lines) >= 25
    for line in lines:
        assert bool(line.samples) != bool(line.cannot), line
        assert line.low <= line.value <= line.high
        assert line.source
        assert line.about
    by_id = {line.line_id: line for line in lines}
    assert (by_id["C06"].low, by_id["C06"].high) == pytest.approx((0.541, 0.675), abs=0.001), "Wilson's interval"
    assert (by_id["Y05"].low, by_id["Y05"].high) == pytest.approx((2.72, 4.08)), "a fifth to each side"


@pytest.mark.parametrize(
    ("means", "verdict"),
    [
        ((1.9, 2.0, 2.1, 2.0, 1.95), AGREES),
        ((2.45, 2.55, 2.5, 2.6, 2.65), AGREES),
        ((3.9, 4.0, 4.1, 4.0, 3.95), DIFFERS),
        ((0.1, 0.2, 0.3, 0.2, 0.25), DIFFERS),
        ((-0.19, 2.0, 4.19, 2.0, 2.0), AGREES),  # 3.85 m wide
        ((-0.35, 2.0, 4.35, 2.0, 2.0), UNDECIDED),  # 4.13 m
        ((2.0, 2.1, 1.9), UNDECIDED),
    ],
)
def test_verdict_is_that_of_two_intervals(means: tuple[float, ...], verdict: str) -> None:
    (result,) = compare([LINE], gaps(*means))
    assert result.verdict is verdict
    assert result.samples == 2 * len(means)
    assert result.predicted.value == pytest.approx(np.mean(means))


def study() -> list[RealismEpisode]:
    """Five seeds at the level of the template, one of them at L3 too, all at L0 in another order; one without L0."""
    moved = [
        {
            "standing_gap_m": [1.7 + 0.1 * seed, 1.9 + 0.1 * seed],
            "hardest_brake_mps2": [2.0 + 0.2 * seed],
            "time_to_site_s": [7.0 + 0.1 * seed],
            "emv_contact": [float(seed == 0)],
            "moved": [1.0],
            "wake_share": [1.0] * (seed < 4),
        }
        for seed in range(5)
    ]
    slow = {"time_to_site_s": [10.0], "hardest_brake_mps2": [9.0]}
    own = [episode(values, seed=seed) for seed, values in enumerate(moved)]
    nominal = [
        episode(slow | {"standing_gap_m": [2.0] * 2 * (seed == 3)}, "L0", False, seed) for seed in (3, 1, 0, 2, 4)
    ]
    alone = replace(episode({"time_to_site_s": [1.0]}, seed=9), fitted_to=("X1", "X2"))
    return [*own, *nominal, episode({"standing_gap_m": [9.0] * 5}, "L3", own=False), alone]


def test_a_study_has_the_intervals_and_verdicts_that_are_worked_out_by_hand() -> None:
    """Of a mean the interval is Student's over episodes, of a share Wilson's; L0 counts for gaps and saved time."""
    share = replace(LINE, unit="share", value=0.5, low=0.4, high=0.6)
    lines = (
        replace(LINE, count=1234),
        replace(LINE, line_id="X2", value=1.0, low=0.9, high=1.1, count=0, year=0),
        replace(LINE, line_id="X3", samples="hardest_brake_mps2", value=0.0005, low=0.0004, high=0.0006),
        replace(share, line_id="X4", samples="time_saved", value=0.3, low=0.25, high=0.35),
        replace(share, line_id="X5", samples="emv_contact", statistic="share"),
        replace(LINE, line_id="X6", samples="", cannot="nobody counts them"),
        replace(share, line_id="X7", samples="wake_share"),
        replace(share, line_id="X8", samples="moved", value=0.9, low=0.8, high=1.0),
    )
    results = compare(lines, study())
    here, gap = "here, 2020; n = 10", "2.00 [1.85, 2.15]"
    assert ledger_table(results).rows == (
        ("X1", "a gap", "m", "2.00 [1.50, 2.50]", gap, "agrees (fitted)", 12, "here, 2020; n = 1,234"),
        ("X2", "a gap", "m", "1.00 [0.90, 1.10]", gap, "differs by +1.00 (fitted)", 12, "here; n not given"),
        ("X3", "a gap", "m", "0.00050 [0.00040, 0.00060]", "2.40 [2.01, 2.79]", "differs by +2.40", 5, here),
        ("X4", "a gap", "share", "0.30 [0.25, 0.35]", "0.28 [0.26, 0.30]", "agrees", 5, here),
        ("X5", "a gap", "share", "0.50 [0.40, 0.60]", "0.20 [0.036, 0.62]", "agrees", 5, here),
        ("X8", "a gap", "share", "0.90 [0.80, 1.00]", "1.00 [0.57, 1.00]", "agrees", 5, here),
    )
    few = "4 samples; it takes more episodes"
    unanswered = (("X6", "a gap", "2.00 m", "nobody counts them"), ("X7", "a gap", "0.50 share", few))
    assert unanswered_table(results).rows == unanswered
    assert sources_table(results).rows == tuple((line.line_id, "somebody", "abstract") for line in lines)
    assert verdict_counts(results) == {AGREES: 4, DIFFERS: 2, UNDECIDED: 0, CANNOT: 2}
    (without_l0,) = compare([lines[3]], study()[:5])
    assert without_l0.reason == "0 samples; it takes episodes at L0 and at the template's own level"
    (single,) = compare([LINE], [episode({"standing_gap_m": [2.0] * 5})])
    assert ledger_table([single]).rows[0][4:6] == ("2.00 [–]", UNDECIDED)
    with pytest.raises(InputError):
        compare([LINE], [])


def test_each_statistic_is_that_of_all_samples() -> None:
    episodes = [episode({"following_gap_m": [float(2 * k), 2.0 * k + 1.0]}) for k in (3, 0, 1, 4, 2)]
    episodes.append(episode({"following_gap_m": [21.0]}))
    expected = {"mean": 6.0, "median": 5.0, "sd": 33.0**0.5, "p10": 1.0, "p50": 5.0, "p90": 9.0, "p95": 15.0}
    lines = [replace(LINE, samples="following_gap_m", statistic=name) for name in expected]
    assert [one.predicted.value for one in compare(lines, episodes)] == pytest.approx([*expected.values()])
    assert [shown_value(line, episodes) for line in lines] == pytest.approx([*expected.values()])


def test_a_line_of_one_kind_of_road_is_compared_with_episodes_there() -> None:
    slow, fast = gaps(2.0, 2.0, 2.0), [replace(one, road="motorway") for one in gaps(4.0, 4.0, 4.0)]
    lines = [replace(LINE, road=road) for road in ("street", "motorway", "")]
    assert [round(one.predicted.value, 6) for one in compare(lines, [*slow, *fast])] == [2.0, 4.0, 3.0]
    assert [shown_value(line, slow) for line in lines] == pytest.approx([2.0, np.nan, 2.0], nan_ok=True)
    assert {line.road for line in read_ledger()} == {"street", ""}


def test_what_episodes_show_counts_however_little_it_is() -> None:
    single = [episode({"standing_gap_m": [1.5]}), episode({})]
    assert shown_value(LINE, single) == 1.5
    assert compare([LINE], single)[0].verdict == CANNOT
    assert np.isnan(shown_value(LINE, [episode({})]))
    assert np.isnan(shown_value(LINE, []))


def _street() -> RoadTracks:
    """A queue of four cars in each of two lanes stands at a line and discharges, three cars cross behind the line."""
    columns = []
    for number in range(8):
        behind, lane = divmod(number, 2)
        arc_m = driven(-6.3 * behind - 0.4 * lane, (9.0, 0.0), (-1.8, 5.0), (0.0, 1.5 + 1.1 * behind), (1.5, 16.0))
        along = arc_m[:, None] * np.array([1.0, 0.0]) + np.array([0.0, 3.4 * lane])
        columns.append((number, along, 0.0, 4.0 + 0.3 * lane))
    for number in range(3):
        arc_m = driven(-60.0 - 25.0 * number, (8.0 + number, 0.0), (0.0, 16.0))
        columns.append((8 + number, np.column_stack((np.full(len(arc_m), 60.0), arc_m)), 0.5 * np.pi, 4.6))
    parts = []
    for key, xy, yaw, length in columns:
        shared = np.tile((0.6 + yaw, length, 1.8), (len(xy), 1))
        parts.append(np.column_stack((np.full(len(xy), key), 0.05 * np.arange(len(xy)), turned(xy), shared)))
    return RoadTracks.of_columns(*np.concatenate(parts).T)


def test_every_sample_and_every_line_of_busy_episodes() -> None:
    """Levels L0 and L1 of an episode for each of its EMVs, and more seeds, whose samples are a little larger."""
    episodes = [RealismEpisode.of(record) for level in ("L0", "L1") for record in busy_record(level=level).by_emv()]
    real = samples_of_tracks(_street()), samples_of_tracks(RoadTracks.of_record(busy_record()))
    more = [
        replace(
            one,
            situation=("S3", "town", str(seed), ""),
            samples={
                name: np.append(values, real[0].get(name, ())) * (1.0 + 0.01 * seed)
                for name, values in one.samples.items()
            },
        )
        for one in episodes
        for seed in range(3 * (one is not episodes[2]))
    ]
    found, results = distributions(more, real), compare(read_ledger(), more)
    known = {
        "samples": [{name: values for name, values in one.samples.items() if len(values)} for one in episodes[3:]],
        "street": {name: values[:: max(len(values) // 8, 1)] for name, values in real[0].items()},
        "lines": {one.line.line_id: (*vars(one.predicted).values(), one.samples) for one in results if one.answered},
        "counts": verdict_counts(results),
        "distributions": [list(_values_in(row)) for row in distributions_as_json(found)],
        "tables": text_of([ledger_table(results), distribution_table(found)]),
    }
    assert_known(Path(__file__).parent / "known" / "realism.json", known, digits=5)


def _values_in(row: dict[str, Any]) -> Iterator[Any]:
    for value in row.values():
        yield from _values_in(value) if isinstance(value, dict) else (value,)
