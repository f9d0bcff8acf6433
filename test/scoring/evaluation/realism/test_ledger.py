"""The ledger: its file, intervals of published values, verdicts, and shares of saved time."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.realism.ledger import (
    AGREES,
    CANNOT,
    DIFFERS,
    UNDECIDED,
    LedgerLine,
    compare,
    ledger_table,
    read_ledger,
    unanswered_table,
    verdict_counts,
)
from siren_ros.scoring.evaluation.realism.quantities import SAMPLES, RealismEpisode

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
        ((-9.0, 14.0, 2.0, 9.0, -6.0), UNDECIDED),
    ],
)
def test_verdict_is_that_of_two_intervals(means: tuple[float, ...], verdict: str) -> None:
    (result,) = compare([LINE], gaps(*means))
    assert result.verdict is verdict
    assert result.samples == 10
    assert result.predicted.value == pytest.approx(np.mean(means))


def test_few_episodes_decide_nothing_and_few_samples_answer_nothing() -> None:
    (few,) = compare([LINE], gaps(2.0, 2.1, 1.9))
    assert few.verdict is UNDECIDED
    (none,) = compare([LINE], gaps(2.0))
    assert none.verdict is CANNOT
    assert "2 samples" in none.reason
    with pytest.raises(InputError):
        compare([LINE], [])


def test_only_own_levels_count_and_ordinary_traffic_of_l0_too() -> None:
    others = [episode({"standing_gap_m": [9.0] * 5}, level="L3", own=False)]
    nominal = [episode({"standing_gap_m": [2.0, 2.0]}, level="L0", own=False)]
    own = gaps(2.0, 2.0, 2.0, 2.0)
    (result,) = compare([LINE], [*own, *others, *nominal])
    assert result.samples == 10
    assert result.predicted.value == pytest.approx(2.0)
    hard = replace(LINE, samples="hardest_brake_mps2")
    braking = [episode({"hardest_brake_mps2": [2.0]}) for _ in range(5)]
    (of_emv,) = compare([hard], [*braking, episode({"hardest_brake_mps2": [9.0]}, level="L0", own=False)])
    assert of_emv.predicted.value == pytest.approx(2.0)


def test_saved_time_is_that_against_the_same_episode_at_l0() -> None:
    saved = replace(LINE, samples="time_saved", value=0.3, unit="share", low=0.25, high=0.35)
    own = [episode({"time_to_site_s": [7.0 + 0.1 * seed]}, seed=seed) for seed in range(5)]
    nominal = [episode({"time_to_site_s": [10.0]}, "L0", own=False, seed=seed) for seed in (3, 1, 0, 2, 4)]
    (result,) = compare([saved], [*own, *nominal, episode({"time_to_site_s": [1.0]}, seed=9)])
    assert result.samples == 5
    assert result.predicted.value == pytest.approx(0.28)
    assert result.verdict is AGREES


def test_rare_events_have_wilsons_interval_over_episodes() -> None:
    rare = replace(LINE, samples="emv_contact", statistic="share", unit="share", value=0.0005, low=0.0004, high=0.0006)
    (result,) = compare([rare], [episode({"emv_contact": [0.0]}) for _ in range(20)])
    assert result.predicted.high == pytest.approx(0.161, abs=0.001)
    assert result.verdict is UNDECIDED
    (many,) = compare([rare], [episode({"emv_contact": [float(number < 10)]}) for number in range(20)])
    assert many.verdict is DIFFERS


def test_tables_hold_every_line_once() -> None:
    lines = (LINE, replace(LINE, line_id="X2", samples="", cannot="nobody counts them"))
    results = compare(lines, gaps(1.9, 2.0, 2.1, 2.0, 1.95))
    assert [row[0] for row in ledger_table(results).rows] == ["X1"]
    assert [(row[0], row[-1]) for row in unanswered_table(results).rows] == [("X2", "nobody counts them")]
    assert verdict_counts(results)[AGREES] == verdict_counts(results)[CANNOT] == 1
