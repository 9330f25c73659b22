"""Whether the pictures of a sequence are there, decode, and show the person."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

import h5py
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.cameras import camera_from_world, cropped_intrinsics, project
from actorsnerf_datasets.digests import digest_of_dataset
from actorsnerf_datasets.findings import Finding, listed
from actorsnerf_datasets.layout import DIGEST_ATTRIBUTE
from actorsnerf_datasets.protocols import needed_pairs
from actorsnerf_datasets.types import Protocol, SequenceHeader, UInt8

FULL_SHARE = 0.95
"""A mask that fills more of its crop than this shows no outline."""
INSIDE_WARNING, INSIDE_ERROR = 0.9, 0.5
"""Share of the projected vertices inside the mask, mean over a camera's pictures."""


@dataclass(frozen=True)
class Index:
    """Which pictures are where."""

    row: NDArray[np.int32]
    valid: NDArray[np.bool_]
    offset: NDArray[np.int32]


def read_index(file: h5py.File) -> Index:
    """The picture index of an open sequence."""
    names = ("row", "valid", "offset")
    return Index(*(np.asarray(file[f"pictures/{name}"][:]) for name in names))


def digest_findings(file: h5py.File) -> Iterator[Finding]:
    """Datasets whose content is not what their stored digest says, or does not decode."""
    names: list[str] = []
    file.visititems(
        lambda name, node: names.append(name) if isinstance(node, h5py.Dataset) else None
    )
    for name in names:
        stored = file[name].attrs.get(DIGEST_ATTRIBUTE)
        try:
            found = digest_of_dataset(file[name])
        except (OSError, RuntimeError) as error:
            yield Finding("error", name, f"cannot be decoded ({error}): is the file damaged?")
            continue
        if stored is None:
            yield Finding("error", name, f"has no attribute {DIGEST_ATTRIBUTE!r}")
        elif stored != found:
            yield Finding(
                "error", name, "its content is not what its digest says: damaged or edited?"
            )


def index_findings(header: SequenceHeader, index: Index) -> Iterator[Finding]:
    """Contradictions between `row`, `valid` and the stored pictures."""
    if (header.frames[1:] <= header.frames[:-1]).any():
        yield Finding("error", "frames/number", "frame numbers are not strictly ascending")
    missing = int((index.valid & (index.row < 0)).sum())
    if missing:
        yield Finding("error", "pictures/valid", f"{missing} pairs are valid but have no picture")
    used = np.sort(index.row[index.row >= 0])
    if not np.array_equal(used, np.arange(len(index.offset))):
        yield Finding(
            "error",
            "pictures/row",
            f"does not name each of the {len(index.offset)} pictures exactly once",
        )
    if not index.valid.any():
        yield Finding(
            "error",
            "pictures/valid",
            f"none of the {index.valid.size} pairs of a camera and a frame has a valid picture: "
            "prepare the sequence again and see its report",
        )
    unusable = int(((index.row >= 0) & ~index.valid).sum())
    if unusable:
        yield Finding("note", "pictures/valid", f"{unusable} stored pictures are marked unusable")


def protocol_findings(header: SequenceHeader, index: Index) -> Iterator[Finding]:
    """Cameras, frames and pictures that a protocol names and the file does not have."""
    for protocol in header.protocols:
        yield from _protocol_findings(header, index, protocol)


def _protocol_findings(
    header: SequenceHeader, index: Index, protocol: Protocol
) -> Iterator[Finding]:
    entry = f"protocols/{protocol.name}"
    names = [camera.name for camera in header.cameras]
    absent = [c for c in (protocol.training_camera, *protocol.evaluation_cameras) if c not in names]
    if absent:
        yield Finding("error", entry, f"names cameras that are not there: {', '.join(absent)}")
    positions = {int(number): position for position, number in enumerate(header.frames)}
    pairs = [(c, f) for c, f in needed_pairs(protocol) if c not in absent]
    lost = sorted({frame for _, frame in pairs if frame not in positions})
    if lost:
        yield Finding("error", entry, f"names frames that are not there: {listed(lost)}")
    wanted = [(names.index(c), positions[f]) for c, f in pairs if f in positions]
    usable = sum(bool(index.valid[pair]) for pair in wanted)
    if usable < len(wanted):
        yield Finding(
            "warning",
            entry,
            f"{len(wanted) - usable} of the {len(wanted)} pictures it uses are not there or not "
            "usable",
        )


@dataclass
class _Masks:
    """What the masks of one camera are like."""

    empty: list[int] = field(default_factory=list)
    full: list[int] = field(default_factory=list)
    beside: list[int] = field(default_factory=list)
    inside: list[float] = field(default_factory=list)


def mask_findings(file: h5py.File, header: SequenceHeader, index: Index) -> Iterator[Finding]:
    """Masks that are empty, full, outside their picture, or not where the body projects."""
    by_camera: dict[str, _Masks] = defaultdict(_Masks)
    for camera, frame in np.argwhere(index.valid & (index.row >= 0)).tolist():
        row = int(index.row[camera, frame])
        if row >= len(index.offset):
            continue
        try:
            alpha = file["pictures/alpha"][row]
        except (OSError, RuntimeError):
            continue  # said by the digests
        masks, number = by_camera[header.cameras[camera].name], int(header.frames[frame])
        offset = (int(index.offset[row, 0]), int(index.offset[row, 1]))
        if not alpha.any():
            masks.empty.append(number)
        elif (alpha > 0).mean() > FULL_SHARE:
            masks.full.append(number)
        if not _overlaps(offset, alpha, header.cameras[camera].size):
            masks.beside.append(number)
        elif alpha.any():
            masks.inside.append(inside_share(header, (camera, frame), alpha, offset))
    for name, masks in by_camera.items():
        yield from _mask_sentences(name, masks)


def inside_share(
    header: SequenceHeader, place: tuple[int, int], alpha: UInt8, offset: tuple[int, int]
) -> float:
    """Share of the body's vertices that project into the mask; NaN if none is in the picture.

    Vertices behind the camera or outside the full picture are not counted.

    Args:
        header: the sequence.
        place: positions of the camera and the frame.
        alpha: (H, W) the crop's mask.
        offset: x, y of the crop in the full picture.
    """
    camera, frame = header.cameras[place[0]], place[1]
    camera_from_body = camera_from_world(camera.R, camera.T) @ header.fits.world_from_body[frame]
    points = header.fits.posed_vertices[frame].astype(np.float64)
    K = cropped_intrinsics(camera.K, offset)
    found = project(points, K, camera_from_body)
    pixels = np.rint(found.pixels[found.in_front]).clip(-1e6, 1e6).astype(np.int64)
    in_full = ((pixels + offset >= 0) & (pixels + offset < camera.size)).all(axis=-1)
    pixels = pixels[in_full]
    if not len(pixels):
        return float("nan")
    height, width = alpha.shape
    in_crop = ((pixels >= 0) & (pixels < (width, height))).all(axis=-1)
    x, y = pixels[in_crop].T
    return float((alpha[y, x] > 0).sum() / len(pixels))


def _overlaps(offset: tuple[int, int], alpha: UInt8, size: tuple[int, int]) -> bool:
    extent = alpha.shape[::-1]
    return all(-extent[axis] < offset[axis] < size[axis] for axis in range(2))


def _mask_sentences(camera: str, masks: _Masks) -> Iterator[Finding]:
    for numbers, what in (
        (masks.empty, "empty masks, but marked valid"),
        (masks.beside, "crops that lie outside the picture"),
    ):
        if numbers:
            yield Finding(
                "error", "pictures/alpha", f"camera {camera}: {what}: in frames {listed(numbers)}"
            )
    if masks.full:
        yield Finding(
            "warning",
            "pictures/alpha",
            f"camera {camera}: masks fill the crop: in frames {listed(masks.full)}",
        )
    shares = np.array(masks.inside)
    shares = shares[np.isfinite(shares)]
    if len(masks.inside) and not len(shares):
        yield Finding(
            "error", "pictures/alpha", f"camera {camera}: the body is never in the picture"
        )
    elif len(shares) and shares.mean() < INSIDE_WARNING:
        yield Finding(
            "error" if shares.mean() < INSIDE_ERROR else "warning",
            "pictures/alpha",
            f"camera {camera}: {shares.mean():.0%} of the projected vertices are inside the mask "
            f"(expected {INSIDE_WARNING:.0%}): wrong calibration, fit, distortion or mask?",
        )
