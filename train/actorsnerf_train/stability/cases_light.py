"""Hard cases of compositing: densities from nothing to a wall, soft masks, zero spacing."""

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.volume_rendering import FULL, composite, optical_depth
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject

DENSITIES = (0.0, 1e-30, 1e-8, 1e-3, 1.0, 30.0, 1e3, 1e6, 1e30)
"""1/metre."""
SUM = Bounds(1e-12, 1e-6, 1e-6)
COLOUR = Bounds(1e-12, 2e-6, 2e-6, gradient=1e-4)
SAMPLES = 128
SPACING = 0.02
"""Metres."""
RAYS = 16


def light_cases() -> list[Case]:
    """The cases."""
    cases = []
    for density in DENSITIES:
        even = torch.full((RAYS, SAMPLES), density, dtype=torch.float64)
        cases += _both(f"density {density:g}", even, None)
    generator = torch.Generator().manual_seed(5)
    exponent = 12 * torch.rand(RAYS, SAMPLES, generator=generator, dtype=torch.float64) - 6
    mixed = torch.where(exponent < -3, 0.0, 10**exponent)
    cases += _both("densities of 0 and 1e-3 to 1e6 on one ray", mixed, None)
    one = torch.zeros(RAYS, SAMPLES, dtype=torch.float64)
    one[:, SAMPLES // 2] = 1e6
    cases += _both("one wall in nothing", one, None)
    for likelihood in (0.0, 0.01, 0.5, 1.0, 24.0):
        soft = torch.full_like(mixed, likelihood)
        cases += _both(f"soft mask, likelihood {likelihood:g}", mixed, soft)
    return cases


def _both(
    name: str,
    density: Float[Tensor, "rays samples"],
    likelihood: Float[Tensor, "rays samples"] | None,
) -> list[Case]:
    def composed(subject: Subject) -> tuple[Tensor, Tensor, tuple[Tensor, ...]]:
        given = subject.tensor(density).requires_grad_()
        soft = None if likelihood is None else subject.tensor(likelihood).requires_grad_()
        rgb = subject.tensor(_colours()).requires_grad_()
        thickness = optical_depth(given, torch.full_like(given, SPACING), soft)
        depths = 2 + SPACING * torch.arange(SAMPLES).to(given).expand_as(given)
        seen = composite(rgb, thickness, depths, given.new_tensor([0.2, 0.4, 0.6]))
        inputs = (given, rgb) if soft is None else (given, rgb, soft)
        loss = (seen.rgb * seen.rgb.new_tensor([1.0, 0.7, 0.3])).sum() + seen.depth.sum()
        passing = torch.exp(-thickness.double().sum(-1))
        whole = seen.weights.double().sum(-1) + passing
        return seen.rgb.detach(), whole.detach(), torch.autograd.grad(loss, inputs)

    def total(subject: Subject) -> Answer:
        _, whole, gradients = composed(subject)
        return Answer(whole, gradients)

    def colour(subject: Subject) -> Answer:
        rgb, _, gradients = composed(subject)
        return Answer(rgb, gradients)

    def one(subject: Subject) -> Answer:
        return Answer(torch.ones(RAYS, dtype=torch.float64, device=subject.like.device))

    def slow(subject: Subject) -> Answer:
        soft = None if likelihood is None else subject.tensor(likelihood)
        return Answer(_one_by_one(subject.tensor(density), soft, subject.tensor(_colours())))

    return [
        Case("compositing", name, "weights and passing light sum to 1", SUM, total, one),
        Case("compositing", name, "colour against a slow twin", COLOUR, colour, slow),
    ]


def _colours() -> Float[Tensor, "rays samples 3"]:
    count = torch.arange(RAYS * SAMPLES * 3, dtype=torch.float64)
    return (0.5 + 0.5 * torch.sin(0.7 * count)).reshape(RAYS, SAMPLES, 3)


def _one_by_one(
    density: Float[Tensor, "rays samples"],
    likelihood: Float[Tensor, "rays samples"] | None,
    rgb: Float[Tensor, "rays samples 3"],
) -> Float[Tensor, "rays 3"]:
    light = torch.ones_like(density[:, 0])
    colour = torch.zeros_like(rgb[:, 0])
    for sample in range(density.shape[1]):
        opacity = 1 - torch.exp(-density[:, sample] * SPACING)
        if likelihood is not None:
            opacity = (opacity * likelihood[:, sample]).clamp(0, FULL)
        colour = colour + (light * opacity)[:, None] * rgb[:, sample]
        light = light * (1 - opacity)
    return colour + light[:, None] * rgb.new_tensor([0.2, 0.4, 0.6])


__all__ = ["light_cases"]
