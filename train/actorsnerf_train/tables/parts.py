"""What each part of ActorsNeRF earns: trainings with it against trainings without, in pairs."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scipy.stats import t as student_t

from actorsnerf_train.checkpoint import write_whole
from actorsnerf_train.labels import METHODS, PARTS
from actorsnerf_train.metrics import ConventionName
from actorsnerf_train.tables.entry import Entry
from actorsnerf_train.tables.table import Number

WHOLE = METHODS["actorsnerf"]
WITHOUT = {part: f"{WHOLE}, no {part}" for part in PARTS.values()} | {
    "category training": f"{WHOLE}, from scratch"
}
"""Label of the row without each part."""
LEAST_PAIRS = 3
"""Under so many, a spread says next to nothing."""


@dataclass(frozen=True)
class PartGain:
    """What a part earns in a setting, over pairs of one actor and seed, and what it costs."""

    part: str
    setting: str
    list_name: str
    gain: Number
    """LPIPS x1000 without the part minus with it; its spread is over pairs."""
    share: float
    """The gain as a share of the error without the part."""
    better: int
    """Pairs in which the part lowered the error."""
    pairs: int
    seconds_with: float
    """Mean of a training step."""
    seconds_without: float

    @property
    def clear(self) -> bool:
        """Whether the gain, or loss, stands out of the spread over pairs (t-test, 5 %)."""
        if self.gain.spread is None:
            return False
        quantile = float(student_t.ppf(0.975, self.pairs - 1))
        return abs(self.gain.value) > quantile * self.gain.spread / math.sqrt(self.pairs)


def part_gains(entries: Sequence[Entry], convention: ConventionName) -> tuple[PartGain, ...]:
    """The gain of every part and setting of which there is a pair with LPIPS.

    Raises:
        UserError: an entry lacks the convention.
    """
    whole = {_key(entry): entry for entry in entries if entry.label == WHOLE}
    gains = []
    for part, label in WITHOUT.items():
        groups: dict[tuple[str, str], list[tuple[Entry, Entry]]] = {}
        for entry in entries:
            if entry.label == label and _key(entry) in whole:
                setting = (entry.result.setting or "", entry.result.list_name or "")
                groups.setdefault(setting, []).append((whole[_key(entry)], entry))
        for setting, pairs in groups.items():
            gain = _gain(part, setting, pairs, convention)
            if gain is not None:
                gains.append(gain)
    return tuple(gains)


def write_parts(path: Path, gains: Sequence[PartGain], convention: ConventionName) -> None:
    """Write the table of gains, as Markdown and beside it as CSV."""
    head = ["part", "setting", "list", "LPIPS x1000 gained", "share", "better in", "s a step"]
    lines = [
        f"What each part earns, convention `{convention}`: error without it minus error with it, "
        "mean over pairs of one actor and seed (± standard deviation over pairs). All pairs of a "
        "row share one category training, whose own chance is not in the spread.",
        "",
        f"| {' | '.join([*head, 'verdict'])} |",
        f"|{' --- |' * (len(head) + 1)}",
    ]
    rows = ["part,setting,list,convention,gain,spread,share,better,pairs,s_with,s_without"]
    for gain in gains:
        spread = gain.gain.spread
        number = f"{gain.gain.value:+.1f}" + ("" if spread is None else f" ± {spread:.1f}")
        time = f"{gain.seconds_with:.2f} with, {gain.seconds_without:.2f} without"
        words = [gain.part, gain.setting, gain.list_name, number, f"{gain.share:+.1%}"]
        words += [f"{gain.better} of {gain.pairs}", time, _verdict(gain)]
        lines.append(f"| {' | '.join(words)} |")
        figures = (gain.gain.value, "" if spread is None else spread, gain.share, gain.better)
        where = (gain.part, gain.setting, gain.list_name, convention)
        cells = (*where, *figures, gain.pairs, gain.seconds_with, gain.seconds_without)
        rows.append(",".join(map(str, cells)))
    write_whole(path, ("\n".join(lines) + "\n").encode())
    write_whole(path.with_suffix(".csv"), ("\n".join(rows) + "\n").encode())


def _verdict(gain: PartGain) -> str:
    if gain.pairs < LEAST_PAIRS:
        return f"too few pairs to tell (under {LEAST_PAIRS})"
    if not gain.clear:
        return "within noise"
    return "pays" if gain.gain.value > 0 else "harms"


def _gain(
    part: str,
    setting: tuple[str, str],
    pairs: Sequence[tuple[Entry, Entry]],
    convention: ConventionName,
) -> PartGain | None:
    errors = [
        (one.mean(convention).lpips_x1000, other.mean(convention).lpips_x1000)
        for one, other in pairs
    ]
    known = [(one, other) for one, other in errors if one is not None and other is not None]
    if len(known) < len(pairs):
        return None
    differences = [other - one for one, other in known]
    mean = statistics.mean(differences)
    return PartGain(
        part=part,
        setting=setting[0],
        list_name=setting[1],
        gain=Number(mean, statistics.stdev(differences) if len(known) > 1 else None),
        share=mean / statistics.mean(other for _, other in known),
        better=sum(difference > 0 for difference in differences),
        pairs=len(known),
        seconds_with=statistics.mean(_pace(one) for one, _ in pairs),
        seconds_without=statistics.mean(_pace(other) for _, other in pairs),
    )


def _pace(entry: Entry) -> float:
    return entry.result.training_seconds / max(entry.result.step, 1)


def _key(entry: Entry) -> tuple[str | None, str | None, str, int]:
    result = entry.result
    return result.setting, result.list_name, result.actor, result.seed
