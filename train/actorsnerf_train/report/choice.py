"""Which operating points nobody should use, and which one to begin with."""

from collections.abc import Sequence
from dataclasses import dataclass

from actorsnerf_train.metrics import Scores
from actorsnerf_train.report.errors import ToReference
from actorsnerf_train.report.measure import Spread

LOSS = 0.1
"""Decibel to the true pictures that the recommended point may lose against `exact`."""
LPIPS_LOSS = 1.0
"""The same for LPIPS times 1000."""
NEAREST = 40.0
"""Decibel to the reference picture that the recommended point must keep."""

CLEARLY = 0.5
"""Decibel to the reference picture by which a point is clearly nearer than another."""


@dataclass(frozen=True)
class Standing:
    """What decides about a point."""

    name: str
    times: Spread
    reference: ToReference
    truth: Scores | None

    @property
    def nearness(self) -> float:
        """Decibel to the reference picture; infinite if no pixel is a step of 8 bits away."""
        return float("inf") if self.reference.same else self.reference.psnr


def dominated(points: Sequence[Standing]) -> dict[str, str]:
    """The points nobody should use, each with one that is no slower and no further off.

    One of both must be clear: faster than the first quartile of its times, or `CLEARLY` nearer.
    """
    found: dict[str, str] = {}
    for one in points:
        better = [other for other in points if other is not one and _beats(other, one)]
        if better:
            found[one.name] = min(better, key=lambda other: other.times.median).name
    return found


def recommended(points: Sequence[Standing]) -> str:
    """The fastest point whose error stays within the stated losses; else the fastest exact one.

    Where rounding takes all of them a step of 8 bits from the reference, the one nearest to it
    stands for the exact ones.
    """
    drawn = [point for point in points if point.truth is not None] or points
    exact = min(
        (point for point in drawn if point.reference.same),
        key=lambda point: point.times.median,
        default=max(drawn, key=lambda point: point.nearness),
    )
    good = [point for point in points if _harmless(point, exact)]
    return min(good, key=lambda point: point.times.median, default=exact).name


def _beats(one: Standing, other: Standing) -> bool:
    if one.times.median > other.times.median or one.nearness < other.nearness:
        return False
    return one.times.median < other.times.low or one.nearness > other.nearness + CLEARLY


def _harmless(point: Standing, exact: Standing) -> bool:
    if point.nearness < NEAREST:
        return False
    if point.truth is None or exact.truth is None:
        return point.reference.same
    if exact.truth.psnr - point.truth.psnr > LOSS:
        return False
    distances = point.truth.lpips_x1000, exact.truth.lpips_x1000
    if distances[0] is None or distances[1] is None:
        return True
    return distances[0] - distances[1] <= LPIPS_LOSS


__all__ = ["LOSS", "LPIPS_LOSS", "NEAREST", "Standing", "dominated", "recommended"]
