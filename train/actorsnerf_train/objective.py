"""One sample's losses: patches rendered in its pose and camera, compared with its picture."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from actorsnerf_datasets.torch_dataset import Sample
from actorsnerf_model.rays import rays_through
from actorsnerf_model.render import render_pixels
from actorsnerf_model.states import Counts, RenderOptions
from actorsnerf_train.batches import Colour, at_pixels, camera_of, on_background
from actorsnerf_train.losses import Losses, LossWeights, Perceptual, training_losses
from actorsnerf_train.methods import AnyMethod, KnownActor, step_state


@dataclass(frozen=True)
class Outcome:
    """The losses of a sample, and what the rendering was like."""

    losses: Losses
    inside: Float[Tensor, ""]
    """Mean rendered opacity on the person's pixels; NaN where the patches show none."""
    outside: Float[Tensor, ""]
    """The same beside the person."""
    counts: Counts


class Objective(nn.Module):
    """What a training minimises; one module, so that torch can share its gradients out."""

    def __init__(
        self,
        method: AnyMethod,
        perceptual: Perceptual,
        weights: LossWeights,
        options: RenderOptions,
    ) -> None:
        super().__init__()
        self.method = method
        self.perceptual = perceptual
        self.weights = weights
        self.options = options

    def forward(
        self,
        sample: Sample,
        known: KnownActor,
        window: float,
        generator: torch.Generator,
        background: Colour | None = None,
    ) -> Outcome:
        """The losses of a sample.

        Args:
            sample: target, supports and patches.
            known: what is kept of its actor.
            window: open bands of the deformation's encoding.
            generator: jitters the samples along the rays.
            background: behind the person in both pictures; the options' if left out.
        """
        target = sample.target
        options = self.options
        if background is not None:
            options = replace(options, background=background)
        actor, residual = step_state(self.method, sample.supports, known, window)
        pose = self.method.pose_state(actor, target.pose, target.rest_joints, target.frame)
        rays = rays_through(sample.patches.reshape(-1, 2).to(target.K.dtype), camera_of(target))
        rendering = render_pixels(self.method, actor, pose, rays, options, generator)
        truth = at_pixels(on_background(target, options.background), sample.patches)
        losses = training_losses(
            rendering.rgb.reshape(truth.shape), truth, residual, self.perceptual, self.weights
        )
        if not losses.total.requires_grad:  # patches that show nothing, frozen skinning
            losses = replace(losses, total=losses.total + self._nothing())
        person = at_pixels(target.alpha, sample.patches).reshape(-1) > 0.5
        alpha = rendering.alpha.detach()
        inside, outside = _mean_where(alpha, person), _mean_where(alpha, ~person)
        return Outcome(losses, inside, outside, rendering.counts)

    def _nothing(self) -> Float[Tensor, ""]:
        """A zero with a gradient (also zero), so that every process has something to share."""
        learning = next(part for part in self.method.parameters() if part.requires_grad)
        return 0 * learning.sum()


def _mean_where(
    values: Float[Tensor, "pixels"], chosen: Bool[Tensor, "pixels"]
) -> Float[Tensor, ""]:
    """Mean of the chosen values, NaN of none; choosing them would make the host wait for a GPU."""
    return torch.where(chosen, values, 0.0).sum() / chosen.sum()
