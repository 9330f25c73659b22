"""Poses that break renderers: folded, crossed, stretched, wound up; and random dancing."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.skeleton import JOINT_NAMES

SPREAD = {
    "hip": 0.7,
    "knee": 0.8,
    "ankle": 0.4,
    "foot": 0.2,
    "spine": 0.25,
    "neck": 0.3,
    "head": 0.3,
    "collar": 0.25,
    "shoulder": 0.8,
    "elbow": 0.8,
    "wrist": 0.4,
    "hand": 0.2,
}
"""How far dancers turn each joint, radians per axis (standard deviation), roughly."""
WILD_EVERY = 10
"""Of the dance-like poses, every tenth is `WILDER` times as far from rest."""
WILDER = 2.0
Turn = tuple[str, tuple[float, float, float]]
_NAMED: dict[str, tuple[Turn, ...]] = {
    "T-pose": (),
    "crouching": (
        *(("left_hip", (-2.2, 0.0, 0.3)), ("right_hip", (-2.2, 0.0, -0.3))),
        *(("left_knee", (2.5, 0.0, 0.0)), ("right_knee", (2.5, 0.0, 0.0))),
        *(("left_ankle", (-0.5, 0.0, 0.0)), ("right_ankle", (-0.5, 0.0, 0.0))),
        ("spine1", (0.6, 0.0, 0.0)),
    ),
    "splits": (
        *(("left_hip", (0.0, 0.0, 1.55)), ("right_hip", (0.0, 0.0, -1.55))),
        *(("left_shoulder", (0.0, 0.0, 1.4)), ("right_shoulder", (0.0, 0.0, -1.4))),
    ),
    "front split": (("left_hip", (-1.6, 0.0, 0.0)), ("right_hip", (1.6, 0.0, 0.0))),
    "legs pressed together": (
        *(("left_hip", (0.0, 0.0, -0.12)), ("right_hip", (0.0, 0.0, 0.12))),
        *(("left_shoulder", (0.0, 0.0, -1.45)), ("right_shoulder", (0.0, 0.0, 1.45))),
    ),
    "hands clasped": (
        *(("left_shoulder", (0.0, -0.9, -0.4)), ("right_shoulder", (0.0, 0.9, 0.4))),
        *(("left_elbow", (0.0, -1.35, 0.0)), ("right_elbow", (0.0, 1.35, 0.0))),
    ),
    "arms through the chest": (
        *(("left_shoulder", (0.0, 0.0, -1.0)), ("right_shoulder", (0.0, 0.0, 1.0))),
        *(("left_elbow", (0.0, 0.0, -2.6)), ("right_elbow", (0.0, 0.0, 2.6))),
    ),
    "arms straight down": (
        *(("left_shoulder", (0.0, 0.0, -math.pi / 2)), ("right_shoulder", (0.0, 0.0, math.pi / 2))),
    ),
    "bent double backwards": tuple((f"spine{i}", (-0.9, 0.0, 0.0)) for i in (1, 2, 3)),
    "collapsed: every joint at pi": tuple((name, (math.pi, 0.0, 0.0)) for name in JOINT_NAMES[1:]),
}


def named_poses() -> dict[str, Float[Tensor, "24 3"]]:
    """Hard poses by name, axis-angle, radians, float64; the root is zero."""
    poses = {}
    for name, turns in _NAMED.items():
        pose = torch.zeros(24, 3, dtype=torch.float64)
        for joint, turn in turns:
            pose[JOINT_NAMES.index(joint)] = torch.tensor(turn, dtype=torch.float64)
        poses[name] = pose
    return poses


def dance_poses(count: int, generator: torch.Generator) -> Float[Tensor, "count 24 3"]:
    """Random poses with the joints' spread of dancers, radians, float64; every tenth is wild.

    They are drawn joint by joint, so limbs pass through each other more often than a dancer's.
    """
    names = [name.removeprefix("left_").removeprefix("right_") for name in JOINT_NAMES]
    spread = [0.0, *(SPREAD[name.rstrip("123")] for name in names[1:])]
    drawn = torch.randn(count, 24, 3, generator=generator, dtype=torch.float64)
    poses = drawn * torch.tensor(spread, dtype=torch.float64)[:, None]
    poses[WILD_EVERY - 1 :: WILD_EVERY] *= WILDER
    return poses


def wound_up(pose: Float[Tensor, "24 3"]) -> Float[Tensor, "24 3"]:
    """The same pose with a whole turn more about the axis of every turned joint."""
    angle = pose.norm(dim=-1, keepdim=True)
    return torch.where(angle > 0, pose * (1 + 2 * math.pi / angle.clamp(min=1e-12)), pose)


def fastest(poses: Float[Tensor, "frames 24 3"], count: int) -> list[int]:
    """The frames between whose neighbours the joints turn farthest, fastest first.

    Args:
        poses: consecutive frames.
        count: how many frames; fewer where the motion is shorter.
    """
    speed = (poses[1:] - poses[:-1]).norm(dim=-1).sum(-1)
    frames: list[int] = (speed.argsort(descending=True)[:count] + 1).tolist()
    return frames


__all__ = ["dance_poses", "fastest", "named_poses", "wound_up"]
