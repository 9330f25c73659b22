import pytest
import torch
from torch import Tensor

from actorsnerf_datasets.errors import UserError
from actorsnerf_model.sparse_plan import SparsePlan, plan_sparse

BOX = torch.tensor([[-0.3, -0.2, -0.1], [0.35, 0.3, 0.2]])
VOXEL = 0.05


def vertices(count: int = 60, seed: int = 3) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return BOX[0] + torch.rand(count, 3, generator=generator) * (BOX[1] - BOX[0])


def plan(points: Tensor, levels: int = 3) -> SparsePlan:
    return plan_sparse(points, BOX, VOXEL, levels)


def test_each_vertex_falls_into_its_voxel() -> None:
    points = vertices()
    made = plan(points)
    voxels = made.levels[0].voxels[made.merge.row].flip(1)
    centres = made.origin + voxels * VOXEL
    assert float((centres - points).abs().max()) <= VOXEL / 2 + 1e-6


def test_voxels_are_unique_and_inside() -> None:
    made = plan(vertices())
    for level in made.levels:
        assert len(torch.unique(level.voxels, dim=0)) == len(level.voxels)
        assert bool((level.voxels >= 0).all())
        assert bool((level.voxels < torch.tensor(level.shape)).all())


def test_grids_are_multiples_of_the_coarsest_voxel() -> None:
    # 13, 10 and 6 voxels; one block of four more than fit, in z, y, x.
    assert [level.shape for level in plan(vertices()).levels] == [
        (8, 12, 16),
        (4, 6, 8),
        (2, 3, 4),
    ]


def test_pairs_are_those_of_a_slow_search() -> None:
    made = plan(vertices(20))
    for level, pairs, targets, stride in (
        (made.levels[0], made.levels[0].same, made.levels[0].voxels, 1),
        (made.levels[0], made.down[0], made.levels[1].voxels, 2),
    ):
        row = {tuple(voxel): i for i, voxel in enumerate(level.voxels.tolist())}
        expected = []
        for z in (-1, 0, 1):
            for y in (-1, 0, 1):
                for x in (-1, 0, 1):
                    for target, (a, b, c) in enumerate(targets.tolist()):
                        source = row.get((stride * a + z, stride * b + y, stride * c + x))
                        if source is not None:
                            expected.append((source, target))
        assert list(zip(pairs.source.tolist(), pairs.target.tolist(), strict=True)) == expected
        assert sum(pairs.counts) == len(expected)


def test_next_level_is_all_that_the_kernel_reaches() -> None:
    made = plan(vertices(12))
    active = made.levels[0].voxels
    expected = set()
    for z, y, x in torch.cartesian_prod(*(torch.arange(n) for n in made.levels[1].shape)).tolist():
        reach = (active - torch.tensor([2 * z, 2 * y, 2 * x])).abs().amax(dim=1)
        if bool((reach <= 1).any()):
            expected.add((z, y, x))
    assert {tuple(voxel) for voxel in made.levels[1].voxels.tolist()} == expected


def test_any_number_of_vertices() -> None:
    assert len(plan(vertices(1)).levels[0].voxels) == 1
    doubled = vertices(5).repeat(2, 1)
    assert len(plan(doubled).levels[0].voxels) == len(plan(vertices(5)).levels[0].voxels)


def test_vertices_outside_the_box_are_refused() -> None:
    with pytest.raises(UserError, match="in metres, at rest"):
        plan(vertices() * 1000)


def test_a_body_thicker_than_its_box_is_told_so() -> None:
    points = vertices()
    points[7, 2] = BOX[1, 2] + 0.08
    said = r"^1 of 60 vertices lie outside .* up to 0\.08 m along z; .* a body that is thicker than"
    with pytest.raises(UserError, match=said):
        plan(points)
