"""What a real lens makes of drawn meshes: distorted pictures with soft edges, on a backdrop."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from actorsnerf_datasets.types import Float32, Float64, UInt8
from actorsnerf_preprocess.renderer import Drawing, Lighting, Mesh, MeshRenderer, Pinhole

FINER = 2
"""Pictures are drawn with this many pixels per pixel side and averaged, so that edges are soft."""
MARGIN = 8
"""Pixels drawn around the projected person."""
ROUND_UP = 64
"""Canvas sides are multiples of this, so that buffers are seldom made anew."""
UNKNOWN_PART = 10
"""Label (torso) of the few pixels whose part falls between two samples."""


@dataclass(frozen=True)
class Lens:
    """A real lens: the pinhole behind it and its distortion."""

    pinhole: Pinhole
    distortion: Float64
    """(5,) k1 k2 p1 p2 k3 (OpenCV)."""


@dataclass(frozen=True)
class Rig:
    """A lens in front of its backdrop, with the table that bends pictures; made once per camera."""

    lens: Lens
    backdrop: UInt8
    """(H, W, 3) the empty stage as the camera sees it."""
    straight: Float32
    """(H * FINER, W * FINER, 2) where each fine distorted pixel lies in the fine pinhole's."""


@dataclass(frozen=True)
class View:
    """An undistorted drawing of the person, cut to it."""

    drawing: Drawing
    camera: Pinhole


@dataclass(frozen=True)
class Shot:
    """What one camera sees."""

    rgb: UInt8
    """(H, W, 3) distorted, on the backdrop."""
    coverage: Float32
    """(H, W) the person's share of each pixel."""
    labels: UInt8
    """(H, W) part labels of the pixels that are at least half covered, 0 elsewhere."""
    view: View | None
    """What it was made from; None: the person is out of the picture."""


def rig_of(lens: Lens, backdrop: UInt8) -> Rig:
    """The lens with its backdrop and bending table."""
    fine = lens.pinhole.finer(FINER)
    width, height = fine.size
    seen = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    straight = cv2.undistortPoints(
        seen.reshape(-1, 1, 2), fine.K, lens.distortion, P=fine.K
    ).reshape(height, width, 2)
    return Rig(lens, backdrop, straight.astype(np.float32))


def take(renderer: MeshRenderer, meshes: Sequence[Mesh], rig: Rig, lighting: Lighting) -> Shot:
    """The picture that the rig's lens makes of the meshes."""
    width, height = rig.lens.pinhole.size
    left, top, right, bottom = _box(meshes, rig.lens)
    if right <= left or bottom <= top:
        nothing = np.zeros((height, width), dtype=np.uint8)
        return Shot(rig.backdrop, nothing.astype(np.float32), nothing, None)
    straight = rig.straight[top * FINER : bottom * FINER, left * FINER : right * FINER]
    view = _view(renderer, meshes, rig, straight, lighting)
    return _developed(rig, view, straight, (left, top, right, bottom))


def _box(meshes: Sequence[Mesh], lens: Lens) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the distorted person with a margin, cut at the picture."""
    points = np.concatenate([mesh.vertices[::3] for mesh in meshes]).astype(np.float64)
    pinhole = lens.pinhole
    rotation = cv2.Rodrigues(pinhole.R)[0]
    seen = cv2.projectPoints(points, rotation, pinhole.T, pinhole.K, lens.distortion)[0][:, 0]
    low = np.floor(seen.min(axis=0)).astype(int) - MARGIN
    high = np.ceil(seen.max(axis=0)).astype(int) + MARGIN + 1
    width, height = pinhole.size
    left, right = np.clip([low[0], high[0]], 0, width)
    top, bottom = np.clip([low[1], high[1]], 0, height)
    return int(left), int(top), int(right), int(bottom)


def _view(
    renderer: MeshRenderer,
    meshes: Sequence[Mesh],
    rig: Rig,
    straight: Float32,
    lighting: Lighting,
) -> View:
    """The drawing of all that `straight` looks up, on a canvas that holds just that."""
    fine = rig.lens.pinhole.finer(FINER)
    low = np.floor(straight.min(axis=(0, 1))).astype(int) - 1
    high = np.ceil(straight.max(axis=(0, 1))).astype(int) + 2
    columns, rows = (int(-(-side // ROUND_UP) * ROUND_UP) for side in high - low)
    K = fine.K.copy()
    K[:2, 2] -= low
    camera = Pinhole(K, fine.R, fine.T, (columns, rows))
    return View(renderer.draw(meshes, camera, lighting), camera)


def _developed(rig: Rig, view: View, straight: Float32, box: tuple[int, int, int, int]) -> Shot:
    """The drawing bent by the lens, averaged, and laid over the backdrop."""
    left, top, right, bottom = box
    size = (right - left, bottom - top)
    shift = view.camera.K[:2, 2] - rig.lens.pinhole.finer(FINER).K[:2, 2]
    places = straight + shift.astype(np.float32)
    lookup = (np.ascontiguousarray(places[..., 0]), np.ascontiguousarray(places[..., 1]))
    drawn = np.concatenate(
        [view.drawing.rgb, np.where(view.drawing.labels > 0, 255, 0).astype(np.uint8)[..., None]], 2
    )
    bent = cv2.remap(drawn, *lookup, cv2.INTER_LINEAR)
    small = cv2.resize(bent, size, interpolation=cv2.INTER_AREA)
    share = small[..., 3].astype(np.float32) / 255
    labels = np.asarray(cv2.remap(view.drawing.labels, *lookup, cv2.INTER_NEAREST))
    labels = labels.reshape(size[1], FINER, size[0], FINER).max(axis=(1, 3))
    labels = np.where(share >= 0.5, np.where(labels == 0, UNKNOWN_PART, labels), 0)
    inside = (slice(top, bottom), slice(left, right))
    rgb = rig.backdrop.copy()
    mixed = small[..., :3] + (1 - share[..., None]) * rgb[inside]
    rgb[inside] = np.clip(np.rint(mixed), 0, 255).astype(np.uint8)
    coverage = np.zeros(rgb.shape[:2], dtype=np.float32)
    coverage[inside] = share
    whole = np.zeros(rgb.shape[:2], dtype=np.uint8)
    whole[inside] = labels
    return Shot(rgb, coverage, whole, view)
