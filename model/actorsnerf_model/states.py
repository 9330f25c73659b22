"""The contract between methods and renderer: explicit, frozen caches; nothing hides in a module.

`ActorState` holds what depends on the actor alone, `PoseState` what depends on the pose alone.
Each method has its own `ActorState`; a baked actor is one more.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

from jaxtyping import Bool, Float, Int
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View


@dataclass(frozen=True)
class Camera:
    """A pinhole camera seen from the body frame."""

    K: Float[Tensor, "3 3"]
    camera_from_body: Float[Tensor, "4 4"]
    size: tuple[int, int]
    """Width, height in pixels."""


@dataclass(frozen=True)
class Occupancy:
    """Where in the body frame a sample can pass the foreground test; conservative."""

    box: Float[Tensor, "2 3"]
    """Lower and upper corner of the grid, metres."""
    cells: Bool[Tensor, "x y z"]
    """True where some point of the cell can have likelihood >= the threshold."""
    threshold: float
    """Likelihood that the cells are for; a lower one needs its own."""


@dataclass(frozen=True)
class PoseState:
    """What depends on the pose (and the rest joints) alone."""

    pose: Float[Tensor, "24 3"]
    canonical_from_body: Float[Tensor, "24 4 4"]
    """Each bone's rigid motion from the posed body frame to the canonical pose."""
    body_from_canonical: Float[Tensor, "24 4 4"]
    """Its closed-form inverse."""
    bounds: Float[Tensor, "2 3"]
    """Observation box: posed joints +- 0.3 m (samples are spread between its faces)."""
    occupancy: Occupancy | None
    """None where every sample is asked."""


@dataclass(frozen=True)
class Located:
    """The points that can matter, carried to canonical space."""

    index: Int[Tensor, "survivors"]
    """Which of the given points these are, ascending."""
    canonical: Float[Tensor, "survivors 3"]
    """Canonical frame, metres; of a method without one (Neural Body), the posed body frame."""
    likelihood: Float[Tensor, "survivors"]
    """Foreground likelihood, the sum of the skinning weights; >= the threshold."""
    directions: Float[Tensor, "survivors 3"] | None = None
    """From the camera, body frame, unit length. The renderer adds them to what `locate` returns,
    where the method reads them."""


@dataclass(frozen=True)
class FieldValues:
    """The radiance field at located points, all of it there."""

    rgb: Float[Tensor, "survivors 3"]
    """In (0, 1)."""
    density: Float[Tensor, "survivors"]
    """Non-negative, 1/metre."""

    def colours(self, which: Int[Tensor, "some"]) -> Float[Tensor, "some 3"]:
        """Those of some of the points."""
        return self.rgb[which]


@dataclass(frozen=True)
class DensityFirst:
    """The radiance field at located points, colours made when asked for.

    The density says which points can be seen; most cannot.
    """

    density: Float[Tensor, "survivors"]
    """Non-negative, 1/metre."""
    paint: Callable[[Int[Tensor, "some"] | None], Float[Tensor, "some 3"]]
    """Colours, in (0, 1), of some points; of all without a choice."""

    @property
    def rgb(self) -> Float[Tensor, "survivors 3"]:
        """All colours."""
        return self.paint(None)

    def colours(self, which: Int[Tensor, "some"]) -> Float[Tensor, "some 3"]:
        """Those of some of the points."""
        return self.paint(which)


Field = FieldValues | DensityFirst
"""What a method says of located points."""


@dataclass(frozen=True)
class Counts:
    """How much work a rendering was."""

    rays: int
    """Rays that met the bounds."""
    samples: int
    """Samples on those rays."""
    survivors: int
    """Samples that went through the networks, at least for their density; of a training, those that
    it learns from."""
    painted: int
    """Those whose colour was computed."""

    @classmethod
    def total(cls, parts: Sequence["Counts"]) -> "Counts":
        """The work of all parts.

        >>> Counts.total([Counts(1, 20, 3, 2), Counts(1, 20, 0, 0)])
        Counts(rays=2, samples=40, survivors=3, painted=2)
        """
        return cls(
            sum(part.rays for part in parts),
            sum(part.samples for part in parts),
            sum(part.survivors for part in parts),
            sum(part.painted for part in parts),
        )


@dataclass(frozen=True)
class Rendering:
    """What a camera sees."""

    rgb: Float[Tensor, "*pixels 3"]
    alpha: Float[Tensor, "*pixels"]
    depth: Float[Tensor, "*pixels"]
    """Expected distance along the optical axis times alpha, metres; 0 where nothing is."""
    counts: Counts


@dataclass(frozen=True)
class RenderOptions:
    """How to spend work; every default is the method's own."""

    samples: int = 128
    """Per ray, uniform between the faces of the bounds (paper's code: 128)."""
    threshold: float = 0.01
    """Foreground likelihood below which a sample is empty (released code)."""
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Linear blend target; black for ZJU-MoCap, white for AIST++."""
    soft_mask: bool = False
    """Multiply opacity by likelihood (HumanNeRF) instead of the hard test alone (ActorsNeRF)."""
    occupancy: bool = True
    """Skip samples in cells that cannot pass the test (exact)."""
    stop_transmittance: float = 0.0
    """Stop a ray once less light than this passes; 0 = never (exact)."""
    least_weight: float = 0.0
    """Share of a pixel below which a sample's colour is taken as black instead of computed; 0 = ask
    for all that have any. A pixel misses at most this times the samples on its ray; gradients of
    densities then take such a colour for black, so trainings leave this at 0."""
    least_learned: float = 0.0
    """Share of a pixel below which a sample is left out where gradients are wanted, found by a look
    at densities (`stop_transmittance` does not count then); 0 = learn from all. It bounds what a
    sample adds to a gradient where density is a softplus; a ReLU's slope is 1 at any density above
    0, so densities under the share over their spacing stop learning, like those at 0."""
    pixel_tolerance: float = 0.0
    """Interpolate a pixel inside the person whose drawn neighbours differ by at most this in colour
    and opacity, both in [0, 1]; 0 = draw every pixel (exact). Whole pictures only."""
    pixel_stride: int = 2
    """Pixels between those drawn first, where `pixel_tolerance` is positive; a power of 2."""
    chunk: int = 16384
    """Points through the networks at once."""
    kept: int = 49152
    """Points of which a training step keeps what its gradient needs, 36 kB a point at most at the
    official sizes; for the others it is computed a second time (same values, less memory)."""


ActorState = TypeVar("ActorState")


@runtime_checkable
class Method(Protocol[ActorState]):
    """What the renderer needs of a method; what trainings need beyond it is `LearnedMethod`."""

    @property
    def reads_directions(self) -> bool:
        """Whether the field depends on the side that a point is seen from."""
        ...

    def actor_state(self, supports: tuple[View, ...], window: float) -> ActorState:
        """What depends on the actor alone; differentiable where its parts train.

        Args:
            supports: the K support views.
            window: open bands of the deformation's annealed encoding; <= 0 leaves the
                deformation out (before its kick-in), its number of bands opens it fully.
        """
        ...

    def pose_state(
        self, actor: ActorState, pose: Float[Tensor, "24 3"], rest_joints: Float[Tensor, "24 3"]
    ) -> PoseState:
        """What depends on the pose alone (a training also tells which frame it is)."""
        ...

    def locate(
        self,
        actor: ActorState,
        pose: PoseState,
        points: Float[Tensor, "points 3"],
        threshold: float,
    ) -> Located:
        """The points (body frame) whose likelihood reaches the threshold, in canonical space."""
        ...

    def field(self, actor: ActorState, pose: PoseState, located: Located) -> Field:
        """Colour and density at located points."""
        ...


__all__ = [
    "ActorState",
    "Camera",
    "Counts",
    "DensityFirst",
    "Field",
    "FieldValues",
    "Located",
    "Method",
    "Occupancy",
    "PoseState",
    "RenderOptions",
    "Rendering",
]
