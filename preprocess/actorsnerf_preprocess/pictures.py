"""The stored crop of one picture: undistorted, resized in the official order, cut to the person.

The published pipeline undistorts picture and mask (bilinear, same K), composites at full size and
resizes the composite. A file without a background colour in it must give the same composite for
any background b. With the picture I and the mask a (0 to 1, soft at the silhouette because it is
undistorted bilinearly, as published), resize(I a + b (1 - a)) = P + b (1 - A) for P = resize(I a)
and A = resize(a), since the filter is linear and its weights sum to 1. So A is stored as the alpha
and P / A as the straight colour. Pixels with A = 0 hold the resized picture within a few pixels of
the person (or everywhere, with the background kept) and zero elsewhere.

Composites differ from the published order by at most half a level on the published background
(the colour's rounding) and one level on any other (half a level more from the alpha's). Beyond
that only where the Lanczos filter overshoots, A or P / A outside [0, 1]: 8 bits cannot hold that.
There the composite is exact for the published background alone.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets import types
from actorsnerf_datasets.cameras import scaled_intrinsics
from actorsnerf_preprocess.source import RawPicture, SourceCamera

Float32 = NDArray[np.float32]

FILTERS = {
    "lanczos4": cv2.INTER_LANCZOS4,
    "linear": cv2.INTER_LINEAR,
    "area": cv2.INTER_AREA,
}
FILTER_REACH = 2
"""Stored pixels around a window that are resized too, so that its border is exact: Lanczos looks
at 4 source pixels to each side, which are at most 2 stored ones at the scales 1/2, 1/3, ..."""


@dataclass(frozen=True)
class PictureOptions:
    """How pictures are stored."""

    scale: float = 0.5
    """Stored size / source size. The published experiments use 0.5."""
    keep_background: bool = False
    """Keep what is not the person; by default only a rim around the person is kept."""
    filter: Literal["lanczos4", "linear", "area"] = "lanczos4"
    """Resizing filter; the published code resizes pictures with Lanczos."""
    rim: int = 4
    """Stored pixels around the person whose colour is kept."""
    published_background: Literal["black", "white"] = "black"
    """The background of the data set's published experiments; composites on it are exact."""


@dataclass(frozen=True)
class Lens:
    """A camera's undistortion, bit for bit that of `cv2.undistort` with the same K."""

    camera: SourceCamera
    maps: tuple[NDArray[np.int16], NDArray[np.uint16]] | None
    """Fixed-point maps of the whole picture; None: the camera has no distortion."""


@dataclass(frozen=True)
class Crop:
    """Where a crop sits in the full stored picture, in pixels; may reach beyond it."""

    x: int
    y: int
    width: int
    height: int


def lens_of(camera: SourceCamera) -> Lens:
    """The undistortion of a camera, to be reused for all its pictures."""
    if not np.any(camera.distortion):
        return Lens(camera, None)
    column, fraction = cv2.initUndistortRectifyMap(
        camera.K, camera.distortion, None, camera.K, camera.size, cv2.CV_16SC2
    )
    return Lens(camera, (np.asarray(column, np.int16), np.asarray(fraction, np.uint16)))


def undistorted(lens: Lens, picture: types.UInt8, window: Crop) -> types.UInt8:
    """A window of the undistorted picture; source pixels, the window inside the picture.

    Args:
        lens: of the picture's camera.
        picture: (H, W) or (H, W, 3) as in the source.
        window: source pixels.
    """
    rows = slice(window.y, window.y + window.height)
    columns = slice(window.x, window.x + window.width)
    if lens.maps is None:
        return picture[rows, columns]
    column, fraction = (part[rows, columns] for part in lens.maps)
    return np.asarray(cv2.remap(picture, column, fraction, cv2.INTER_LINEAR), np.uint8)


def stored_size(size: tuple[int, int], scale: float) -> tuple[int, int]:
    """Width and height after resizing, rounded as OpenCV does.

    >>> stored_size((1024, 1024), 0.5)
    (512, 512)
    """
    return round(size[0] * scale), round(size[1] * scale)


def stored_camera(camera: SourceCamera, scale: float) -> types.Camera:
    """The camera of the stored pictures: undistorted and resized."""
    return types.Camera(
        name=camera.name,
        source_index=camera.source_index,
        K=scaled_intrinsics(camera.K, scale),
        R=camera.R,
        T=camera.T,
        size=stored_size(camera.size, scale),
        source_K=camera.K,
        source_distortion=camera.distortion,
        source_size=camera.size,
    )


def stored_picture(
    raw: RawPicture, lens: Lens, crop: Crop, options: PictureOptions
) -> types.Picture:
    """The crop of one picture as it is stored.

    Args:
        raw: the source's picture; it must have a mask.
        lens: of its camera.
        crop: in stored pixels; parts outside the picture are black with zero alpha.
        options: scale, filter, background.
    """
    size = stored_size(lens.camera.size, options.scale)
    inner = _intersection(crop, Crop(0, 0, *size))
    rgb = np.zeros((crop.height, crop.width, 3), np.uint8)
    alpha = np.zeros((crop.height, crop.width), np.uint8)
    if inner.width and inner.height:
        inner, resized = _resized_window(raw, lens, inner, options)
        left, top = inner.x - crop.x, inner.y - crop.y
        rows, columns = slice(top, top + inner.height), slice(left, left + inner.width)
        rgb[rows, columns], alpha[rows, columns] = _encoded(resized, options)
    return types.Picture(rgb, alpha, (crop.x, crop.y))


@dataclass(frozen=True)
class _Resized:
    """A resized window, colours in levels (0 to 255), the person's before rounding."""

    premultiplied: Float32
    coverage: Float32
    beside: types.UInt8
    """(H, W, 3) what pixels without the person hold."""


def _resized_window(
    raw: RawPicture, lens: Lens, inner: Crop, options: PictureOptions
) -> tuple[Crop, _Resized]:
    """The part of a window that can hold anything, stored pixels, and what it holds."""
    assert raw.mask is not None, "a picture without a mask is not stored"
    size = stored_size(lens.camera.size, options.scale)
    step = _step(lens.camera.size, options.scale)
    reach = _grown(inner, FILTER_REACH, size) if step else Crop(0, 0, *size)
    window = _in_source(reach, step) if step else Crop(0, 0, *lens.camera.size)
    mask = undistorted(lens, raw.mask, window)
    if step and not options.keep_background:
        inner = _intersection(inner, _with_rim(mask, reach, step, options.rim))
        reach = _grown(inner, FILTER_REACH, size)
        left, top = window.x, window.y
        window = _in_source(reach, step)
        mask = mask[window.y - top :, window.x - left :][: window.height, : window.width]
    colours = undistorted(lens, raw.image, window)
    product = cv2.multiply(colours, cv2.merge([mask] * 3), scale=1 / 255, dtype=cv2.CV_32F)
    premultiplied = np.asarray(product, np.float32)
    coverage = mask.astype(np.float32) / np.float32(255.0)
    top, left = inner.y - reach.y, inner.x - reach.x
    rows, columns = slice(top, top + inner.height), slice(left, left + inner.width)
    premultiplied, coverage = (
        _resized(channels, options)[rows, columns] for channels in (premultiplied, coverage)
    )
    return inner, _Resized(premultiplied, coverage, _beside(colours, options)[rows, columns])


def _step(size: tuple[int, int], scale: float) -> int:
    """Source pixels per stored one; 0 if stored pixels do not begin at source pixels.

    Then only the whole picture, resized, has the right phase.
    """
    step = round(1.0 / scale)
    return step if step * scale == 1.0 and not any(length % step for length in size) else 0


def _in_source(window: Crop, step: int) -> Crop:
    return Crop(window.x * step, window.y * step, window.width * step, window.height * step)


def _with_rim(mask: types.UInt8, window: Crop, step: int, rim: int) -> Crop:
    """Where a stored picture is not zero: the person, softened by the filter, and the rim.

    Args:
        mask: source pixels of the window.
        window: stored pixels, as is the result.
        step: source pixels per stored one.
        rim: stored pixels around the person whose colour is kept.
    """
    x, y, width, height = cv2.boundingRect(mask)
    if not width:
        return window
    by = FILTER_REACH + rim
    left, top = x // step - by, y // step - by
    right, bottom = (x + width - 1) // step + 1 + by, (y + height - 1) // step + 1 + by
    return Crop(window.x + left, window.y + top, right - left, bottom - top)


def _beside(colours: types.UInt8, options: PictureOptions) -> types.UInt8:
    """The resized picture for pixels without the person: a rim that no composite shows.

    So the cheapest good filter does there; a background that is kept gets the published one.
    """
    if options.keep_background or options.scale == 1.0:
        return _to_byte(_resized(colours.astype(np.float32), options))
    scale = options.scale
    return np.asarray(
        cv2.resize(colours, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
    )


def _resized(channels: Float32, options: PictureOptions) -> Float32:
    if options.scale == 1.0:
        return channels
    resized = cv2.resize(
        channels,
        None,
        fx=options.scale,
        fy=options.scale,
        interpolation=FILTERS[options.filter],
    )
    return np.asarray(resized, np.float32)


def _encoded(window: _Resized, options: PictureOptions) -> tuple[types.UInt8, types.UInt8]:
    """Straight colour and alpha in 8 bits whose composite is the resized composite."""
    alpha = _to_byte(window.coverage * np.float32(255.0))
    # Divided by the alpha that is stored, not the exact one: then colour times alpha is off by
    # half a level only, however small alpha is. Where it is zero the quotient is not used.
    share = np.maximum(alpha, 1).astype(np.float32) / np.float32(255.0)
    mixed = window.premultiplied
    if options.published_background == "white":
        missing = np.float32(255.0) * (share - window.coverage)
        mixed = mixed + cv2.merge([missing] * 3)
    colour = _to_byte(np.asarray(cv2.divide(mixed, cv2.merge([share] * 3)), np.float32))
    beside = window.beside
    if not options.keep_background:
        beside = np.asarray(cv2.copyTo(beside, _within(alpha, options.rim)), np.uint8)
    return np.asarray(cv2.copyTo(colour, alpha, beside), np.uint8), alpha


def _intersection(a: Crop, b: Crop) -> Crop:
    x, y = max(a.x, b.x), max(a.y, b.y)
    width = min(a.x + a.width, b.x + b.width) - x
    height = min(a.y + a.height, b.y + b.height) - y
    return Crop(x, y, max(width, 0), max(height, 0))


def _grown(crop: Crop, by: int, size: tuple[int, int]) -> Crop:
    grown = Crop(crop.x - by, crop.y - by, crop.width + 2 * by, crop.height + 2 * by)
    return _intersection(grown, Crop(0, 0, *size))


def _within(person: types.UInt8, rim: int) -> types.UInt8:
    """Not zero on the person and `rim` pixels around."""
    if rim <= 0:
        return person
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * rim + 1, 2 * rim + 1))
    return np.asarray(cv2.dilate(person, disc), np.uint8)


def _to_byte(values: Float32) -> types.UInt8:
    byte: types.UInt8 = np.clip(values + np.float32(0.5), 0, 255).astype(np.uint8)
    return byte
