"""Whether the cameras of a sequence can be right."""

from collections.abc import Iterator

import numpy as np

from actorsnerf_datasets.cameras import camera_centre, scaled_intrinsics
from actorsnerf_datasets.findings import Finding
from actorsnerf_datasets.types import Camera, SequenceHeader

ROTATION_TOLERANCE = 1e-6
DISTANCE_METRES = (1.0, 20.0)
"""Plausible distances between a camera and the person."""
SCALE_TOLERANCE_PIXELS = 0.1
"""A forgotten half pixel shows as 0.25 at scale 0.5."""


def camera_findings(header: SequenceHeader) -> Iterator[Finding]:
    """What is wrong with the cameras, one by one."""
    for camera in header.cameras:
        yield from _finite(camera)
        yield from _rotation(camera)
        yield from _intrinsics(camera, header.provenance.scale)
        yield from _distance(camera, header)


def _finite(camera: Camera) -> Iterator[Finding]:
    for name in ("K", "R", "T", "source_K", "source_distortion"):
        if not np.isfinite(getattr(camera, name)).all():
            yield Finding("error", f"cameras/{name}", f"camera {camera.name} has NaN or infinity")


def _rotation(camera: Camera) -> Iterator[Finding]:
    deviation = float(abs(camera.R @ camera.R.T - np.eye(3)).max())
    if deviation > ROTATION_TOLERANCE:
        yield Finding(
            "error",
            "cameras/R",
            f"camera {camera.name}: R deviates from orthonormal by {deviation:.2g}: is it no "
            "rotation, or scaled?",
        )
    elif np.linalg.det(camera.R) < 0:
        yield Finding(
            "error",
            "cameras/R",
            f"camera {camera.name}: R is left-handed (determinant -1): was an axis flipped for "
            "another camera convention?",
        )


def _intrinsics(camera: Camera, scale: float) -> Iterator[Finding]:
    K, (width, height) = camera.K, camera.size
    if not (K[0, 0] > 0 and K[1, 1] > 0 and np.array_equal(K[2], [0.0, 0.0, 1.0])):
        yield Finding("error", "cameras/K", f"camera {camera.name}: no intrinsics: {K.tolist()}")
    elif not (0 < K[0, 2] < width and 0 < K[1, 2] < height):
        yield Finding(
            "warning",
            "cameras/K",
            f"camera {camera.name}: the optical axis meets ({K[0, 2]:.0f}, {K[1, 2]:.0f}), outside "
            f"the picture of {width} x {height}: does K belong to another size?",
        )
    difference = float(abs(K - scaled_intrinsics(camera.source_K, scale)).max())
    if difference > SCALE_TOLERANCE_PIXELS:
        yield Finding(
            "warning",
            "cameras/K",
            f"camera {camera.name}: K is {difference:.2g} px off the source's K at scale {scale:g}",
        )
    expected = [round(size * scale) for size in camera.source_size]
    if max(abs(a - b) for a, b in zip(camera.size, expected, strict=True)) > 1:
        yield Finding(
            "warning",
            "cameras/size",
            f"camera {camera.name}: {camera.size}, but the source's size at scale {scale:g} is "
            f"{tuple(expected)}",
        )


def _distance(camera: Camera, header: SequenceHeader) -> Iterator[Finding]:
    pelvis = header.fits.rest_joints[:, 0]
    world_from_body = header.fits.world_from_body
    world = np.einsum("fij,fj->fi", world_from_body[:, :3, :3], pelvis) + world_from_body[:, :3, 3]
    away = float(np.median(np.linalg.norm(world - camera_centre(camera.R, camera.T), axis=-1)))
    low, high = DISTANCE_METRES
    if not low <= away <= high:
        yield Finding(
            "error",
            "cameras/T",
            f"camera {camera.name} is {away:.4g} m from the person, expected {low:g} to {high:g}: "
            "are the units of the camera and of the body different?",
        )
