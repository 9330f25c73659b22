"""Exact conversions between the global transforms that data sets use for SMPL.

The standard convention, the one stored: `v = R (x - j0) + j0 + transl`, where x is a vertex of the
posed body with zero root rotation, R the matrix of `global_orient` and j0 the rest pelvis of the
same betas. Leading axes are free; `j0` may be one for all.
"""

import numpy as np

from actorsnerf_datasets.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from actorsnerf_datasets.types import Float64

_GL_FROM_CV = np.diag([1.0, -1.0, -1.0, 1.0])


def world_from_body(global_orient: Float64, transl: Float64, j0: Float64) -> Float64:
    """Rigid transforms (..., 4, 4) from the body frame: `[R | transl + j0 - R j0]`.

    Args:
        global_orient: (..., 3) axis-angle about the pelvis, radians.
        transl: (..., 3) metres.
        j0: (..., 3) rest pelvis, metres.
    """
    rotation = matrix_from_axis_angle(global_orient)
    shape = np.broadcast_shapes(global_orient.shape, transl.shape, j0.shape)
    matrix = np.zeros((*shape[:-1], 4, 4))
    matrix[..., :3, :3] = rotation
    matrix[..., :3, 3] = transl + j0 - _turned(rotation, j0)
    matrix[..., 3, 3] = 1.0
    return matrix


def standard_from_world_from_body(matrix: Float64, j0: Float64) -> tuple[Float64, Float64]:
    """`(global_orient, transl)` of the rigid transforms (..., 4, 4): `world_from_body` undone."""
    rotation = matrix[..., :3, :3]
    transl: Float64 = matrix[..., :3, 3] - j0 + _turned(rotation, j0)
    return axis_angle_from_matrix(rotation), transl


def standard_from_easymocap(Rh: Float64, Th: Float64, j0: Float64) -> tuple[Float64, Float64]:
    """`(global_orient, transl)` of EasyMocap's `Rh`, `Th`, which turn about the SMPL origin.

    `v = R x + Th` (ZJU-MoCap), so `transl = Th + R j0 - j0`; the rotation is the same.

    Args:
        Rh: (..., 3) axis-angle, radians.
        Th: (..., 3) metres.
        j0: (..., 3) rest pelvis of the frame's betas, metres.
    """
    return Rh.copy(), Th + _turned(matrix_from_axis_angle(Rh), j0) - j0


def easymocap_from_standard(
    global_orient: Float64, transl: Float64, j0: Float64
) -> tuple[Float64, Float64]:
    """EasyMocap's `(Rh, Th)`, metres: `Th = transl + j0 - R j0`. Undoes `standard_from_easymocap`.

    >>> orient, transl = np.array([np.pi, 0.0, 0.0]), np.zeros(3)
    >>> Rh, Th = easymocap_from_standard(orient, transl, np.array([0.0, -0.25, 0.0]))
    >>> Th.round(12).tolist()
    [0.0, -0.5, 0.0]
    """
    turned = _turned(matrix_from_axis_angle(global_orient), j0)
    return global_orient.copy(), transl + j0 - turned


def folded_root(Rh: Float64, Th: Float64, root: Float64, j0: Float64) -> tuple[Float64, Float64]:
    """EasyMocap's `(Rh, Th)` with a root rotation folded in, so that the pose's root is zero.

    For files whose `poses[:3]` is not zero: `R = R(Rh) R(root)`, `Th + R(Rh) (j0 - R(root) j0)`.

    Args:
        Rh: (..., 3) axis-angle, radians.
        Th: (..., 3) metres.
        root: (..., 3) the pose's first three numbers, axis-angle, radians.
        j0: (..., 3) rest pelvis, metres.
    """
    outer, inner = matrix_from_axis_angle(Rh), matrix_from_axis_angle(root)
    return axis_angle_from_matrix(outer @ inner), Th + _turned(outer, j0 - _turned(inner, j0))


def metres_from_aist(translation: Float64, scaling: float) -> Float64:
    """AIST++ translations in metres: those of the body (`smpl_trans`) and of the cameras alike.

    AIST++ has `v = s (R (x - j0) + j0) + t` in centimetres with one scaling s per sequence, so in
    units of the SMPL body everything is divided by s: `transl = t / s`, the camera's `T / s`. The
    projection does not change, and the body is SMPL's own size.

    Args:
        translation: (..., 3) centimetres.
        scaling: `smpl_scaling`, about 100.
    """
    return translation / scaling


def aist_from_metres(translation: Float64, scaling: float) -> Float64:
    """AIST++'s scaled centimetres of translations in metres; undoes `metres_from_aist`."""
    return translation * scaling


def opengl_from_opencv(world_from_camera: Float64) -> Float64:
    """Camera poses (..., 4, 4) for x right, y up, z backward (OpenGL, Blender, nerfstudio).

    Args:
        world_from_camera: OpenCV camera (x right, y down, z forward) to world. Not the stored
            R, T, which go the other way.
    """
    return world_from_camera @ _GL_FROM_CV


def _turned(rotation: Float64, vector: Float64) -> Float64:
    turned: Float64 = (rotation @ vector[..., None])[..., 0]
    return turned
