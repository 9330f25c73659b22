"""The first pass over a sequence: where each person is, and which masks cannot be used.

No image is decoded here. The crop of a picture must hold the projected body and the person's mask;
the size of the largest is the size of all crops of a sequence.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np

from actorsnerf_datasets.cameras import camera_from_world, distorted
from actorsnerf_datasets.types import Camera, Float64, UInt8
from actorsnerf_preprocess.packed_masks import packed_mask
from actorsnerf_preprocess.pictures import Crop, Lens
from actorsnerf_preprocess.source import (
    Absent,
    MaskProbe,
    SourceCamera,
    SourceSequence,
)

MARGIN = 2
"""Stored pixels between the person and the border of the crop."""
SIZE_STEP = 8
SMALLEST_SIZE = 32
REACH = 0.25
"""Of the body's height: parts of a mask that begin farther from its box are not the person."""
MADE_MASK_REACH = 0.15
"""Of the body's height: room for hair and clothes where the mask is made later."""
FULL_SHARE = 0.9
"""A mask that covers more of the picture than this is no mask of a person."""
ELSEWHERE_SHARE = 0.2
"""If fewer of the body's vertices than this share lie inside the mask, it is not this body's."""


AREA_JUMP = 1.6
"""A mask that differs in area by more than this factor from its neighbours is worth a look."""
UNDISTORTION_STEPS = 10
"""Each more than halves the error of a lens that moves pixels by a tenth of the picture."""


@dataclass(frozen=True)
class Probe:
    """What the first pass says about one picture."""

    camera: int
    frame: int
    box: Crop | None
    """Of the person, in stored pixels; None: the picture is not stored, for `reason`."""
    reason: str
    where: str
    inside: float
    """Share of the projected vertices inside the mask; NaN if there is no mask yet."""
    area: float
    """Share of the picture that the mask covers; NaN if there is no mask yet."""
    stray: bool
    """Parts of the mask lie away from the body; what the crop does not reach is dropped."""
    digest: str
    packed: bytes = b""
    """The mask for the second pass (`packed_mask`); empty: it is read again."""


def probe_picture(
    source: SourceSequence,
    lens: Lens,
    stored: Camera,
    place: tuple[int, int],
    keep_mask: bool = False,
) -> Probe:
    """Where the person is in one picture, or why the picture cannot be used.

    Args:
        source: the sequence.
        lens: of the camera.
        stored: the camera of the stored pictures.
        place: indices in `source.cameras` and `source.frames`.
        keep_mask: for the second pass of a `SplitReader`.
    """
    found = source.reader.probe(*place)
    if isinstance(found, Absent):
        return Probe(*place, None, found.reason, found.where, np.nan, np.nan, False, "")
    where = str(source.reader.files(*place)[0])
    rays = _body_rays(source, lens.camera, place[1])
    body = _body_box(rays, stored)
    inside, reason = _judged(found.mask, rays, lens.camera)
    area = np.nan if found.mask is None else cv2.countNonZero(found.mask) / found.mask.size
    if body is None:
        reason = "body outside the picture"
    if reason or body is None:
        return Probe(*place, None, reason, where, inside, area, False, found.digest)
    box, stray = _person_box(found, body, lens, stored)
    packed = packed_mask(found.mask) if keep_mask else b""
    return Probe(*place, box, "", where, inside, area, stray, found.digest, packed)


def judged_mask(
    source: SourceSequence, lens: Lens, frame: int, mask: UInt8 | None
) -> tuple[float, str]:
    """(share of projected vertices inside a mask, why the mask is unusable or nothing).

    Args:
        source: the sequence.
        lens: of the picture's camera.
        frame: index in `source.frames`.
        mask: (H, W) source pixels; None gives NaN.
    """
    return _judged(mask, _body_rays(source, lens.camera, frame), lens.camera)


def crop_size(boxes: Iterable[Crop]) -> tuple[int, int]:
    """Width and height that hold every box: multiples of 8, at least 32.

    >>> crop_size([Crop(0, 0, 50, 100), Crop(5, 5, 61, 20)])
    (72, 104)
    """
    sizes = [(box.width, box.height) for box in boxes]
    width, height = (max(lengths) for lengths in zip(*sizes, strict=True))
    return _rounded_up(width), _rounded_up(height)


def placed_crop(box: Crop, size: tuple[int, int]) -> Crop:
    """The crop of the sequence's size with the box in its middle."""
    x = box.x + (box.width - size[0]) // 2
    y = box.y + (box.height - size[1]) // 2
    return Crop(x, y, *size)


def area_jumps(probes: Sequence[Probe]) -> tuple[Probe, ...]:
    """The pictures whose mask is much smaller or larger than those of the frames around it.

    Compared is with the median of the four pictures before and after, of the same camera.
    """
    jumps = []
    for camera in sorted({probe.camera for probe in probes}):
        row = [probe for probe in probes if probe.camera == camera and np.isfinite(probe.area)]
        for index, probe in enumerate(row):
            near = row[max(0, index - 4) : index + 5]
            usual = float(np.median([other.area for other in near]))
            if probe.box and not usual / AREA_JUMP < probe.area < usual * AREA_JUMP:
                jumps.append(probe)
    return tuple(jumps)


def _rounded_up(length: int) -> int:
    steps = ceil((length + 2 * MARGIN) / SIZE_STEP)
    return max(SMALLEST_SIZE, SIZE_STEP * steps)


def _body_rays(source: SourceSequence, camera: SourceCamera, frame: int) -> Float64:
    """(V, 2) x/z, y/z of the posed vertices without the lens; NaN where not in front.

    In memory all x come before all y: the passes over them that follow are several times as fast.
    """
    camera_from_body = camera_from_world(camera.R, camera.T) @ source.fits.world_from_body[frame]
    vertices = source.fits.posed_vertices[frame].astype(np.float64)
    x, y, depth = camera_from_body[:3, :3] @ vertices.T + camera_from_body[:3, 3:]
    depth[depth <= 0] = np.nan
    rays: Float64 = np.stack([x / depth, y / depth]).T
    return rays


def _pixels(rays: Float64, K: Float64) -> Float64:
    """(2, N) all x, then all y."""
    pixels: Float64 = K[:2, :2] @ rays.T + K[:2, 2:]
    return pixels


def _body_box(rays: Float64, stored: Camera) -> tuple[float, float, float, float] | None:
    """Left, top, right, bottom of the projected body; None if no part of it is in the picture."""
    x, y = _pixels(rays, stored.K)
    left, right = float(np.fmin.reduce(x)), float(np.fmax.reduce(x))
    top, bottom = float(np.fmin.reduce(y)), float(np.fmax.reduce(y))
    width, height = stored.size
    # NaN (all of it behind the camera) compares false.
    if right >= 0 and bottom >= 0 and left <= width - 1 and top <= height - 1:
        return left, top, right, bottom
    return None


def _judged(mask: UInt8 | None, rays: Float64, camera: SourceCamera) -> tuple[float, str]:
    """The share of vertices inside the mask, and why the mask is unusable, or nothing."""
    if mask is None:
        return np.nan, ""
    covered = cv2.countNonZero(mask) / mask.size
    if covered == 0:
        return 0.0, "empty mask"
    if covered > FULL_SHARE:
        return 1.0, "full mask"
    height, width = mask.shape
    x, y = _pixels(distorted(rays, camera.distortion), camera.K)
    # NaN (behind the camera) compares false and counts as outside.
    seen = (x > -0.5) & (y > -0.5) & (x < width - 0.5) & (y < height - 0.5)
    columns, rows = np.rint(x[seen]).astype(int), np.rint(y[seen]).astype(int)
    share = float(np.count_nonzero(mask[rows, columns])) / len(x)
    visible = float(np.count_nonzero(seen)) / len(x)
    return share, "mask elsewhere" if share < ELSEWHERE_SHARE * visible else ""


def _person_box(
    found: MaskProbe, body: tuple[float, float, float, float], lens: Lens, stored: Camera
) -> tuple[Crop, bool]:
    """The box of the body and the parts of the mask near it, inside the picture."""
    left, top, right, bottom = body
    height = bottom - top
    stray = False
    if found.mask is None:
        reach = MADE_MASK_REACH * height
        left, top, right, bottom = left - reach, top - reach, right + reach, bottom + reach
    else:
        reach = REACH * height
        near = (left - reach, top - reach, right + reach, bottom + reach)
        for outline in _outlines(found.mask, lens, stored):
            (x0, y0), (x1, y1) = outline.min(axis=0), outline.max(axis=0)
            if x1 < near[0] or y1 < near[1] or x0 > near[2] or y0 > near[3]:
                stray = True
                continue
            left, top = min(left, x0), min(top, y0)
            right, bottom = max(right, x1), max(bottom, y1)
    left, top = max(int(np.floor(left)), 0), max(int(np.floor(top)), 0)
    right = min(int(np.ceil(right)), stored.size[0] - 1)
    bottom = min(int(np.ceil(bottom)), stored.size[1] - 1)
    return Crop(left, top, right - left + 1, bottom - top + 1), stray


def _outlines(mask: UInt8, lens: Lens, stored: Camera) -> list[Float64]:
    """The outer contours of a mask, undistorted, in stored pixels."""
    x, y, width, height = cv2.boundingRect(mask)
    contours, _ = cv2.findContours(
        mask[y : y + height, x : x + width],
        cv2.RETR_EXTERNAL,
        cv2.CHAIN_APPROX_NONE,
        offset=(x, y),
    )
    if not contours:
        return []
    pixels = np.concatenate(contours).reshape(-1, 2).astype(np.float64)
    pixels = _pixels(_rays(pixels, lens.camera), stored.K).T
    return np.split(pixels, np.cumsum([len(contour) for contour in contours])[:-1])


def _rays(pixels: Float64, camera: SourceCamera) -> Float64:
    """x/z, y/z of distorted pixels (N, 2), by fixed-point iteration."""
    inverse = np.linalg.inv(camera.K[:2, :2])
    target: Float64 = (inverse @ (pixels.T - camera.K[:2, 2:])).T
    rays = target
    for _ in range(UNDISTORTION_STEPS if np.any(camera.distortion) else 0):
        rays = rays + (target - distorted(rays, camera.distortion))
    return rays
