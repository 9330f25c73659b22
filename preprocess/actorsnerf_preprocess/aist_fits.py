"""AIST++ motions in the standard convention: metres, turned about the pelvis, zero betas."""

import numpy as np

from actorsnerf_datasets.body_model import BodyModel, pose, rest
from actorsnerf_datasets.conventions import metres_from_aist, world_from_body
from actorsnerf_datasets.types import ActorShape, BodyFits, Float64, Int64
from actorsnerf_preprocess.aist_annotations import JOINTS, Motion

BETA_COUNT = 10
"""Shape was never fitted: all are zero, and the size of the dancer is in the scaling alone."""


def fits_of_motion(motion: Motion, frames: Int64, model: BodyModel) -> tuple[BodyFits, ActorShape]:
    """(fits of the given frames, the actor at rest).

    AIST++ has `v = s (R (x - j0) + j0) + t` in centimetres. Divided by s, lengths are those of
    the SMPL body: `transl = t / s`, and `world_from_body` turns about the pelvis. The released
    preparation uses `t / s` as if the body turned about the origin, and so shifts its body frame
    by `R^T j0 - j0`, another shift in each frame.

    Args:
        motion: as found.
        frames: frame numbers, each less than the motion's length.
        model: SMPL's male model is what AIST++ was fitted with.
    """
    betas = np.zeros(BETA_COUNT)
    rest_joints, rest_vertices = rest(model, betas)
    poses = motion.poses[frames]
    transl = metres_from_aist(motion.translation[frames], motion.scaling)
    joints = np.empty((len(frames), JOINTS, 3))
    vertices = np.empty((len(frames), len(rest_vertices), 3), np.float32)
    for row, axis_angles in enumerate(poses):
        posed = pose(model, betas, np.concatenate([np.zeros((1, 3)), axis_angles[1:]]))
        joints[row], vertices[row] = posed.joints, posed.vertices
    fits = BodyFits(
        global_orient=poses[:, 0].copy(),
        transl=transl,
        body_pose=poses[:, 1:].copy(),
        betas=np.zeros((len(frames), BETA_COUNT)),
        world_from_body=world_from_body(poses[:, 0], transl, rest_joints[0]),
        rest_joints=np.broadcast_to(rest_joints, (len(frames), JOINTS, 3)).copy(),
        posed_joints=joints,
        posed_vertices=vertices,
    )
    return fits, ActorShape(betas, rest_joints, rest_vertices.astype(np.float32))


def world_joints(fits: BodyFits) -> Float64:
    """(F, 24, 3) posed joints in the world frame, metres."""
    rotation, translation = fits.world_from_body[:, :3, :3], fits.world_from_body[:, :3, 3]
    turned: Float64 = np.einsum("fij,fnj->fni", rotation, fits.posed_joints)
    return turned + translation[:, None]
