"""Where in a picture a training step looks: square patches, most of them on the person."""

from dataclasses import dataclass

import numpy as np

from actorsnerf_datasets.body_box import meets_box
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.types import Float64, Int64, UInt8

PERSON_SHARE = 0.8
"""Chance that a patch's centre lies on the person, else in the box beside it (released code)."""
_TRIES = 256
"""Pixels drawn at once while looking for one in the box beside the person."""
_ROUNDS = 8


@dataclass(frozen=True)
class PatchScene:
    """What patches are drawn from: one crop, its camera, and the body's box."""

    alpha: UInt8
    """(H, W)."""
    K: Float64
    """(3, 3) of the crop."""
    camera_from_body: Float64
    box: Float64
    """(2, 3) body frame, metres."""
    offset: tuple[int, int]
    """x, y of the crop in the full picture; it may hang over the picture's edge."""
    full_size: tuple[int, int]
    """Width, height of the full picture."""


def draw_patches(rng: np.random.Generator, scene: PatchScene, count: int, side: int) -> Int64:
    """Pixel coordinates x, y (count, side, side, 2) of square patches inside the crop.

    A centre is a uniform pixel of the person (alpha > 0) with probability `PERSON_SHARE`, else a
    uniform pixel whose ray meets the body's box but which is not of the person; where one of the
    two kinds does not exist the other is taken. Patches are shifted inside the crop, and inside the
    picture: what of a crop hangs over its edge was never seen, and would teach that a person whom
    the edge cuts ends there. Only where the picture's part of the crop is narrower than a patch
    does the patch hang over too, as little as it can.

    Raises:
        UserError: the crop is smaller than a patch, or shows neither person nor box.
    """
    height, width = scene.alpha.shape
    if side > min(height, width):
        raise UserError(
            f"a patch of {side}x{side} pixels does not fit a crop of {width}x{height}: "
            "take smaller patches, or prepare at a larger scale"
        )
    person = np.flatnonzero(scene.alpha)
    low, high = _corner_limits(scene, side)
    corners = np.empty((count, 2), dtype=np.int64)
    for i in range(count):
        wanted = rng.random() < PERSON_SHARE
        centre = _person_pixel(rng, person, width) if wanted else _beside_pixel(rng, scene)
        if centre is None:
            centre = _beside_pixel(rng, scene) if wanted else _person_pixel(rng, person, width)
        if centre is None:
            raise UserError(
                "no pixel of the crop shows the person or looks at the body's box: no usable ray"
            )
        corners[i] = np.clip(np.asarray(centre) - side // 2, low, high)
    steps = np.arange(side)
    x, y = np.meshgrid(steps, steps)  # both (side, side), rows are y
    return corners[:, None, None, :] + np.stack([x, y], axis=-1)


def _seen(scene: PatchScene) -> tuple[Int64, Int64]:
    """First and one past the last pixel x, y of the crop that the picture holds."""
    size = np.array(scene.alpha.shape[::-1], dtype=np.int64)
    first = -np.array(scene.offset, dtype=np.int64)
    return np.clip(first, 0, size), np.clip(first + scene.full_size, 0, size)


def _corner_limits(scene: PatchScene, side: int) -> tuple[Int64, Int64]:
    """Least and largest x, y of a patch's top-left pixel."""
    first, end = _seen(scene)
    most = np.array(scene.alpha.shape[::-1], dtype=np.int64) - side
    low, high = np.sort([first, end - side], axis=0)  # they change places where seen < side
    return np.clip(low, 0, most), np.clip(high, 0, most)


def _person_pixel(rng: np.random.Generator, person: Int64, width: int) -> tuple[int, int] | None:
    if len(person) == 0:
        return None
    y, x = divmod(int(person[rng.integers(len(person))]), width)
    return x, y


def _beside_pixel(rng: np.random.Generator, scene: PatchScene) -> tuple[int, int] | None:
    """A uniform pixel of the picture that looks at the box beside the person.

    By rejection, at last by looking at all.
    """
    size = scene.alpha.size
    for _ in range(_ROUNDS):
        found = _first_beside(scene, rng.integers(size, size=_TRIES))
        if found is not None:
            return found
    return _first_beside(scene, rng.permutation(size))


def _first_beside(scene: PatchScene, candidates: Int64) -> tuple[int, int] | None:
    y, x = np.divmod(candidates, scene.alpha.shape[1])
    (left, top), (right, bottom) = _seen(scene)
    free = (scene.alpha[y, x] == 0) & (x >= left) & (x < right) & (y >= top) & (y < bottom)
    pixels = np.stack([x[free], y[free]], axis=1).astype(np.float64)
    hits = np.flatnonzero(meets_box(pixels, scene.K, scene.camera_from_body, scene.box))
    if len(hits) == 0:
        return None
    return int(pixels[hits[0], 0]), int(pixels[hits[0], 1])
