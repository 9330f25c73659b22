"""The reference's training step: every sample through every network, patch by patch.

The networks run in the published order of operations. The actor's state is computed once a step
and cut off: each patch adds to the gradients of its tensors, and one last pass carries them on into
the weights. So no more than one patch's samples are held at a time, and nothing runs twice.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

import torch
from torch import Tensor

from actorsnerf_datasets.torch_dataset import Sample
from actorsnerf_model.rays import rays_through
from actorsnerf_model.reference import reference_render_pixels
from actorsnerf_train.batches import at_pixels, camera_of, on_background
from actorsnerf_train.losses import training_losses
from actorsnerf_train.methods import KnownActor, as_published, prior_of
from actorsnerf_train.objective import Objective

Value = TypeVar("Value")


def reference_step(
    objective: Objective,
    sample: Sample,
    known: KnownActor,
    window: float,
    generator: torch.Generator | None,
) -> float:
    """The total loss of a sample, after its gradients were added to the parameters'.

    Args:
        objective: method, losses and options.
        sample: target, supports and patches.
        known: what is kept of its actor.
        window: open bands of the deformation's encoding.
        generator: jitters the samples; None spaces them evenly.
    """
    target, method = sample.target, as_published(objective.method)
    prior = prior_of(objective.method, sample.supports, known)
    residual = objective.method.skinning_residual(prior)
    state = method.instance_state(prior, window)
    cuts: list[tuple[Tensor, Tensor]] = []
    leaf = cut_off(state, cuts)
    picture = on_background(target, objective.options.background)
    weights = dataclasses.replace(objective.weights, skinning=0.0)
    count = sample.patches.shape[0]
    total = 0.0
    for patch in torch.split(sample.patches, 1):
        pose = method.pose_state(leaf, target.pose, target.rest_joints, target.frame)
        rays = rays_through(patch.reshape(-1, 2).to(target.K.dtype), camera_of(target))
        seen = reference_render_pixels(method, leaf, pose, rays, objective.options, generator)
        truth = at_pixels(picture, patch)
        colours = seen.rgb.reshape(truth.shape)
        losses = training_losses(colours, truth, residual.detach(), objective.perceptual, weights)
        torch.autograd.backward(losses.total / count)
        total += float(losses.total.detach()) / count
    rest = objective.weights.skinning * residual
    given = [(whole, part.grad) for whole, part in cuts if part.grad is not None]
    roots = [whole for whole, _ in given]
    gradients = [gradient for _, gradient in given]
    if rest.requires_grad:
        roots.append(rest)
        gradients.append(torch.ones_like(rest))
    if roots:
        torch.autograd.backward(roots, gradients)
    return total + float(rest.detach())


def cut_off(value: Value, cuts: list[tuple[Tensor, Tensor]]) -> Value:
    """The same value with every tensor that has a history replaced by a leaf; both are noted."""

    def cut(whole: Tensor) -> Tensor:
        if not whole.requires_grad:
            return whole
        leaf = whole.detach().requires_grad_(True)
        cuts.append((whole, leaf))
        return leaf

    return with_tensors(value, cut)


def with_tensors(value: Value, changed: Callable[[Tensor], Tensor]) -> Value:
    """The same value with every tensor in its tuples and dataclasses changed."""
    made: Any = value
    if isinstance(value, Tensor):
        made = changed(value)
    elif isinstance(value, tuple):
        made = tuple(with_tensors(item, changed) for item in value)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        given = [f.name for f in dataclasses.fields(value) if f.init]
        parts = {name: with_tensors(getattr(value, name), changed) for name in given}
        made = dataclasses.replace(value, **parts)
    done: Value = made
    return done


__all__ = ["cut_off", "reference_step", "with_tensors"]
