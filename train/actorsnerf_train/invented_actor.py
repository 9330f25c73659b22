"""An invented person of balls along bones, for whoever has no prepared file: poses, views, samples.

Nothing is read and nobody is shown. All views of one seed show the same person consistently.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from actorsnerf_datasets.skeleton import BONES
from actorsnerf_datasets.torch_dataset import Sample, View
from actorsnerf_model.kinematics import bone_motions
from actorsnerf_model.projection import project
from actorsnerf_train.stability.hard_poses import dance_poses

BALL = 0.06
"""Radius of a ball, metres."""
BALLS_PER_BONE = 12
DISTANCE = 3.0
"""Metres from the camera to the person."""
_MIDDLE = (
    *((0.0, -0.22, 0.02), (0.0, -0.11, -0.01), (0.0, 0.03, 0.0)),
    *((0.0, 0.08, 0.03), (0.0, 0.29, -0.01), (0.0, 0.38, 0.04)),
)
"""Pelvis, the three spine joints, neck and head at rest, metres."""
_LEFT = (
    *((0.06, -0.31, 0.02), (0.10, -0.70, 0.01), (0.09, -1.10, -0.03), (0.12, -1.16, 0.09)),
    *((0.08, 0.19, 0.0), (0.17, 0.22, -0.02), (0.43, 0.21, -0.04), (0.68, 0.22, -0.04)),
    (0.76, 0.21, -0.06),
)
"""Left hip, knee, ankle, foot, collar, shoulder, elbow, wrist and hand in the T-pose, metres."""
_LEFT_JOINTS = [1, 4, 7, 10, 13, 16, 18, 20, 22]
_RIGHT_JOINTS = [2, 5, 8, 11, 14, 17, 19, 21, 23]
_MIDDLE_JOINTS = [0, 3, 6, 9, 12, 15]


def invented_joints() -> Float[Tensor, "24 3"]:
    """The joints of an invented adult at rest, metres, float64."""
    joints = torch.zeros(24, 3, dtype=torch.float64)
    joints[_MIDDLE_JOINTS] = torch.tensor(_MIDDLE, dtype=torch.float64)
    left = torch.tensor(_LEFT, dtype=torch.float64)
    joints[_LEFT_JOINTS] = left
    joints[_RIGHT_JOINTS] = left * left.new_tensor([-1.0, 1.0, 1.0])
    return joints


@dataclass(frozen=True)
class InventedActor:
    """Who the balls are."""

    joints: Float[Tensor, "24 3"]
    """At rest, metres."""
    vertices: Float[Tensor, "vertices 3"]
    """The balls' middles at rest, metres."""
    holder: Int[Tensor, "vertices"]
    """The joint that each ball hangs on."""
    colours: Float[Tensor, "vertices 3"]


def invented_actor(seed: int = 0) -> InventedActor:
    """The person of a seed; another seed has other colours and other lumps."""
    generator = torch.Generator().manual_seed(seed)
    joints = invented_joints()
    parents, children = torch.tensor(BONES).T
    share = torch.linspace(0, 1, BALLS_PER_BONE, dtype=torch.float64)[None, :, None]
    along = joints[parents][:, None] * (1 - share) + joints[children][:, None] * share
    lumps = torch.randn(along.shape, generator=generator, dtype=torch.float64)
    colours = torch.rand(len(BONES), 1, 3, generator=generator, dtype=torch.float64)
    return InventedActor(
        joints,
        (along + 0.01 * lumps).reshape(-1, 3),
        parents.repeat_interleave(BALLS_PER_BONE),
        (0.2 + 0.75 * colours).expand(-1, BALLS_PER_BONE, -1).reshape(-1, 3),
    )


def invented_view(
    actor: InventedActor, pose: Float[Tensor, "24 3"], angle: float, size: tuple[int, int]
) -> View:
    """The person in a pose, seen by a camera that has walked by an angle around it, float32.

    Args:
        actor: who.
        pose: axis-angle, radians; the root is zero.
        angle: radians about the vertical axis; 0 looks at the person's face.
        size: width, height in pixels.
    """
    motion = bone_motions(pose, actor.joints, actor.joints)[1][actor.holder]
    posed = (motion[:, :3, :3] @ actor.vertices[..., None])[..., 0] + motion[:, :3, 3]
    width, height = size
    focal = 1.25 * height
    K = pose.new_tensor([[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1]])
    camera = camera_around(pose.new_tensor([0.0, -0.35, 0.0]), angle, DISTANCE)
    image, alpha = _painted(posed, actor.colours, (K, camera), size)
    return View(
        image=image.float(),
        alpha=alpha.float(),
        K=K.float(),
        camera_from_body=camera.float(),
        pose=pose.float(),
        rest_joints=actor.joints.float(),
        rest_vertices=actor.vertices.float(),
        posed_vertices=posed.float(),
        canonical_joints=actor.joints.float(),
        actor="invented",
        camera=f"around {angle:.2f}",
        frame=0,
        offset=(0, 0),
        full_size=size,
    )


def invented_views(count: int, size: tuple[int, int], seed: int = 0) -> tuple[View, ...]:
    """Views of the invented person in dance-like poses, from all around."""
    actor = invented_actor(seed)
    poses = 0.4 * dance_poses(count, torch.Generator().manual_seed(seed))
    return tuple(
        invented_view(actor, pose, 2 * torch.pi * i / count, size) for i, pose in enumerate(poses)
    )


class InventedSource:
    """Samples of one invented person for a training; a function of seed and index alone."""

    def __init__(self, views: int, patches: tuple[int, int], size: tuple[int, int]) -> None:
        """Pictures are painted once.

        Args:
            views: support views of a sample.
            patches: how many a sample has, and their side in pixels.
            size: width, height of the pictures.
        """
        self.pictures = invented_views(max(8, views + 1), size)
        self.views = views
        self.patches = patches

    def __getitem__(self, index: int) -> Sample:
        """The sample of an index."""
        generator = torch.Generator().manual_seed(index)
        target = index % len(self.pictures)
        others = torch.randperm(len(self.pictures), generator=generator).tolist()
        supports = tuple(self.pictures[i] for i in others if i != target)[: self.views]
        view = self.pictures[target]
        count, side = self.patches
        corners = []
        for limit in reversed(view.alpha.shape):
            low = torch.randint(0, limit - side + 1, (count, 1, 1), generator=generator)
            corners.append(low)
        y, x = torch.meshgrid(torch.arange(side), torch.arange(side), indexing="ij")
        return Sample(view, supports, torch.stack([x + corners[0], y + corners[1]], -1))


def camera_around(
    target: Float[Tensor, "3"], angle: float, distance: float
) -> Float[Tensor, "4 4"]:
    """`camera_from_body` of an upright camera that looks at a point; OpenCV axes.

    Args:
        target: body frame, metres; in the middle of the picture.
        angle: radians about the body's vertical axis; 0 stands on the +z side.
        distance: metres.
    """
    turn = target.new_tensor(angle)
    forward = -torch.stack([turn.sin(), torch.zeros_like(turn), turn.cos()])
    down = target.new_tensor([0.0, -1.0, 0.0])
    rotation = torch.stack([torch.linalg.cross(down, forward), down, forward])
    camera = torch.eye(4, dtype=target.dtype, device=target.device)
    camera[:3, :3] = rotation
    camera[:3, 3] = rotation @ (distance * forward - target)
    return camera


def _painted(
    posed: Float[Tensor, "vertices 3"],
    colours: Float[Tensor, "vertices 3"],
    camera: tuple[Float[Tensor, "3 3"], Float[Tensor, "4 4"]],
    size: tuple[int, int],
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "height width"]]:
    """Every ball as a disc, near before far."""
    K, camera_from_body = camera
    seen = project(posed, K, camera_from_body)
    width, height = size
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    pixels = torch.stack([x, y], -1).to(posed)
    away = (pixels[:, :, None] - seen.pixels).norm(dim=-1)
    covers = (away < BALL * K[0, 0] / seen.depth) & seen.in_front
    nearest = torch.where(covers, seen.depth, torch.inf).argmin(-1)
    alpha = covers.any(-1)
    return colours[nearest] * alpha[..., None], alpha.to(posed.dtype)


__all__ = [
    "InventedActor",
    "InventedSource",
    "camera_around",
    "invented_actor",
    "invented_joints",
    "invented_view",
    "invented_views",
]
