"""Rotation matrices and axis-angle vectors, exact in float64; leading axes are free."""

import numpy as np

from actorsnerf_datasets.types import Float64


def matrix_from_axis_angle(axis_angle: Float64) -> Float64:
    """Rotation matrices (..., 3, 3) of the axis-angle vectors (..., 3).

    Goes through the unit quaternion, so the result is orthogonal to rounding for any angle and
    smooth at zero.

    Args:
        axis_angle: radians; the length is the angle, any size.

    >>> matrix_from_axis_angle(np.array([0.0, 0.0, np.pi / 2])).round(12).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    angle = np.linalg.norm(axis_angle, axis=-1, keepdims=True)
    tiny = angle < 1e-100
    half_sinc = np.where(tiny, 0.5, np.sin(angle / 2) / np.where(tiny, 1.0, angle))
    quaternion = np.concatenate([np.cos(angle / 2), axis_angle * half_sinc], axis=-1)
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def axis_angle_from_matrix(matrix: Float64) -> Float64:
    """Axis-angle vectors (..., 3) of the rotation matrices (..., 3, 3).

    The angle lies in [0, pi]; at pi either sign of the axis is right and one is returned. Accurate
    at 0 and at pi, because the largest quaternion component is divided by.

    Args:
        matrix: rotations; small deviations from orthogonality are averaged out, not refused.

    >>> axis_angle_from_matrix(np.diag([1.0, -1.0, -1.0])).round(12).tolist()
    [3.14159265359, 0.0, 0.0]
    """
    quaternion = _quaternion_from_matrix(matrix)
    quaternion = np.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    vector = quaternion[..., 1:]
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    tiny = sine < 1e-100
    angle = 2 * np.arctan2(sine, quaternion[..., :1])
    scale: Float64 = np.where(tiny, 2.0, angle / np.where(tiny, 1.0, sine))
    return vector * scale


def _quaternion_from_matrix(matrix: Float64) -> Float64:
    """Unit quaternions w x y z: of four equivalent forms, the one with the largest divisor."""
    m = matrix
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    wx, wy, wz = (
        m[..., 2, 1] - m[..., 1, 2],
        m[..., 0, 2] - m[..., 2, 0],
        m[..., 1, 0] - m[..., 0, 1],
    )
    xy, xz, yz = (
        m[..., 0, 1] + m[..., 1, 0],
        m[..., 0, 2] + m[..., 2, 0],
        m[..., 1, 2] + m[..., 2, 1],
    )
    squares = [1 + trace] + [1 - trace + 2 * m[..., axis, axis] for axis in range(3)]
    forms = (
        (squares[0], wx, wy, wz),
        (wx, squares[1], xy, xz),
        (wy, xy, squares[2], yz),
        (wz, xz, yz, squares[3]),
    )
    candidates = np.stack([np.stack(form, axis=-1) for form in forms], axis=-2)
    largest = np.argmax(np.stack(squares, axis=-1), axis=-1)[..., None, None]
    quaternion: Float64 = np.take_along_axis(candidates, largest, axis=-2)[..., 0, :]
    length: Float64 = np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return quaternion / length
