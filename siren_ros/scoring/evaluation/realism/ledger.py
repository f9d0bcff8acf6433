"""The ledger of published figures, what a study predicts for each line, and whether the two agree.

A verdict compares two intervals: the published one, and that of the predicted value over episodes (jackknife). They
agree if they overlap. A predicted interval much wider than the published value tells nothing: such a line is undecided.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFiles, StrictMapping
from siren_ros.base.tables import NOTHING, Interval, Row, Table, share_interval
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.realism.quantities import (
    MEAN,
    MEDIAN,
    ORDINARY,
    ROADS,
    SAMPLES,
    SPREAD,
    RealismEpisode,
    Statistic,
    percentile,
)
from siren_ros.scoring.evaluation.statistics import jackknife

TIME_SAVED: Final = "time_saved"
SHARE: Final = "share"
"""The unit of shares, and the statistic of rare ones: Wilson's interval over all samples."""
OTHER_CITY: Final = 0.2
"""Half the width of the interval of a published value without one, as a share: the scatter of the three published
savings of time about their mean."""
STATISTICS: Final[Mapping[str, Statistic]] = {
    "mean": MEAN,
    SHARE: MEAN,
    "median": MEDIAN,
    "sd": SPREAD,
    **{f"p{share}": percentile(share) for share in (10, 50, 90, 95)},
}
_LEAST_SAMPLES: Final = 5


AGREES: Final = "agrees"
DIFFERS: Final = "differs"
UNDECIDED: Final = "undecided"
"""There is no predicted interval, or it holds the published value and is wider than twice that value."""
CANNOT: Final = "cannot be compared"
VERDICTS: Final = (AGREES, DIFFERS, UNDECIDED, CANNOT)


@dataclass(frozen=True)
class LedgerLine:
    """A published figure."""

    line_id: str
    about: str
    value: float
    unit: str
    count: int
    """Number of observations; 0 where the source gives none."""
    low: float
    high: float
    setting: str
    year: int
    """0 where the source gives none."""
    source: str
    read: str
    """How the source was read: its abstract, a table, the press, a page about it."""
    samples: str = ""
    """Name of the predicted samples; empty where a study cannot answer."""
    statistic: str = "mean"
    cannot: str = ""
    road: str = ""
    """One of ``ROADS`` if it was measured on such roads and drivers do otherwise elsewhere; empty for any."""


@dataclass(frozen=True)
class LedgerResult:
    """A line with its prediction."""

    line: LedgerLine
    predicted: Interval
    samples: int
    """Number of samples of the prediction."""
    verdict: str
    """One of ``VERDICTS``."""
    reason: str = ""
    """Why it cannot be compared."""
    fitted: bool = False
    """Whether the drivers were fitted to this line."""

    @property
    def answered(self) -> bool:
        """Whether the study has a prediction for it."""
        return self.verdict is not CANNOT


def read_ledger(files: InputFiles = FILES_ON_DISK) -> tuple[LedgerLine, ...]:
    """The shipped ledger; InputError names file, line and key of what cannot be read."""
    top = files.read("ledger", "realism", "ledger").mapping()
    lines = tuple(_line(entry) for entry in top.mappings("lines"))
    top.finish()
    return lines


def _line(entry: StrictMapping) -> LedgerLine:
    value, count, unit = entry.number("value", -1e9, 1e9), entry.integer("n", 0, 10**9), entry.text("unit")
    bounds = _bounds(entry, value, count, unit)
    asks = entry.has("samples")
    samples = entry.text("samples", (*SAMPLES, TIME_SAVED)) if asks else ""
    line = LedgerLine(
        entry.text("id"),
        entry.text("about"),
        value,
        unit,
        count,
        *bounds,
        entry.text("setting"),
        entry.integer("year", 0, 2100),
        entry.text("source"),
        entry.text("read"),
        samples,
        entry.text("statistic", STATISTICS) if asks else "mean",
        "" if asks else entry.text("cannot"),
        entry.text("road", ROADS) if entry.has("road") else "",
    )
    entry.finish()
    return line


def _bounds(entry: StrictMapping, value: float, count: int, unit: str) -> tuple[float, float]:
    if entry.has("low"):
        return entry.number("low", -1e9, value), entry.number("high", value, 1e9)
    if unit == SHARE and count:
        known = share_interval(round(value * count), count)
        return min(known.low, value), max(known.high, value)
    return value - OTHER_CITY * abs(value), value + OTHER_CITY * abs(value)


def compare(lines: Sequence[LedgerLine], episodes: Sequence[RealismEpisode]) -> tuple[LedgerResult, ...]:
    """What the episodes predict for each line; all at their own level, and for saved time those at L0 too.

    Raises:
        InputError: There is no episode.
    """
    if not episodes:
        raise InputError("bags", "none", "at least one episode")
    fitted_to = {line for episode in episodes for line in episode.fitted_to}
    results = (_result(line, episodes) for line in lines)
    return tuple(replace(result, fitted=result.line.line_id in fitted_to) for result in results)


def shown_value(line: LedgerLine, episodes: Sequence[RealismEpisode]) -> float:
    """The line's statistic of what the episodes show, however little that is; NaN if they show nothing."""
    blocks = _blocks(line, episodes)
    return float(STATISTICS[line.statistic](np.concatenate(blocks))) if blocks else math.nan


def _blocks(line: LedgerLine, episodes: Sequence[RealismEpisode]) -> list[Floats]:
    """The line's samples of each episode that has any."""
    there = [episode for episode in episodes if line.road in ("", episode.road)]
    own = [episode for episode in there if episode.at_own_level]
    nominal = [episode for episode in there if episode.level == "L0"]
    if line.samples == TIME_SAVED:
        blocks = _time_saved(own, nominal)
    else:
        chosen = [*own, *(one for one in nominal if one not in own)] if line.samples in ORDINARY else own
        blocks = [episode.samples[line.samples] for episode in chosen]
    return [samples for samples in blocks if len(samples)]


def _result(line: LedgerLine, episodes: Sequence[RealismEpisode]) -> LedgerResult:
    if line.cannot:
        return LedgerResult(line, NOTHING, 0, CANNOT, line.cannot)
    blocks = _blocks(line, episodes)
    count = sum(map(len, blocks))
    if count < (1 if line.statistic == SHARE else _LEAST_SAMPLES):
        wanted = "episodes at L0 and at the template's own level" if line.samples == TIME_SAVED else "more episodes"
        return LedgerResult(line, NOTHING, count, CANNOT, f"{count} samples; it takes {wanted}")
    predicted = _interval(line.statistic, blocks)
    return LedgerResult(line, predicted, count, _verdict(line, predicted))


def _interval(statistic: str, blocks: Sequence[Floats]) -> Interval:
    compute = STATISTICS[statistic]
    everything = np.concatenate(blocks)
    if statistic == SHARE or (_is_share(everything) and statistic == "mean" and everything.min() == everything.max()):
        return share_interval(round(float(everything.sum())), len(everything))
    left_out = np.array(
        [
            compute(np.concatenate([*blocks[:number], *blocks[number + 1 :]])) if len(blocks) > 1 else np.nan
            for number in range(len(blocks))
        ]
    )
    return jackknife(compute(everything), left_out, np.zeros(len(blocks), dtype=np.intp)).interval()


def _is_share(values: Floats) -> bool:
    return bool(np.isin(values, (0.0, 1.0)).all())


def _verdict(line: LedgerLine, predicted: Interval) -> str:
    low, high = predicted.low, predicted.high
    overlaps = low <= line.high and high >= line.low
    if not predicted.bounded or (overlaps and high - low > 2.0 * max(abs(line.value), line.high - line.low)):
        return UNDECIDED
    return AGREES if overlaps else DIFFERS


def _time_saved(own: Sequence[RealismEpisode], nominal: Sequence[RealismEpisode]) -> list[Floats]:
    """Share of the time to the site that each episode saves against the same one at L0.

    Where the EMV does not reach the site at L0 before the end, the time up to the end counts: it is understated.
    """
    before = {episode.situation: episode.samples["time_to_site_s"] for episode in nominal}
    pairs = ((before.get(episode.situation), episode.samples["time_to_site_s"]) for episode in own)
    return [1.0 - now / then for then, now in pairs if then is not None and len(then) and len(now)]


def ledger_table(results: Sequence[LedgerResult]) -> Table:
    """All lines that have a prediction."""
    rows: tuple[Row, ...] = tuple(
        (
            result.line.line_id,
            result.line.about,
            result.line.unit,
            f"{_number(result.line.value)} [{_number(result.line.low)}, {_number(result.line.high)}]",
            _text(result.predicted),
            _difference(result),
            result.samples,
            _setting(result.line),
        )
        for result in results
        if result.answered
    )
    head = ("line", "quantity", "unit", "published", "predicted", "verdict", "samples", "setting")
    return Table("ledger", "Published figures, and what the study predicts", head, rows)


def unanswered_table(results: Sequence[LedgerResult]) -> Table:
    """The lines without a prediction, with the reason."""
    rows: tuple[Row, ...] = tuple(
        (one.line.line_id, one.line.about, f"{_number(one.line.value)} {one.line.unit}", one.reason)
        for one in results
        if not one.answered
    )
    return Table("unanswered", "Lines that cannot be compared", ("line", "quantity", "published", "reason"), rows)


def sources_table(results: Sequence[LedgerResult]) -> Table:
    """Where each line comes from, and how its source was read."""
    rows: tuple[Row, ...] = tuple((one.line.line_id, one.line.source, one.line.read) for one in results)
    return Table("sources", "Sources of the published figures", ("line", "source", "read"), rows, folded=True)


def _setting(line: LedgerLine) -> str:
    when = f", {line.year}" if line.year else ""
    return f"{line.setting}{when}; {f'n = {line.count:,}' if line.count else 'n not given'}"


def _difference(result: LedgerResult) -> str:
    fitted = " (fitted)" if result.fitted else ""
    if result.verdict is not DIFFERS:
        return f"{result.verdict}{fitted}"
    return f"differs by {_number(result.predicted.value - result.line.value, '+')}{fitted}"


def _text(interval: Interval) -> str:
    bounds = f"{_number(interval.low)}, {_number(interval.high)}" if interval.bounded else "–"
    return f"{_number(interval.value)} [{bounds}]"


def _number(value: float, sign: str = "") -> str:
    digits = 2 if not value or abs(value) >= 0.1 else 1 - math.floor(math.log10(abs(value)))
    return f"{value:{sign}.{digits}f}"


def verdict_counts(results: Sequence[LedgerResult]) -> dict[str, int]:
    """Number of lines by verdict."""
    return {verdict: sum(result.verdict is verdict for result in results) for verdict in VERDICTS}
