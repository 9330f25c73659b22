"""Which size K of a ZJU-MoCap tree belongs to: that of its pictures, or the released one.

Pictures get resized while `annots.npy` stays as it was released, and other trees have pictures of
another size with a K of their own. A lens looks at the middle of its picture, which tells the two.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.source import Finding

RELEASED_SIZE = (1024, 1024)
"""Pixels: the width and height that K of the released archives belongs to."""
FARTHEST = 0.25
"""A principal point is nearer to the picture's middle than this share of each side."""
CLEAR = 0.5
"""The choice is clear if one distance from the middle is below this share of the other."""


@dataclass(frozen=True)
class Intrinsics:
    """K of each camera, of the size of its pictures."""

    K: Float64
    """(C, 3, 3)."""
    findings: tuple[Finding, ...]
    """One for each size that is not the released one, and for each K that looks elsewhere."""
    notes: tuple[str, ...]


def intrinsics_of(K: Float64, sizes: Sequence[tuple[int, int]], names: Sequence[str]) -> Intrinsics:
    """K of each camera, scaled to the pictures where it belongs to the released size.

    Cameras of one size are decided together, by their median principal point.

    Args:
        K: (C, 3, 3) of `annots.npy`.
        sizes: width and height of each camera's pictures.
        names: of the cameras.
    """
    fitted = K.copy()
    findings = []
    for size in dict.fromkeys(sizes):
        if size == RELEASED_SIZE:
            continue
        alike = np.array([each == size for each in sizes])
        own, released = (_off_middle(K[alike], each) for each in (size, RELEASED_SIZE))
        if released < own:
            fitted[alike] = _scaled(K[alike], size)
        findings.append(_choice(K[alike], size, own, released))
    notes = tuple(finding.sentence for finding in findings)
    for name, listed, k, size in zip(names, K, fitted, sizes, strict=True):
        if np.abs(k[:2, 2] / size - 0.5).max() >= FARTHEST:
            sentence = f"The principal point {listed[:2, 2].round(1).tolist()} is far from the "
            findings.append(Finding("warning", f"{name}/K", sentence + "centre."))
    return Intrinsics(fitted, tuple(findings), notes)


def _off_middle(K: Float64, size: tuple[int, int]) -> float:
    """Distance of the median principal point from the middle of such a picture, in its sides."""
    return float(np.linalg.norm(np.median(K[:, :2, 2], axis=0) / size - 0.5))


def _scaled(K: Float64, size: tuple[int, int]) -> Float64:
    """K of the released size for resized pictures; pixel centres are at whole numbers."""
    factors = np.array([*size, 1.0]) / (*RELEASED_SIZE, 1.0)
    scaled: Float64 = factors[:, None] * K
    scaled[:, :2, 2] += 0.5 * factors[:2] - 0.5
    return scaled


def _choice(K: Float64, size: tuple[int, int], own: float, released: float) -> Finding:
    place = np.median(K[:, :2, 2], axis=0).round(1).tolist()
    picture, original = (f"{width} x {height}" for width, height in (size, RELEASED_SIZE))
    chosen = f"{original} and was scaled" if released < own else f"{picture} and was kept"
    sentence = (
        f"Pictures of {len(K)} cameras are {picture}, not {original}: K belongs to {chosen}, as "
        f"its principal point (median {place}) is off the middle by {released:.3f} of {original} "
        f"and by {own:.3f} of {picture}."
    )
    if min(own, released) > CLEAR * max(own, released):
        doubt = " The two are close: compare projected bodies with the pictures."
    elif released < own and size[0] != size[1]:
        doubt = " The proportions differ: were the pictures cut? Then K must be moved, not scaled."
    else:
        doubt = ""
    return Finding("warning" if doubt else "note", "annots.npy/cams/K", sentence + doubt)
