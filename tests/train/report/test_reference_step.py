from dataclasses import dataclass

import torch
from torch import Tensor

from actorsnerf_train.report.reference_step import cut_off


@dataclass(frozen=True)
class Inner:
    weights: Tensor
    name: str


@dataclass(frozen=True)
class Outer:
    levels: tuple[Inner, ...]
    fixed: Tensor
    nothing: Tensor | None


def test_a_state_is_cut_off_and_its_gradients_carried_on() -> None:
    parameter = torch.tensor([1.0, 2.0], requires_grad=True)
    whole = Outer((Inner(parameter * 3, "a"), Inner(torch.ones(2), "b")), torch.zeros(1), None)
    cuts: list[tuple[Tensor, Tensor]] = []
    leaf = cut_off(whole, cuts)
    assert len(cuts) == 1 and leaf.levels[0].weights.is_leaf
    assert leaf.levels[1].weights is whole.levels[1].weights and leaf.nothing is None
    for factor in (1.0, 10.0):  # two patches
        torch.autograd.backward((factor * leaf.levels[0].weights.square()).sum())
    assert parameter.grad is None
    gradient = cuts[0][1].grad
    assert gradient is not None
    torch.autograd.backward([cuts[0][0]], [gradient])
    # d/dp 11 (3 p)^2 = 198 p
    assert parameter.grad is not None
    assert torch.allclose(parameter.grad, 198 * parameter.detach())
