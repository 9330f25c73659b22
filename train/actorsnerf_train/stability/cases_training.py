"""Hard cases of a training step: no valid ray, no survivor, empty and full targets."""

import copy
from collections.abc import Callable
from dataclasses import replace

import torch

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.rays import rays_through
from actorsnerf_model.render import render_pixels
from actorsnerf_train.batches import at_pixels, camera_of, on_background
from actorsnerf_train.losses import LossWeights, Perceptual, training_losses
from actorsnerf_train.methods import know_actor, step_state
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject

LOSS = Bounds(0.0, 1e-3, 0.1)
SIDE = 16
"""Pixels of the patch."""
Change = Callable[[View], View]


def training_cases() -> list[Case]:
    """The cases."""
    return [
        _step("a patch in the picture's middle", lambda view: view, None),
        _step("no valid ray", _beside, None),
        _step("camera turned away", _away, None),
        _step("rays, but no survivor", lambda view: view, 25.0),
        _step("empty target mask", lambda view: replace(view, alpha=0 * view.alpha), None),
        _step("full target mask", lambda view: replace(view, alpha=1 + 0 * view.alpha), None),
        _step("saturated target", lambda view: replace(view, image=1 + 0 * view.image), None),
    ]


def _step(name: str, change: Change, threshold: float | None) -> Case:
    """The loss of one patch and every parameter's gradient; samples lie evenly on the rays."""

    def answer(subject: Subject) -> Answer:
        method = copy.deepcopy(subject.method).train()
        target = change(subject.supports[0])
        known = know_actor(method, subject.supports)
        actor, residual = step_state(method, subject.supports, known, subject.state.window)
        pose = method.pose_state(actor, target.pose, target.rest_joints)
        options = subject.options
        if threshold is not None:
            options = replace(options, threshold=threshold)
        height, width = target.alpha.shape
        x = torch.arange(SIDE, device=target.alpha.device) + (width - SIDE) // 2
        y = torch.arange(SIDE, device=target.alpha.device) + (height - SIDE) // 2
        pixels = torch.stack(torch.meshgrid(x, y, indexing="xy"), -1)[None]
        rays = rays_through(pixels.reshape(-1, 2).to(target.K), camera_of(target))
        seen = render_pixels(method, actor, pose, rays, options)
        truth = at_pixels(on_background(target, options.background), pixels)
        colours = seen.rgb.reshape(truth.shape)
        losses = training_losses(colours, truth, residual, Perceptual(None), LossWeights())
        weights = [weight for weight in method.parameters() if weight.requires_grad]
        gradients = torch.autograd.grad(losses.total, weights, allow_unused=True)
        note = f"{seen.counts.rays} rays, {seen.counts.survivors} survivors"
        return Answer(losses.total.detach().reshape(1), gradients, note=note)

    return Case("training step", name, "loss against float64", LOSS, answer)


def _beside(view: View) -> View:
    camera = view.camera_from_body.clone()
    camera[0, 3] += 50
    return replace(view, camera_from_body=camera)


def _away(view: View) -> View:
    turn = view.K.new_tensor([-1.0, 1.0, -1.0, 1.0])
    return replace(view, camera_from_body=turn[:, None] * view.camera_from_body)


__all__ = ["training_cases"]
