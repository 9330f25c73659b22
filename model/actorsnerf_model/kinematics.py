"""The skeleton in motion: each bone's rigid motion between a posed body and the canonical pose."""

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.skeleton import PARENTS
from actorsnerf_model.constants import constant
from actorsnerf_model.rotations import matrix_from_axis_angle

OBSERVATION_MARGIN = 0.3
"""Metres around the posed joints that can hold the person (released code)."""


def posed_frames(
    pose: Float[Tensor, "*batch 24 3"], rest_joints: Float[Tensor, "*batch 24 3"]
) -> tuple[Float[Tensor, "*batch 24 3 3"], Float[Tensor, "*batch 24 3"]]:
    """Orientation and place of every joint of the posed body, in the body frame.

    Args:
        pose: axis-angle of each joint relative to its parent, radians.
        rest_joints: of this body at rest, metres.
    """
    return chained_frames(matrix_from_axis_angle(pose), rest_joints)


def chained_frames(
    local: Float[Tensor, "*batch 24 3 3"], rest_joints: Float[Tensor, "*batch 24 3"]
) -> tuple[Float[Tensor, "*batch 24 3 3"], Float[Tensor, "*batch 24 3"]]:
    """The same from each joint's rotation relative to its parent."""
    rotations: list[Tensor] = [local[..., 0, :, :]]
    places: list[Tensor] = [rest_joints[..., 0, :]]
    with torch.autocast(local.device.type, enabled=False):  # half a precision is a centimetre off
        for joint, parent in enumerate(PARENTS[1:], start=1):
            offset = rest_joints[..., joint, :] - rest_joints[..., parent, :]
            rotations.append(rotations[parent] @ local[..., joint, :, :])
            places.append((rotations[parent] @ offset[..., None])[..., 0] + places[parent])
    return torch.stack(rotations, -3), torch.stack(places, -2)


def bone_motions(
    pose: Float[Tensor, "*batch 24 3"],
    rest_joints: Float[Tensor, "*batch 24 3"],
    canonical_joints: Float[Tensor, "24 3"],
) -> tuple[Float[Tensor, "*batch 24 4 4"], Float[Tensor, "*batch 24 4 4"]]:
    """`canonical_from_body` and `body_from_canonical` of every bone, in closed form.

    The canonical pose turns no joint, so with a joint's orientation R and place t in the posed
    body and its place j in the canonical one, they are [R^T | j - R^T t] and [R | t - R j].

    Args:
        pose: axis-angle of each joint relative to its parent, radians.
        rest_joints: of the posed body, metres.
        canonical_joints: of the canonical body, metres.

    Source: HumanNeRF's motion bases, inverted without a solver.
    """
    return motions_between(*posed_frames(pose, rest_joints), canonical_joints)


def motions_between(
    rotation: Float[Tensor, "*batch 24 3 3"],
    place: Float[Tensor, "*batch 24 3"],
    canonical_joints: Float[Tensor, "24 3"],
) -> tuple[Float[Tensor, "*batch 24 4 4"], Float[Tensor, "*batch 24 4 4"]]:
    """The motions of `bone_motions` from the posed joints' frames."""
    back = rotation.transpose(-1, -2)
    with torch.autocast(rotation.device.type, enabled=False):
        returned = (back @ place[..., None])[..., 0]
        carried = (rotation @ canonical_joints[..., None])[..., 0]
    canonical_from_body = _rigid(back, canonical_joints - returned)
    return canonical_from_body, _rigid(rotation, place - carried)


def observation_bounds(posed_joints: Float[Tensor, "24 3"]) -> Float[Tensor, "2 3"]:
    """The box that can hold the posed person: the joints and `OBSERVATION_MARGIN` around them."""
    low = posed_joints.amin(0) - OBSERVATION_MARGIN
    return torch.stack([low, posed_joints.amax(0) + OBSERVATION_MARGIN])


def _rigid(
    rotation: Float[Tensor, "*batch 3 3"], translation: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 4 4"]:
    top = torch.cat([rotation, translation[..., None]], -1)
    bottom = constant([0.0, 0.0, 0.0, 1.0], top).expand(*top.shape[:-2], 1, 4)
    return torch.cat([top, bottom], -2)


__all__ = [
    "OBSERVATION_MARGIN",
    "bone_motions",
    "chained_frames",
    "motions_between",
    "observation_bounds",
    "posed_frames",
]
