"""ActorsNeRF in the published order of operations: what the reference renderer asks.

Features are read in the encoder's own channels, then go through their linear layers point by point;
every view's row goes through the whole network, and density and colour come together. `ActorsNeRF`
computes the same with layers moved; the two meet in warps and interpolation only.
"""

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import ActorsNeRFState, CategoryPrior
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.encoder import FeatureMap
from actorsnerf_model.pixel_features import read_features
from actorsnerf_model.skinning import forward_warp
from actorsnerf_model.sparse_conv import query
from actorsnerf_model.states import FieldValues, Located, PoseState


@dataclass(frozen=True)
class PublishedState:
    """All that the published order needs of an actor."""

    actor: ActorsNeRFState
    """Without feature maps."""
    trunk: FeatureMap | None
    """The encoder's map, before any linear layer; None where nothing reads pixels."""


class PublishedOrder:
    """A method's twin that shares its weights; implements the `Method` protocol of `states`."""

    reads_directions = False

    def __init__(self, method: ActorsNeRF) -> None:
        self.method = method

    def actor_state(self, supports: tuple[View, ...], window: float) -> PublishedState:
        """The method's, the encoder's map as it is."""
        return self.instance_state(self.method.category_prior(supports), window)

    def instance_state(self, prior: CategoryPrior, window: float) -> PublishedState:
        """The whole state from a category prior."""
        actor = self.method.instance_state(replace(prior, trunk=None), window)
        return PublishedState(actor, prior.trunk)

    def pose_state(
        self,
        actor: PublishedState,
        pose: Float[Tensor, "24 3"],
        rest_joints: Float[Tensor, "24 3"],
        frame: int | None = None,
    ) -> PoseState:
        """The method's own."""
        return self.method.pose_state(actor.actor, pose, rest_joints, frame)

    def locate(
        self,
        actor: PublishedState,
        pose: PoseState,
        points: Float[Tensor, "points 3"],
        threshold: float,
    ) -> Located:
        """The method's own."""
        return self.method.locate(actor.actor, pose, points, threshold)

    def field(self, actor: PublishedState, pose: PoseState, located: Located) -> FieldValues:
        """Colour and density at located points."""
        state, points = actor.actor, located.canonical
        low, high = state.body.geometry.box
        pixels = None
        if actor.trunk is not None:
            posed, _ = forward_warp(points, state.body.skinning, state.body.body_from_canonical)
            pixels = read_features(actor.trunk, state.body.cameras, posed)
        normal = (points - low) * (2 / (high - low)) - 1
        if self.method.deformation is not None and state.window > 0:
            normal = normal + self.method.deformation(normal, state.window, pose.pose, pixels)
            points = (normal + 1) * ((high - low) / 2) + low
        body = query(state.levels, points) if state.levels else None
        return FieldValues(*self.method.radiance(normal, pixels, body))


__all__ = ["PublishedOrder", "PublishedState"]
