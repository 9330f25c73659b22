"""What the skeleton alone says about skinning: a Gaussian around every bone of the canonical body.

Source: released code, which HumanNeRF shares. Two mends: the logarithm has a floor, and no Gaussian
is narrower than the grid can show.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.skeleton import JOINT_NAMES, PARENTS

BONE_ACROSS = 0.03
"""Metres across a bone; the Gaussian is exp(-(d / (2 sigma))^2)."""
BONE_ALONG = 0.06
"""Metres along a bone, whatever its length."""
TORSO_WIDER = 1.5
"""Times `BONE_ACROSS` around the trunk."""
HEAD = 0.06
"""Metres, round."""
LEAF = 0.02
"""Metres, round: hands and toes."""
LEAST_SIGMA = 0.25
"""Share of the widest node spacing under which no sigma goes. At the released 32 nodes over an
adult (7 cm) it changes nothing; on a coarser grid a hand would fall between the nodes."""
PRIOR_FLOOR = 1e-12
"""Under the logarithm. The released code has none: 62 % of its logits are -inf and can never be
learned. So small that 24 floors never matter beside the threshold 0.01."""
TORSO = ("pelvis", "spine1", "spine2", "spine3", "left_collar", "right_collar")


def log_prior(
    canonical_joints: Float[Tensor, "24 3"],
    box: Float[Tensor, "2 3"],
    sizes: tuple[int, int, int],
) -> Float[Tensor, "25 z y x"]:
    """Logarithm of `bone_prior`, never below ln `PRIOR_FLOOR`."""
    return bone_prior(canonical_joints, box, sizes).clamp(min=PRIOR_FLOOR).log()


def bone_prior(
    canonical_joints: Float[Tensor, "24 3"],
    box: Float[Tensor, "2 3"],
    sizes: tuple[int, int, int],
) -> Float[Tensor, "25 z y x"]:
    """Each bone's share of each node, and the background's last; they sum to 1.

    A joint with children has a Gaussian at the middle of each bone to a child, a leaf has a round
    one at itself. A bone's Gaussian is round about its axis, so only its direction is needed and no
    frame: any direction is as good as another, straight down included.

    Args:
        canonical_joints: metres.
        box: lower and upper corner of the grid, metres.
        sizes: nodes in z, y, x; the outermost lie on the box's faces.
    """
    grid = grid_nodes(box, sizes)
    spacing = (box[1] - box[0]) / box.new_tensor([size - 1 for size in reversed(sizes)])
    least = LEAST_SIGMA * spacing.amax()
    channels = [torch.zeros_like(grid[..., 0]) for _ in PARENTS]
    for joint, parent in enumerate(PARENTS):
        if parent < 0:
            continue
        wider = TORSO_WIDER if JOINT_NAMES[parent] in TORSO else 1.0
        ends = canonical_joints[[parent, joint]]
        sigmas = grid.new_tensor([BONE_ACROSS * wider, BONE_ALONG]).maximum(least)
        channels[parent] = channels[parent] + _bone_gaussian(grid, ends, sigmas)
    for joint in sorted(set(range(24)) - set(PARENTS)):
        size = HEAD if JOINT_NAMES[joint] == "head" else LEAF
        sigmas = grid.new_tensor([size, size]).maximum(least)
        channels[joint] = _bone_gaussian(grid, canonical_joints[[joint, joint]], sigmas)
    bones = torch.stack(channels)
    background = 1 - bones.sum(0, keepdim=True).clamp(0, 1)
    everything = torch.cat([bones, background])
    return everything / everything.sum(0, keepdim=True)


def grid_nodes(box: Float[Tensor, "2 3"], sizes: tuple[int, int, int]) -> Float[Tensor, "z y x 3"]:
    """Places x, y, z of a box's nodes, faces included.

    Args:
        box: lower and upper corner.
        sizes: nodes in z, y, x.
    """
    axes = [
        low + (high - low) * torch.linspace(0, 1, size, dtype=box.dtype, device=box.device)
        for low, high, size in zip(box[0], box[1], reversed(sizes), strict=True)
    ]
    z, y, x = torch.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    return torch.stack([x, y, z], -1)


def _bone_gaussian(
    grid: Float[Tensor, "z y x 3"], ends: Float[Tensor, "2 3"], sigmas: Float[Tensor, "2"]
) -> Float[Tensor, "z y x"]:
    """exp(-(across / 2 s0)^2 - (along / 2 s1)^2) about the middle of a bone."""
    bone = ends[1] - ends[0]
    # A bone without length has no direction; zero makes its Gaussian round.
    direction = bone / bone.norm().clamp(min=1e-8)
    away = grid - ends.mean(0)
    along = (away * direction).sum(-1)  # no matrix product: autocast would halve its precision
    across = ((away * away).sum(-1) - along * along).clamp(min=0)
    return torch.exp(-across / (2 * sigmas[0]) ** 2 - (along / (2 * sigmas[1])) ** 2)


__all__ = ["bone_prior", "grid_nodes", "log_prior"]
