import torch
from torch import Tensor

from actorsnerf_model.pose_plans import PosePlans
from actorsnerf_model.sparse_plan import plan_sparse


def vertices(seed: int, count: int = 80) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(count, 3, generator=generator) * 0.3 + torch.tensor([5.0, -2.0, 0.1])


def test_a_pose_that_comes_back_is_not_planned_again() -> None:
    plans = PosePlans(0.05, 3, kept=2)
    first = plans.plan(vertices(1))
    assert plans.plan(vertices(1)) is first
    second = plans.plan(vertices(2))
    assert plans.plan(vertices(1)) is first
    plans.plan(vertices(3))  # the second was asked for longest ago
    assert len(plans.plans) == 2
    assert plans.plan(vertices(1)) is first
    again = plans.plan(vertices(2))
    assert again is not second
    assert torch.equal(again.merge.row, second.merge.row)


def test_a_changed_vertex_is_another_pose() -> None:
    plans = PosePlans(0.05, 3)
    moved = vertices(1)
    first = plans.plan(moved)
    moved[7, 0] += 0.2
    assert plans.plan(moved) is not first
    assert torch.equal(plans.plan(moved).origin, plans.plan(moved).origin)


def test_a_plan_takes_no_gradient() -> None:
    learned = vertices(1).requires_grad_()
    assert not PosePlans(0.05, 3).plan(learned).origin.requires_grad


def test_no_level_is_cut_off() -> None:
    """A grid with twice the room has the same voxels."""
    points, voxel, levels = vertices(4), 0.05, 4
    found = PosePlans(voxel, levels).plan(points)
    room = 2 * 2**levels * voxel
    wide = plan_sparse(
        points, torch.stack([points.amin(0) - room, points.amax(0) + room]), voxel, levels
    )
    for i, (own, larger) in enumerate(zip(found.levels, wide.levels, strict=True)):
        shift = 2 ** (levels - i)
        assert torch.equal(own.voxels + shift, larger.voxels)
        # One voxel more on every side, where interpolation falls to zero.
        assert int(own.voxels.amin()) >= 1
        assert bool((own.voxels < torch.tensor(own.shape) - 1).all())
