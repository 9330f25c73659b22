"""ActorsNeRF: a person from K support views, in any pose, from any side.

Category-level parts (encoder, skinning) are shared by all people; instance-level parts
(deformation, SMPL feature diffusion, rendering) adapt to one actor in few-shot training.
"""

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import (
    ActorBody,
    ActorGeometry,
    ActorsNeRFState,
    CategoryPrior,
    UnreadMap,
    actor_geometry,
    check_supports,
    support_cameras,
    support_motions,
)
from actorsnerf_model.body_features import vertex_channels, vertex_features
from actorsnerf_model.deformation import Deformation, DeformationConfig
from actorsnerf_model.encoder import (
    TRUNK_CHANNELS,
    Encoder,
    EncoderConfig,
    FeatureMap,
    support_pictures,
)
from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames
from actorsnerf_model.learned_method import LearnedMethod
from actorsnerf_model.occupancy import asks_every_sample, occupancy_tables, pose_occupancy
from actorsnerf_model.pixel_features import SupportCameras, read_features
from actorsnerf_model.radiance import Radiance, RadianceConfig
from actorsnerf_model.skinning import forward_warp, skinning_volume
from actorsnerf_model.skinning_bounds import locate, skinning_bounds
from actorsnerf_model.skinning_decoder import (
    SkinningDecoderConfig,
    residual_size,
    skinning_decoder,
)
from actorsnerf_model.sparse_conv import SparseConfig, SparseNet, query
from actorsnerf_model.states import DensityFirst, Located, PoseState


@dataclass(frozen=True)
class ActorsNeRFConfig:
    """Sizes and parts of the method; defaults are the released code's."""

    views: int = 3
    """K, the number of support views; a size of the model."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    skinning: SkinningDecoderConfig = field(default_factory=SkinningDecoderConfig)
    deformation_net: DeformationConfig = field(default_factory=DeformationConfig)
    sparse: SparseConfig = field(default_factory=SparseConfig)
    radiance: RadianceConfig = field(default_factory=RadianceConfig)
    deformation: bool = True
    """Off: points stay in the category's canonical space (paper's ablation)."""
    pixel_features: bool = True
    """Off: neither rendering nor deformation sees pixel-aligned features. The released ablation
    takes them from the rendering network only."""
    body_features: bool = True
    """Off: no SMPL features and no sparse network (paper's ablation)."""

    occupancy_threshold: float = 0.01
    """Foreground likelihood below which a cell counts as empty. Rendering with a lower threshold
    than this must not use the occupancy."""


class ActorsNeRF(LearnedMethod[ActorGeometry, CategoryPrior, ActorsNeRFState]):
    """The method of the paper; implements the `Method` protocol of `states`."""

    def __init__(
        self, config: ActorsNeRFConfig, network_dtype: torch.dtype = torch.float32
    ) -> None:
        """Random weights; parts that the configuration switches off do not exist.

        Args:
            config: sizes and parts.
            network_dtype: of the products inside networks; geometry keeps its inputs' precision.
        """
        super().__init__(network_dtype)
        self.config = config
        pixel_channels = TRUNK_CHANNELS[config.encoder.trunk] if config.pixel_features else 0
        body_channels = config.sparse.tapped_channels if config.body_features else 0
        self.encoder = (
            Encoder(config.encoder, reduced=config.body_features)
            if config.pixel_features or config.body_features
            else None
        )
        self.skinning = skinning_decoder(config.skinning)
        self.deformation = (
            Deformation(config.deformation_net, pixel_channels, config.views)
            if config.deformation
            else None
        )
        self.sparse = (
            SparseNet(config.sparse, vertex_channels(config.encoder.body_channels, config.views))
            if config.body_features
            else None
        )
        self.radiance = Radiance(config.radiance, pixel_channels, body_channels)

    def parts(self) -> dict[str, nn.Module]:
        """The parts that have a learning rate of their own; those switched off are absent."""
        parts = {
            "encoder": self.encoder,
            "skinning": self.skinning,
            "deformation": self.deformation,
            "sparse": self.sparse,
            "radiance": self.radiance,
        }
        return {name: part for name, part in parts.items() if part is not None}

    def freeze_category_prior(self) -> None:
        """Stops encoder and skinning from learning, running statistics included (few-shot)."""
        self.prior_frozen = True
        for part in self._prior_parts():
            part.requires_grad_(False)
        self.train(self.training)

    def train(self, mode: bool = True) -> "ActorsNeRF":
        """Training mode for all but frozen parts, which stay in evaluation mode."""
        super().train(mode)
        if self.prior_frozen:
            for part in self._prior_parts():
                part.eval()
        return self

    def _prior_parts(self) -> tuple[nn.Module, ...]:
        return (self.skinning,) if self.encoder is None else (self.encoder, self.skinning)

    def geometry(self, view: View) -> ActorGeometry:
        """What follows from the actor's body at rest; keep it, one per actor."""
        sparse = self.config.sparse if self.config.body_features else None
        return actor_geometry(view, self.config.skinning.nodes, sparse)

    def category_prior(
        self, supports: tuple[View, ...], geometry: ActorGeometry | None = None
    ) -> CategoryPrior:
        """What the frozen parts make of an actor; once in few-shot, each step in pre-training.

        Args:
            supports: the K support views.
            geometry: of their actor, where it was kept.
        """
        check_supports(supports, self.config.views)
        geometry = geometry or self.geometry(supports[0])
        # Logits are geometry: 8 bits of mantissa would move points.
        with torch.autocast(geometry.box.device.type, enabled=False):
            residual = self.skinning()
        volume = skinning_volume(residual, geometry.log_prior, geometry.box)
        bounds = skinning_bounds(volume)
        body = ActorBody(
            geometry,
            support_cameras(supports),
            support_motions(supports, geometry.canonical_joints),
            volume,
            bounds,
            None if asks_every_sample(geometry.box.device) else occupancy_tables(volume, bounds),
            residual,
        )
        if self.encoder is None:
            return CategoryPrior(body, None, None)
        pictures = support_pictures(supports, self.config.encoder.background)
        with self.networks(pictures):
            trunk, reduced = self.encoder(pictures)
        vertices = None
        if reduced is not None:
            posed = torch.stack([view.posed_vertices for view in supports])
            reduced = FeatureMap(reduced.table.to(posed.dtype), reduced.first)
            vertices = vertex_features(reduced, body.cameras, posed, geometry.rest_vertices)
        return CategoryPrior(body, trunk if self.config.pixel_features else None, vertices)

    def instance_state(self, prior: CategoryPrior, window: float) -> ActorsNeRFState:
        """The whole state from a category prior; what learns in few-shot runs here."""
        box = prior.body.geometry.box
        maps = None if prior.trunk is None else self._maps(prior.trunk, window, box.dtype)
        plan = prior.body.geometry.plan
        levels = ()
        if self.sparse is not None and prior.vertices is not None and plan is not None:
            dtype = box.dtype if self.network_dtype == torch.float32 else self.network_dtype
            levels = self.sparse(prior.vertices, plan, dtype)
        return ActorsNeRFState(prior.body, maps, levels, window)

    def _maps(self, trunk: FeatureMap, window: float, dtype: torch.dtype) -> FeatureMap | UnreadMap:
        weight = self._map_weight(window)
        learns = trunk.table.requires_grad or weight.requires_grad
        if learns and torch.is_grad_enabled():
            return UnreadMap(trunk, weight)
        return FeatureMap(self._reduced(trunk.table, weight, dtype), trunk.first)

    def _reduced(
        self,
        rows: Float[Tensor, "*rows channels"],
        weight: Float[Tensor, "out channels"],
        dtype: torch.dtype,
    ) -> Float[Tensor, "*rows out"]:
        with self.networks(rows):
            return F.linear(rows, weight).to(dtype)

    def _map_weight(self, window: float) -> Float[Tensor, "out channels"]:
        """The linear layers that follow interpolation: linear, so they may come before it."""
        assert self.radiance.pixel is not None
        weights = [self.radiance.pixel.weight]
        if self._deforms(window):
            assert self.deformation is not None and self.deformation.pixel_code is not None
            weights.append(self.deformation.pixel_code.weight)
        return torch.cat(weights)

    def _deforms(self, window: float) -> bool:
        return self.deformation is not None and window > 0

    def skinning_residual(self, prior: CategoryPrior) -> Float[Tensor, ""]:
        """Mean over nodes of the channels' summed absolute logits beside the skinning prior."""
        return residual_size(prior.body.residual)

    def pose_state(
        self,
        actor: ActorsNeRFState,
        pose: Float[Tensor, "24 3"],
        rest_joints: Float[Tensor, "24 3"],
        frame: int | None = None,
    ) -> PoseState:
        """What depends on the pose alone; all frames are alike."""
        joints = actor.body.geometry.canonical_joints
        canonical_from_body, body_from_canonical = bone_motions(pose, rest_joints, joints)
        bounds = observation_bounds(posed_frames(pose, rest_joints)[1])
        tables, least = actor.body.occupancy, self.config.occupancy_threshold
        occupancy = None
        if tables is not None and not asks_every_sample(bounds.device):
            occupancy = pose_occupancy(tables, canonical_from_body, bounds, least)
        return PoseState(pose, canonical_from_body, body_from_canonical, bounds, occupancy)

    def locate(
        self,
        actor: ActorsNeRFState,
        pose: PoseState,
        points: Float[Tensor, "points 3"],
        threshold: float,
    ) -> Located:
        """The points (body frame) whose likelihood reaches the threshold, in canonical space."""
        body = actor.body
        with torch.autocast(points.device.type, enabled=False):
            return locate(points, body.skinning, body.bounds, pose.canonical_from_body, threshold)

    def field(self, actor: ActorsNeRFState, pose: PoseState, located: Located) -> DensityFirst:
        """Colour and density at located points.

        Pixel features belong to the category's point x_c; SMPL features and position to the
        instance's point x_i, as released.
        """
        points = located.canonical
        low, high = actor.body.geometry.box
        normal = (points - low) * (2 / (high - low)) - 1
        pixels, codes = self._pixel_features(actor, points)
        if self._deforms(actor.window):
            assert self.deformation is not None
            with self.networks(points):
                given = self.deformation.point_input(normal, actor.window, codes)
                offset = self.deformation.from_input(given, pose.pose)
            normal = normal + offset.to(normal.dtype)
            points = (normal + 1) * ((high - low) / 2) + low
        with torch.autocast(points.device.type, enabled=False):
            body = query(actor.levels, points) if actor.levels else None
        return self._radiance(normal, pixels, body)

    def offsets(
        self,
        actor: ActorsNeRFState,
        points: Float[Tensor, "points 3"],
        poses: Float[Tensor, "poses 24 3"],
    ) -> Float[Tensor, "points 3"]:
        """Mean offset in poses from category points to instance points, metres."""
        low, high = actor.body.geometry.box
        given = self.deformation_input(actor, points)
        if given is None or self.deformation is None:
            return torch.zeros_like(points)
        with self.networks(points):
            moved = [self.deformation.from_input(given, pose).to(points.dtype) for pose in poses]
        offset: Tensor = torch.stack(moved).mean(0) * ((high - low) / 2)
        return offset

    def mean_field(
        self,
        actor: ActorsNeRFState,
        points: Float[Tensor, "points 3"],
        poses: Float[Tensor, "poses 24 3"],
    ) -> DensityFirst:
        """Colour and density of category points (metres) moved by their mean offset in poses."""
        low, high = actor.body.geometry.box
        pixels = self._pixel_features(actor, points)[0]
        points = points + self.offsets(actor, points, poses)
        with torch.autocast(points.device.type, enabled=False):
            body = query(actor.levels, points) if actor.levels else None
        return self._radiance((points - low) * (2 / (high - low)) - 1, pixels, body)

    def _radiance(
        self,
        normal: Float[Tensor, "points 3"],
        pixels: Float[Tensor, "views points code"] | None,
        body: Float[Tensor, "points body"] | None,
    ) -> DensityFirst:
        with self.networks(normal):
            features = self.radiance.features(normal, pixels, body)
            density = self.radiance.density(features)

        def paint(which: Tensor | None) -> Tensor:
            with self.networks(normal):
                return self.radiance.colour(features if which is None else features.chosen(which))

        return DensityFirst(density, paint)

    def deformation_input(
        self, actor: ActorsNeRFState, points: Float[Tensor, "points 3"]
    ) -> Float[Tensor, "points given"] | None:
        """What the deformation network reads of category points (metres) besides the pose.

        None where points are not deformed.
        """
        if self.deformation is None or not self._deforms(actor.window):
            return None
        low, high = actor.body.geometry.box
        codes = self._pixel_features(actor, points)[1]
        normal = (points - low) * (2 / (high - low)) - 1
        with self.networks(points):
            return self.deformation.point_input(normal, actor.window, codes)

    def _read(
        self,
        maps: FeatureMap | UnreadMap,
        cameras: SupportCameras,
        posed: Float[Tensor, "views points 3"],
    ) -> Float[Tensor, "views points code"]:
        if isinstance(maps, FeatureMap):
            return read_features(maps, cameras, posed)
        weight = maps.weight
        return read_features(
            maps.trunk, cameras, posed, lambda rows: self._reduced(rows, weight, posed.dtype)
        )

    def _pixel_features(
        self, actor: ActorsNeRFState, points: Float[Tensor, "points 3"]
    ) -> tuple[Tensor | None, Tensor | None]:
        """What rendering and deformation read of the K views, through their first layers."""
        if actor.maps is None:
            return None, None
        with torch.autocast(points.device.type, enabled=False):
            # A point that no bone holds stays where it is; only a threshold of 0 locates any.
            posed, _ = forward_warp(points, actor.body.skinning, actor.body.body_from_canonical)
            read = self._read(actor.maps, actor.body.cameras, posed)
        code = self.config.radiance.code
        if read.shape[-1] == code:
            return read, None
        pixels, codes = torch.split(read, [code, read.shape[-1] - code], dim=-1)
        return pixels, codes
