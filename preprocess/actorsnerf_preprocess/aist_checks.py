"""Whether an AIST++ fit agrees with the data set's own keypoints and with common sense."""

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.cameras import camera_centre
from actorsnerf_datasets.types import Float64, Int64
from actorsnerf_preprocess.silhouettes import project_points
from actorsnerf_preprocess.source import Finding, SourceCamera, SourceError

SCALING_RANGE = (50.0, 150.0)
"""World units per SMPL metre that are plausible for centimetres."""
DISTANCE_RANGE = (1.0, 15.0)
"""Metres from a camera to the dancer that are plausible; the stage is about 5 m."""

SMPL_OF_COCO: tuple[tuple[int, int], ...] = (
    (5, 16),
    (6, 17),
    (7, 18),
    (8, 19),
    (9, 20),
    (10, 21),
    (11, 1),
    (12, 2),
    (13, 4),
    (14, 5),
    (15, 7),
    (16, 8),
)
"""(COCO keypoint, SMPL joint): shoulders, elbows, wrists, hips, knees, ankles; left first."""
_SIDES = ((5, 16, 6, 17), (11, 1, 12, 2))
"""COCO left, SMPL left, COCO right, SMPL right: shoulders and hips."""

_UNSYNCHRONISED_RATIO = 2.5
_UNSYNCHRONISED_SHARE = 0.02
"""Of the picture's height: less is no sign of anything."""
_MIN_SCORE = 0.3


def scaling_finding(scaling: float) -> tuple[Finding, ...]:
    """A warning if the scaling is no plausible number of centimetres per SMPL metre."""
    low, high = SCALING_RANGE
    if low <= scaling <= high:
        return ()
    return (
        Finding(
            "warning",
            "smpl_scaling",
            f"is {scaling:g}; {low:g} to {high:g} is plausible for a body measured in centimetres:"
            " the motion is of another unit or another model.",
        ),
    )


def require_plausible_distance(cameras: tuple[SourceCamera, ...], bodies: Float64) -> None:
    """Nothing, if the cameras stand a few metres from the body.

    Args:
        cameras: metres.
        bodies: (F, 3) world, metres.

    Raises:
        SourceError: cameras and motion are in different units.
    """
    middle = np.median(bodies, 0)
    distances = [float(np.linalg.norm(camera_centre(c.R, c.T) - middle)) for c in cameras]
    distance = float(np.median(distances))
    if not DISTANCE_RANGE[0] <= distance <= DISTANCE_RANGE[1]:
        raise SourceError(
            f"smpl_trans and cameras/: the cameras would stand {distance:.3g} m from the dancer,"
            f" {DISTANCE_RANGE[0]:g} to {DISTANCE_RANGE[1]:g} m is plausible: motion and cameras"
            " are in different units, or smpl_scaling is not this sequence's."
        )


def swapped_sides_finding(joints: Float64, keypoints: Float64) -> tuple[Finding, ...]:
    """A warning if the body's left side lies where the keypoints have the right side.

    The motions of January 2021 were fitted with a crossed joint table; they were replaced in
    March 2021 (`20210308_motions`).

    Args:
        joints: (F, 24, 3) posed SMPL joints, world, metres.
        keypoints: (F, 17, 3) `keypoints3d` of the same frames, world, metres; may hold NaN.
    """
    straight, crossed = [], []
    for coco_left, smpl_left, coco_right, smpl_right in _SIDES:
        left, right = joints[:, smpl_left], joints[:, smpl_right]
        straight += [left - keypoints[:, coco_left], right - keypoints[:, coco_right]]
        crossed += [left - keypoints[:, coco_right], right - keypoints[:, coco_left]]
    fit, cross = (_median_length(np.concatenate(pairs)) for pairs in (straight, crossed))
    if fit is None or cross is None or fit <= cross:
        return ()
    return (
        Finding(
            "warning",
            "keypoints3d",
            f"left and right of the body are swapped: {fit:.2f} m from the keypoints of the same"
            f" side, {cross:.2f} m from those of the other; these are the old motions of January"
            " 2021: download the release of March 2021 (20210308_motions).",
        ),
    )


def _median_length(differences: Float64) -> float | None:
    """The median length of the vectors (..., 3) without NaN; None if there is none."""
    lengths = np.linalg.norm(differences, axis=-1)
    seen = lengths[np.isfinite(lengths)]
    return float(np.median(seen)) if len(seen) else None


def keypoint_distances(
    camera: SourceCamera, joints: Float64, keypoints: Float64
) -> tuple[float, int]:
    """(median pixels between projected joints and detected keypoints, how many were compared).

    Args:
        camera: of the view.
        joints: (F, 24, 3) posed SMPL joints, world, metres.
        keypoints: (F, 17, 3) x, y, score of the same frames in this view.
    """
    coco, smpl = (list(side) for side in zip(*SMPL_OF_COCO, strict=True))
    pixels, in_front = project_points(joints[:, smpl].reshape(-1, 3), camera)
    seen = keypoints[:, coco].reshape(-1, 3)
    usable: NDArray[np.bool_] = np.isfinite(seen).all(1) & (seen[:, 2] >= _MIN_SCORE) & in_front
    if not usable.any():
        return float("nan"), 0
    return float(np.median(np.linalg.norm(pixels[usable] - seen[usable, :2], axis=1))), int(
        usable.sum()
    )


def keypoint_findings(
    cameras: tuple[SourceCamera, ...], joints: Float64, keypoints: Float64, frames: Int64
) -> tuple[Finding, ...]:
    """One note on the agreement of all views, and a warning for each that stands out.

    Args:
        cameras: the usable views.
        joints: (F, 24, 3) posed SMPL joints, world, metres.
        keypoints: (9, N, 17, 3) `keypoints2d`, pixels of the calibrated size.
        frames: (F,) rows of `keypoints` that belong to `joints`.
    """
    inside = frames < keypoints.shape[1]
    distances = {}
    for camera in cameras:
        if camera.source_index >= len(keypoints):
            continue
        seen = keypoints[camera.source_index][frames[inside]]
        distance, count = keypoint_distances(camera, joints[inside], seen)
        if count:
            distances[camera.name] = distance
    if not distances:
        return (Finding("note", "keypoints2d", "hold no keypoint of the usable views."),)
    middle = float(np.median(list(distances.values())))
    text = ", ".join(f"{name} {distance:.1f}" for name, distance in distances.items())
    findings = [Finding("note", "keypoints2d", f"median pixels to the projected joints: {text}.")]
    for camera in cameras:
        distance = distances.get(camera.name, 0.0)
        limit = max(_UNSYNCHRONISED_RATIO * middle, _UNSYNCHRONISED_SHARE * camera.size[1])
        if distance > limit:
            findings.append(
                Finding(
                    "warning",
                    camera.name,
                    f"the projected joints lie {distance:.0f} pixels from the detected keypoints,"
                    f" {middle:.0f} in the median view: its video is not synchronised, or its"
                    " calibration is wrong.",
                )
            )
    return tuple(findings)
