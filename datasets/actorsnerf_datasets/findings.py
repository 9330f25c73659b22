"""What a check has to say."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One observation about a file, in a sentence."""

    severity: Severity
    entry: str
    """The dataset, attribute or file that it is about."""
    sentence: str


def listed(numbers: Sequence[int]) -> str:
    """The first few numbers, and how many there are if that is not all.

    >>> listed([3, 4]), listed(range(7))
    ('3, 4', '0, 1, 2, 3, 4, … (7 in all)')
    """
    shown = ", ".join(str(number) for number in numbers[:5])
    return shown if len(numbers) <= 5 else f"{shown}, … ({len(numbers)} in all)"
