"""Whether the body fits of a sequence agree with themselves, and with a body model."""

from collections.abc import Iterator

import numpy as np

from actorsnerf_datasets import body_model
from actorsnerf_datasets.body_model import BodyModel
from actorsnerf_datasets.conventions import world_from_body
from actorsnerf_datasets.errors import BodyModelError
from actorsnerf_datasets.findings import Finding, listed
from actorsnerf_datasets.skeleton import posed_joints
from actorsnerf_datasets.types import Float64, SequenceHeader

HEIGHT_METRES = (0.5, 2.5)
"""Plausible heights of a person at rest, head to toe (a child to a giant)."""
JOINT_TOLERANCE = 1e-5
"""Metres."""
VERTEX_TOLERANCE = 1e-3
"""Metres between a vertex of the source and the body model's. Preparation accepts, and stores as
they are, vertices that come this near, and the check then accepts them too. The right fit and model
meet them to micrometres (single precision, and the digits of another copy of the model); a fit
posed otherwise, another person's or another gender's model miss them by centimetres. One millimetre
is a fifth of a pixel of the stored pictures of a person 3 m away."""
REST_TOLERANCE = 1e-4
"""Metres: rest vertices are always made from the body model, and stored in single precision."""
TRANSFORM_TOLERANCE = 1e-6
"""Metres, and entries of a rotation."""
BODY_MARGIN = 0.3
"""Metres that a joint may lie outside the box of the vertices."""
MEAN_TOLERANCE = 1e-4
"""Metres between the actor's rest joints and the mean of the frames'."""


def fit_findings(header: SequenceHeader) -> Iterator[Finding]:
    """What is wrong with the fits: numbers, units, and parts that contradict each other."""
    broken = list(_not_finite(header))
    yield from broken
    if broken:
        return
    yield from _height(header)
    yield from _joints(header)
    yield from _transforms(header)
    yield from _vertices_around_joints(header)
    yield from _actor(header)


def body_model_findings(header: SequenceHeader, model: BodyModel) -> Iterator[Finding]:
    """Where the stored body differs from the model's, posed anew.

    The fits may be with or without pose blend shapes; whichever is closer on the first frame is
    used for all, and a note says so if it is without.
    """
    fits = header.fits
    if fits.posed_vertices.shape[1] != len(model.template):
        yield Finding(
            "error",
            "fits/posed_vertices",
            f"{fits.posed_vertices.shape[1]} vertices, but the body model has "
            f"{len(model.template)}: is it the model that the fits were made with?",
        )
        return
    try:
        blends = {blend: _vertex_errors(header, model, blend, 1)[0] for blend in (True, False)}
        blend = bool(blends[True] <= blends[False])
        errors = _vertex_errors(header, model, blend, len(header.frames))
        _, rest_vertices = body_model.rest(model, header.shape.betas)
    except BodyModelError as error:
        yield Finding("error", "fits/betas", str(error))
        return
    if not blend:
        yield Finding("note", "fits/posed_vertices", "posed without pose blend shapes")
    yield from _too_far(header, "fits/posed_vertices", errors, VERTEX_TOLERANCE)
    rest_error = float(abs(rest_vertices - header.shape.rest_vertices).max())
    if rest_error > REST_TOLERANCE:
        yield Finding(
            "error",
            "actor/rest_vertices",
            f"{rest_error:.2g} m from the body model's: is it the model that the fits were made "
            "with?",
        )


def _vertex_errors(header: SequenceHeader, model: BodyModel, blend: bool, count: int) -> Float64:
    """The largest distance of a vertex of each of the first frames from the model's, metres."""
    errors: list[float] = []
    for frame in range(count):
        pose = np.concatenate([np.zeros((1, 3)), header.fits.body_pose[frame]])
        posed = body_model.pose(model, header.fits.betas[frame], pose, pose_blend=blend)
        apart = posed.vertices - header.fits.posed_vertices[frame]
        errors.append(float(np.linalg.norm(apart, axis=1).max()))
    return np.array(errors)


def _not_finite(header: SequenceHeader) -> Iterator[Finding]:
    groups = {"fits": header.fits, "actor": header.shape}
    for group, record in groups.items():
        for name, array in vars(record).items():
            bad = ~np.isfinite(array)
            if not bad.any():
                continue
            rows = bad.reshape(len(array), -1).any(axis=1)
            where = f" in frames {listed(header.frames[rows].tolist())}" if group == "fits" else ""
            yield Finding("error", f"{group}/{name}", f"has NaN or infinity{where}")
    if not np.isclose(np.linalg.norm(header.world_up), 1.0):
        yield Finding("error", "world_up", f"is no unit vector: {header.world_up.tolist()}")


def _height(header: SequenceHeader) -> Iterator[Finding]:
    height = float(np.ptp(header.shape.rest_vertices, axis=0)[1])
    low, high = HEIGHT_METRES
    if not low <= height <= high:
        yield Finding(
            "error",
            "actor/rest_vertices",
            f"the person is {height:.4g} m tall (y at rest), expected {low:g} to {high:g}: are "
            "they metres, y up?",
        )


def _joints(header: SequenceHeader) -> Iterator[Finding]:
    fits = header.fits
    pose = np.concatenate([np.zeros((len(fits.body_pose), 1, 3)), fits.body_pose], axis=1)
    errors = abs(posed_joints(pose, fits.rest_joints) - fits.posed_joints).max(axis=(1, 2))
    yield from _too_far(header, "fits/posed_joints", errors, JOINT_TOLERANCE)


def _transforms(header: SequenceHeader) -> Iterator[Finding]:
    fits = header.fits
    expected = world_from_body(fits.global_orient, fits.transl, fits.rest_joints[:, 0])
    errors = abs(fits.world_from_body - expected).max(axis=(1, 2))
    yield from _too_far(header, "fits/world_from_body", errors, TRANSFORM_TOLERANCE)


def _vertices_around_joints(header: SequenceHeader) -> Iterator[Finding]:
    vertices, joints = header.fits.posed_vertices, header.fits.posed_joints
    low, high = vertices.min(axis=1)[:, None], vertices.max(axis=1)[:, None]
    outside = np.maximum(low - joints, joints - high).max(axis=(1, 2))
    worst = int(np.argmax(outside))
    if outside[worst] > BODY_MARGIN:
        yield Finding(
            "error",
            "fits/posed_vertices",
            f"in frame {header.frames[worst]} a joint lies {outside[worst]:.3g} m outside the "
            "vertices: are they in the world instead of the body frame?",
        )


def _actor(header: SequenceHeader) -> Iterator[Finding]:
    apart = float(abs(header.fits.rest_joints.mean(axis=0) - header.shape.rest_joints).max())
    if apart > MEAN_TOLERANCE:
        yield Finding(
            "warning",
            "actor/rest_joints",
            f"{apart:.2g} m from the mean of the frames' rest joints: do actor and fits belong "
            "together?",
        )


def _too_far(
    header: SequenceHeader, entry: str, errors: Float64, tolerance: float
) -> Iterator[Finding]:
    bad = errors > tolerance
    if bad.any():
        yield Finding(
            "error",
            entry,
            f"up to {errors.max():.2g} m from what the pose gives (at most {tolerance:g} is "
            f"expected), in frames {listed(header.frames[bad].tolist())}",
        )
