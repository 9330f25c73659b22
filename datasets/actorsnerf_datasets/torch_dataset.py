"""The one common loader: prepared files in, `Sample`s of torch tensors out.

The only module of this package that imports torch. A sample is a function of (seed, index) alone,
so any number of workers, a resumed run and a distributed run see the same samples.
"""

from dataclasses import dataclass

from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True)
class View:
    """One picture of an actor with its camera and pose; body frame, metres, crop pixels."""

    image: Float[Tensor, "height width 3"]
    """Straight RGB in [0, 1]."""
    alpha: Float[Tensor, "height width"]
    """The person's share of the pixel, in [0, 1]."""
    K: Float[Tensor, "3 3"]
    """Intrinsics of the crop; the centre of its top-left pixel is (0, 0)."""
    camera_from_body: Float[Tensor, "4 4"]
    """Rigid, OpenCV camera from body frame; folded in float64, then cast."""
    pose: Float[Tensor, "24 3"]
    """Axis-angle of each joint; the root is zero (it is folded into the camera)."""
    rest_joints: Float[Tensor, "24 3"]
    """Of this frame's betas, body frame."""
    rest_vertices: Float[Tensor, "vertices 3"]
    """Of the actor, body frame."""
    posed_vertices: Float[Tensor, "vertices 3"]
    """Of this frame, body frame."""
    canonical_joints: Float[Tensor, "24 3"]
    """The actor's rest joints (mean betas), body frame."""
    actor: str
    camera: str
    frame: int
    offset: tuple[int, int]
    """x, y of the crop in the full picture."""
    full_size: tuple[int, int]
    """Width, height of the full picture."""


@dataclass(frozen=True)
class Sample:
    """A target view, K support views of the same actor, and the target's pixels to render."""

    target: View
    supports: tuple[View, ...]
    patches: Int[Tensor, "patches side side 2"]
    """x, y pixel coordinates inside the target's crop."""
