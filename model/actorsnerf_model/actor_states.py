"""What ActorsNeRF keeps of an actor, as frozen values: body, category prior, all of it."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.constants import constant
from actorsnerf_model.encoder import FeatureMap
from actorsnerf_model.kinematics import bone_motions
from actorsnerf_model.occupancy import OccupancyTables
from actorsnerf_model.pixel_features import SupportCameras
from actorsnerf_model.skinning import SkinningVolume, canonical_box
from actorsnerf_model.skinning_bounds import SkinningBounds
from actorsnerf_model.skinning_prior import log_prior
from actorsnerf_model.sparse_conv import FeatureLevel, SparseConfig
from actorsnerf_model.sparse_plan import SparsePlan, plan_sparse


@dataclass(frozen=True)
class ActorGeometry:
    """What follows from the body at rest alone: nothing learned, made once per actor."""

    canonical_joints: Float[Tensor, "24 3"]
    rest_vertices: Float[Tensor, "vertices 3"]
    box: Float[Tensor, "2 3"]
    """Lower and upper corner of the canonical box, metres."""
    log_prior: Float[Tensor, "25 z y x"]
    """Of the skinning volume."""
    plan: SparsePlan | None
    """None where the method has no body features."""


@dataclass(frozen=True)
class ActorBody:
    """How the actor moves, and how the support views saw it."""

    geometry: ActorGeometry
    cameras: SupportCameras
    body_from_canonical: Float[Tensor, "views 24 4 4"]
    """The bones' motions in the support views' frames."""
    skinning: SkinningVolume
    bounds: SkinningBounds
    """Where each bone can matter."""
    occupancy: OccupancyTables | None
    """What each pose's occupancy is looked up in; None where every sample is asked."""
    residual: Float[Tensor, "25 z y x"]
    """Learned logits that were added to the prior; the regulariser pulls them to zero."""


@dataclass(frozen=True)
class CategoryPrior:
    """What the category-level parts make of an actor; frozen, computed once, in few-shot."""

    body: ActorBody
    trunk: FeatureMap | None
    """The encoder's map; None where nothing reads pixels."""
    vertices: Float[Tensor, "vertices channels"] | None
    """What each vertex carries into the sparse network."""


@dataclass(frozen=True)
class UnreadMap:
    """A feature map and the linear layer that it still goes through, at the nodes that are read.

    A training step reads few of a map's nodes, about one in a hundred; the others would be computed
    for nothing, and their gradients would be zeros.
    """

    trunk: FeatureMap
    weight: Float[Tensor, "out channels"]


@dataclass(frozen=True)
class ActorsNeRFState:
    """All that rendering needs of an actor, whatever the pose and the camera."""

    body: ActorBody
    maps: FeatureMap | UnreadMap | None
    """The trunk's map through the linear layers that would follow its interpolation; with the
    layers still to be computed where a gradient is wanted, and None where nothing reads pixels."""
    levels: tuple[FeatureLevel, ...]
    """The diffused SMPL features; empty where the method has none."""
    window: float
    """Open octaves of the deformation's encoding; <= 0 leaves the deformation out."""


def actor_geometry(view: View, nodes: int, sparse: SparseConfig | None) -> ActorGeometry:
    """The geometry of the actor in any of its views.

    Args:
        view: only rest joints and rest vertices of the actor are read.
        nodes: of the skinning volume, per axis.
        sparse: None leaves the sparse plan out.
    """
    box = canonical_box(view.canonical_joints)
    plan = None
    if sparse is not None:
        plan = plan_sparse(view.rest_vertices, box, sparse.voxel, len(sparse.channels))
    prior = log_prior(view.canonical_joints, box, (nodes, nodes, nodes))
    return ActorGeometry(view.canonical_joints, view.rest_vertices, box, prior, plan)


def support_cameras(views: tuple[View, ...]) -> SupportCameras:
    """The views' cameras in one batch."""
    return SupportCameras(
        torch.stack([view.K for view in views]),
        torch.stack([view.camera_from_body for view in views]),
        torch.stack([_picture_edges(view) for view in views]),
    )


def _picture_edges(view: View) -> Float[Tensor, "2 2"]:
    (x, y), (width, height) = view.offset, view.full_size
    return constant([-x, -y, width - x, height - y], view.K).reshape(2, 2) - 0.5


def support_motions(
    views: tuple[View, ...], canonical_joints: Float[Tensor, "24 3"]
) -> Float[Tensor, "views 24 4 4"]:
    """Each bone's motion from the canonical pose to each view's pose."""
    poses = torch.stack([view.pose for view in views])
    rest = torch.stack([view.rest_joints for view in views])
    return bone_motions(poses, rest, canonical_joints)[1]


def check_supports(views: tuple[View, ...], expected: int) -> None:
    """Nothing, where these can be the support views of one actor.

    Raises:
        UserError: their number is not the model's, or they show several actors.
    """
    if len(views) != expected:
        raise UserError(
            f"{len(views)} support views were given, the model was built for {expected}: "
            "K is a size of the model; choose as many support frames, or train another model"
        )
    actors = sorted({view.actor for view in views})
    if len(actors) > 1:
        raise UserError(
            f"the support views show {len(actors)} actors ({', '.join(actors)}), expected one"
        )
