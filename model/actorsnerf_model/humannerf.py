"""HumanNeRF (Weng et al., CVPR 2022): one person from one video, without a category to begin from.

Its skeleton is ActorsNeRF's (which grew out of its code): the same skinning volume, backward warp,
cull and renderer. What differs: a pose refiner, a non-rigid motion and a canonical field of its own
that read no picture; metres instead of normalised coordinates; opacity times likelihood
(`RenderOptions.soft_mask`).
"""

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor, nn

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.canonical_networks import (
    CanonicalConfig,
    CanonicalField,
    MotionConfig,
    NonRigidMotion,
    PoseRefiner,
    RefinerConfig,
)
from actorsnerf_model.kinematics import (
    chained_frames,
    motions_between,
    observation_bounds,
    posed_frames,
)
from actorsnerf_model.learned_method import LearnedMethod
from actorsnerf_model.occupancy import (
    OccupancyTables,
    asks_every_sample,
    occupancy_tables,
    pose_occupancy,
)
from actorsnerf_model.skinning import SkinningVolume, skinning_volume
from actorsnerf_model.skinning_bounds import SkinningBounds, locate, skinning_bounds
from actorsnerf_model.skinning_decoder import SkinningDecoderConfig, skinning_decoder
from actorsnerf_model.skinning_prior import log_prior
from actorsnerf_model.states import FieldValues, Located, PoseState

CANONICAL_MARGIN = 0.3
"""Metres around the canonical joints (HumanNeRF's released code)."""


@dataclass(frozen=True)
class HumanNeRFConfig:
    """Sizes and parts of the method; defaults are the released code's."""

    refiner: RefinerConfig | None = field(default_factory=RefinerConfig)
    """None: poses are taken as fitted."""
    motion: MotionConfig | None = field(default_factory=MotionConfig)
    """None: points stay where the bones put them."""
    canonical: CanonicalConfig = field(default_factory=CanonicalConfig)
    skinning: SkinningDecoderConfig = field(default_factory=SkinningDecoderConfig)
    views: int = 3
    """Support views that come with a sample, as for ActorsNeRF; only the body at rest is read."""
    occupancy_threshold: float = 0.01
    """As in `ActorsNeRFConfig`. Below it opacity, which is multiplied by the likelihood, is under a
    hundredth; HumanNeRF's released code evaluates those samples too."""


@dataclass(frozen=True)
class RestBody:
    """The actor's body at rest: nothing learned."""

    canonical_joints: Float[Tensor, "24 3"]
    box: Float[Tensor, "2 3"]
    """Joints +- `CANONICAL_MARGIN`, metres."""
    log_prior: Float[Tensor, "25 z y x"]


@dataclass(frozen=True)
class HumanNeRFState:
    """All that rendering needs of the person, whatever the pose and the camera."""

    body: RestBody
    skinning: SkinningVolume
    bounds: SkinningBounds
    occupancy: OccupancyTables | None
    """None where every sample is asked."""
    window: float
    """Open octaves of the motion's encoding; <= 0 leaves the motion out."""


class HumanNeRF(LearnedMethod[RestBody, RestBody, HumanNeRFState]):
    """The method; nothing of it is shared between people, so nothing freezes."""

    def __init__(self, config: HumanNeRFConfig, network_dtype: torch.dtype = torch.float32) -> None:
        """Random weights; parts that the configuration switches off do not exist."""
        super().__init__(network_dtype)
        self.config = config
        self.skinning = skinning_decoder(config.skinning)
        self.refiner = None if config.refiner is None else PoseRefiner(config.refiner)
        self.motion = None if config.motion is None else NonRigidMotion(config.motion)
        self.canonical = CanonicalField(config.canonical)

    def parts(self) -> dict[str, nn.Module]:
        """The parts that have a learning rate of their own."""
        parts = {
            "skinning": self.skinning,
            "refiner": self.refiner,
            "deformation": self.motion,
            "radiance": self.canonical,
        }
        return {name: part for name, part in parts.items() if part is not None}

    def freeze_category_prior(self) -> None:
        """Nothing: there is no category."""

    def geometry(self, view: View) -> RestBody:
        """What follows from the actor's body at rest."""
        joints = view.canonical_joints
        margin = CANONICAL_MARGIN
        box = torch.stack([joints.amin(0) - margin, joints.amax(0) + margin])
        nodes = self.config.skinning.nodes
        return RestBody(joints, box, log_prior(joints, box, (nodes, nodes, nodes)))

    def category_prior(
        self, supports: tuple[View, ...], geometry: RestBody | None = None
    ) -> RestBody:
        """The body at rest: nothing here is learned from other people."""
        return geometry or self.geometry(supports[0])

    def instance_state(self, prior: RestBody, window: float) -> HumanNeRFState:
        """The whole state."""
        with torch.autocast(prior.box.device.type, enabled=False):
            logits = self.skinning()
        volume = skinning_volume(logits, prior.log_prior, prior.box)
        bounds = skinning_bounds(volume)
        tables = None if asks_every_sample(prior.box.device) else occupancy_tables(volume, bounds)
        return HumanNeRFState(prior, volume, bounds, tables, window)

    def skinning_residual(self, prior: RestBody) -> Float[Tensor, ""]:
        """Zero: HumanNeRF has no pull towards the prior."""
        return prior.log_prior.new_zeros(())

    def pose_state(
        self,
        actor: HumanNeRFState,
        pose: Float[Tensor, "24 3"],
        rest_joints: Float[Tensor, "24 3"],
        frame: int | None = None,
    ) -> PoseState:
        """The bones' motions in the corrected pose, whatever the frame; the fitted one's bounds."""
        frames = posed_frames(pose, rest_joints)
        bounds = observation_bounds(frames[1])
        if self.refiner is not None:
            with self.networks(pose):
                turned = self.refiner(pose)
            frames = chained_frames(turned, rest_joints)
        there, back = motions_between(*frames, actor.body.canonical_joints)
        tables, least = actor.occupancy, self.config.occupancy_threshold
        occupancy = None
        if tables is not None and not asks_every_sample(bounds.device):
            occupancy = pose_occupancy(tables, there, bounds, least)
        return PoseState(pose, there, back, bounds, occupancy)

    def locate(
        self,
        actor: HumanNeRFState,
        pose: PoseState,
        points: Float[Tensor, "points 3"],
        threshold: float,
    ) -> Located:
        """The points (body frame) whose likelihood reaches the threshold, in canonical space."""
        with torch.autocast(points.device.type, enabled=False):
            return locate(points, actor.skinning, actor.bounds, pose.canonical_from_body, threshold)

    def field(self, actor: HumanNeRFState, pose: PoseState, located: Located) -> FieldValues:
        """Colour and density at located points."""
        points = located.canonical
        if self.motion is not None and actor.window > 0:
            with self.networks(points):
                offset = self.motion(points, actor.window, pose.pose)
            points = points + offset.to(points.dtype)
        with self.networks(points):
            rgb, density = self.canonical(points)
        return FieldValues(rgb, density)
