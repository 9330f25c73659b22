"""Whether a prepared sequence is what the layout says."""

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
