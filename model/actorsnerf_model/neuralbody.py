"""Neural Body (Peng et al., CVPR 2021): codes on the body's vertices, diffused in the posed space.

    codes -> posed vertices -> sparse convolutions -> features of a point -> density, colour

There is no canonical space: the body is posed, its voxels are found anew, and the network runs over
them. What a person looks like from a side and in a frame is told by the view direction and by a
code of the frame. Loader, skeleton, sparse convolution, renderer and losses are those of the other
methods. The released code differs in these:

* It evaluates the whole box; here no network sees a sample that features cannot reach.
* Its posed vertices are the fitted body's. Here they follow from the pose, whatever motion it comes
  from, with weights that `vertex_weights` recovers.
* Codes of frames are unbounded, and an unseen frame takes the last one's. Here they are deviations
  from their mean, which an unseen frame takes.
* It encodes the point in the world; a person who walks away would change colour. Here both point
  and direction are the body's.
"""

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor, nn

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.feature_shell import FeatureShell, feature_shell, in_shell, shell_occupancy
from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames
from actorsnerf_model.learned_method import LearnedMethod
from actorsnerf_model.pose_plans import PosePlans
from actorsnerf_model.skinning import blend
from actorsnerf_model.sparse_conv import FeatureLevel, SparseConfig, SparseNet, query
from actorsnerf_model.states import DensityFirst, Located, PoseState
from actorsnerf_model.vertex_weights import recovered_weights
from actorsnerf_model.view_field import ViewField, ViewFieldConfig

RELEASED_SPARSE = SparseConfig(
    voxel=0.005,
    channels=(16, 32, 64, 128, 128),
    convolutions=(2, 2, 3, 3, 3),
    taps=(1, 2, 3, 4),
)
"""Of the released code: 352 features a point."""


@dataclass(frozen=True)
class NeuralBodyConfig:
    """Sizes of the method, the person's included; defaults are the released code's."""

    code: int = 16
    """Numbers on each vertex."""
    vertices: int = 6890
    """Of the body; a fitting takes its own data's number."""
    frames: tuple[int, ...] = ()
    """Numbers of the frames that have a code; a fitting takes those that it sees."""
    sparse: SparseConfig = RELEASED_SPARSE
    field: ViewFieldConfig = field(default_factory=ViewFieldConfig)
    views: int = 3
    """Support views that come with a sample; their bodies tell which bones hold which vertices."""
    occupancy_threshold: float = 0.01
    """As in `ActorsNeRFConfig`. Likelihood is 0 or 1 here, so every value has the same cells."""


@dataclass(frozen=True)
class BodyAtRest:
    """What follows from the actor's body at rest."""

    canonical_joints: Float[Tensor, "24 3"]
    vertices: Float[Tensor, "vertices 3"]


@dataclass(frozen=True)
class NeuralBodyState:
    """What is known of the actor, whatever the pose; nothing of it learns."""

    body: BodyAtRest
    weights: Float[Tensor, "vertices 24"]
    """How strongly each bone holds each vertex."""
    plans: PosePlans
    """Of poses asked for before."""


@dataclass(frozen=True)
class NeuralBodyPose(PoseState):
    """The state of a pose, with the features around it."""

    levels: tuple[FeatureLevel, ...]
    """Diffused codes, posed body frame."""
    shell: FeatureShell
    """Where they reach."""
    latent: Float[Tensor, "latent"]
    """Of the frame."""


class Codes(nn.Module):
    """What is learned of each vertex and each frame."""

    def __init__(self, config: NeuralBodyConfig) -> None:
        """Vertices normal, as released; frames zero."""
        super().__init__()
        self.vertices = nn.Parameter(torch.randn(config.vertices, config.code))
        self.frames = nn.Parameter(torch.zeros(len(config.frames), config.field.latent))


class NeuralBody(LearnedMethod[BodyAtRest, NeuralBodyState, NeuralBodyState]):
    """The method; nothing of it is shared between people, so nothing freezes."""

    prior_frozen = True
    """What it knows of an actor before any learning takes no gradient, and is made once."""
    reads_directions = True
    canonical_space = False

    def __init__(
        self, config: NeuralBodyConfig, network_dtype: torch.dtype = torch.float32
    ) -> None:
        """Random weights."""
        super().__init__(network_dtype)
        self.config = config
        self.codes = Codes(config)
        self.sparse = SparseNet(config.sparse, config.code)
        self.radiance = ViewField(config.field, config.sparse.tapped_channels)

    def parts(self) -> dict[str, nn.Module]:
        """The parts that have a learning rate of their own."""
        return {"codes": self.codes, "sparse": self.sparse, "radiance": self.radiance}

    def freeze_category_prior(self) -> None:
        """Nothing: there is no category."""

    def geometry(self, view: View) -> BodyAtRest:
        """The actor's body at rest.

        Raises:
            UserError: it has another number of vertices than there are codes.
        """
        count = view.rest_vertices.shape[0]
        if count != self.config.vertices:
            raise UserError(
                f"the body of {view.actor} has {count} vertices, but the model has codes for "
                f"{self.config.vertices}: they belong to one person's body; fit that person anew"
            )
        return BodyAtRest(view.canonical_joints, view.rest_vertices)

    def category_prior(
        self, supports: tuple[View, ...], geometry: BodyAtRest | None = None
    ) -> NeuralBodyState:
        """The body and its weights; no pictures, and no other people."""
        sparse = self.config.sparse
        return NeuralBodyState(
            geometry or self.geometry(supports[0]),
            recovered_weights(supports),
            PosePlans(sparse.voxel, len(sparse.channels)),
        )

    def instance_state(self, prior: NeuralBodyState, window: float) -> NeuralBodyState:
        """The same: what learns is asked in a pose. There is no encoding to open."""
        return prior

    def skinning_residual(self, prior: NeuralBodyState) -> Float[Tensor, ""]:
        """Zero: there is no skinning volume."""
        return prior.weights.new_zeros(())

    def pose_state(
        self,
        actor: NeuralBodyState,
        pose: Float[Tensor, "24 3"],
        rest_joints: Float[Tensor, "24 3"],
        frame: int | None = None,
    ) -> NeuralBodyPose:
        """The features around the posed body; differentiable in codes and networks."""
        there, back = bone_motions(pose, rest_joints, actor.body.canonical_joints)
        bounds = observation_bounds(posed_frames(pose, rest_joints)[1])
        vertices = blend(actor.body.vertices, actor.weights, back)
        dtype = vertices.dtype if self.network_dtype == torch.float32 else self.network_dtype
        levels = self.sparse(self.codes.vertices, actor.plans.plan(vertices), dtype)
        shell = feature_shell(levels)
        occupancy = shell_occupancy(shell, bounds, self.config.occupancy_threshold)
        latent = self.latent(frame)
        return NeuralBodyPose(pose, there, back, bounds, occupancy, levels, shell, latent)

    def latent(self, frame: int | None) -> Float[Tensor, "latent"]:
        """A frame's deviation from the mean frame; zero for a frame without a code."""
        table = self.codes.frames
        if frame is None or frame not in self.config.frames:
            return table.new_zeros(table.shape[1])
        return table[self.config.frames.index(frame)] - table.mean(0)

    def locate(
        self,
        actor: NeuralBodyState,
        pose: PoseState,
        points: Float[Tensor, "points 3"],
        threshold: float,
    ) -> Located:
        """The points that features reach, as they are: likelihood 1 there, 0 elsewhere."""
        assert isinstance(pose, NeuralBodyPose)
        likelihood = in_shell(pose.shell, points).to(points.dtype)
        index = (likelihood >= threshold).nonzero()[:, 0]
        return Located(index, points[index], likelihood[index])

    def field(self, actor: NeuralBodyState, pose: PoseState, located: Located) -> DensityFirst:
        """Density at located points, and the colour of those that can be seen."""
        assert isinstance(pose, NeuralBodyPose)
        points, sides, latent = located.canonical, located.directions, pose.latent
        with torch.autocast(points.device.type, enabled=False):
            features = query(pose.levels, points)
        with self.networks(points):
            hidden = self.radiance.hidden(features)
            density = self.radiance.density(hidden, points.dtype)

        def paint(which: Tensor | None) -> Tensor:
            some = slice(None) if which is None else which
            seen = None if sides is None else sides[some]
            with self.networks(points):
                return self.radiance.rgb(hidden[some], points[some], seen, latent)

        return DensityFirst(density, paint)
