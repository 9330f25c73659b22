import math

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_model.sparse_conv import (
    FeatureLevel,
    SparseConfig,
    SparseConvolution,
    SparseNet,
    convolve,
    merge_vertices,
    query,
)
from actorsnerf_model.sparse_plan import Level, SparsePlan, plan_sparse

BOX = torch.tensor([[-0.3, -0.2, -0.1], [0.35, 0.3, 0.2]])
VOXEL = 0.05
CONFIG = SparseConfig(VOXEL, (4, 6, 5), (2, 1, 2), (0, 1, 2))


def vertices(count: int = 60, seed: int = 3) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return BOX[0] + torch.rand(count, 3, generator=generator) * (BOX[1] - BOX[0])


def plan(count: int = 60) -> SparsePlan:
    return plan_sparse(vertices(count), BOX, VOXEL, 3)


def dense(rows: Tensor, level: Level) -> Tensor:
    volume = rows.new_zeros(*level.shape, rows.shape[1])
    z, y, x = level.voxels.unbind(1)
    volume[z, y, x] = rows
    return volume.permute(3, 0, 1, 2)[None]


def masked(volume: Tensor, level: Level) -> Tensor:
    z, y, x = level.voxels.unbind(1)
    return volume[0].permute(1, 2, 3, 0)[z, y, x]


def dense_kernel(weight: Tensor) -> Tensor:
    return weight.permute(2, 1, 0).reshape(weight.shape[2], weight.shape[1], 3, 3, 3)


@pytest.mark.parametrize("stride", [1, 2])
def test_equals_masked_dense_convolution(stride: int) -> None:
    torch.manual_seed(0)
    made = plan()
    source, target = made.levels[0], made.levels[stride - 1]
    pairs = made.down[0] if stride == 2 else source.same
    rows = torch.randn(len(source.voxels), 7, requires_grad=True)
    weight = torch.randn(27, 7, 9, requires_grad=True)
    ours = convolve(rows, weight, pairs)
    volume = F.conv3d(dense(rows, source), dense_kernel(weight), stride=stride, padding=1)
    theirs = masked(volume, target)
    torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-5)
    pull = torch.randn_like(ours)
    for mine, other in zip(
        torch.autograd.grad(ours, (rows, weight), pull),
        torch.autograd.grad(theirs, (rows, weight), pull),
        strict=True,
    ):
        torch.testing.assert_close(mine, other, atol=1e-4, rtol=1e-5)


@pytest.mark.parametrize("stride", [1, 2])
def test_gradient(stride: int) -> None:
    torch.manual_seed(0)
    made = plan(6)
    pairs = made.down[0] if stride == 2 else made.levels[0].same
    rows = torch.randn(len(made.levels[0].voxels), 2, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(27, 2, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda r, w: convolve(r, w, pairs), (rows, weight))


def test_merge_takes_the_mean_and_its_gradient() -> None:
    points = torch.cat([vertices(5), vertices(3)])  # the first three twice
    made = plan_sparse(points, BOX, VOXEL, 1)
    features = torch.randn(8, 4, dtype=torch.float64, requires_grad=True)
    merged = merge_vertices(features, made.merge)
    for row in range(len(merged)):
        expected = features[made.merge.row == row].mean(dim=0)
        torch.testing.assert_close(merged[row], expected)
    assert torch.autograd.gradcheck(lambda f: merge_vertices(f, made.merge), (features,))


def test_the_net_equals_its_dense_twin() -> None:
    torch.manual_seed(0)
    made = plan()
    net = SparseNet(CONFIG, 8)
    features = torch.randn(60, 8)
    levels = net(features, made, torch.float32)
    rows = merge_vertices(features, made.merge)
    for i, stage in enumerate(net.stages):
        assert isinstance(stage, nn.ModuleList)
        for j, layer in enumerate(stage):
            assert isinstance(layer, SparseConvolution)
            down = i > 0 and j == 0
            volume = F.conv3d(
                dense(rows, made.levels[i - down]),
                dense_kernel(layer.weight),
                stride=2 if down else 1,
                padding=1,
            )
            found = masked(volume, made.levels[i])
            spread = found.var(dim=0, unbiased=False)
            rows = F.relu((found - found.mean(dim=0)) / (spread + 1e-3).sqrt())
        torch.testing.assert_close(levels[i].features, rows, atol=1e-4, rtol=1e-4)
        assert levels[i].cell == VOXEL * 2**i


def test_query_equals_grid_sample_on_the_dense_volume() -> None:
    torch.manual_seed(0)
    made = plan()
    levels = SparseNet(CONFIG, 8)(torch.randn(60, 8), made, torch.float32)
    points = BOX[0] - 0.1 + torch.rand(500, 3) * (BOX[1] - BOX[0] + 0.3)
    expected = []
    for level, active in zip(levels, made.levels, strict=True):
        last = torch.tensor(active.shape).flip(0) - 1
        normal = (points - level.origin) / level.cell / last * 2 - 1
        volume = dense(level.features, active)
        read = F.grid_sample(volume, normal[None, None, None], align_corners=True)
        expected.append(read[0, :, 0, 0].T)
    torch.testing.assert_close(query(levels, points), torch.cat(expected, 1), atol=1e-4, rtol=1e-4)


def test_query_at_a_voxel_centre_is_its_row_and_far_away_zero() -> None:
    made = plan(10)
    level = SparseNet(CONFIG, 3)(torch.randn(10, 3), made, torch.float32)[1]
    centres = level.origin + made.levels[1].voxels.flip(1) * level.cell
    torch.testing.assert_close(query([level], centres), level.features, atol=1e-4, rtol=1e-4)
    far = torch.tensor([[1e9, 0.0, 0.0], [-1e9, 1e9, 5.0]])
    assert torch.equal(query([level], far), torch.zeros(2, 6))


def test_query_gradient() -> None:
    torch.manual_seed(0)
    index = torch.full((3, 3, 3), -1, dtype=torch.int32)
    index[1, 1, 1], index[0, 1, 2] = 0, 1
    features = torch.randn(2, 2, dtype=torch.float64, requires_grad=True)
    points = torch.rand(4, 3, dtype=torch.float64).requires_grad_()
    origin = torch.zeros(3, dtype=torch.float64)

    def run(features: Tensor, points: Tensor) -> Tensor:
        return query([FeatureLevel(features, index, origin, 0.45)], points)

    assert torch.autograd.gradcheck(run, (features, points))


def test_same_bits_every_time() -> None:
    torch.manual_seed(0)
    made = plan(300)
    net = SparseNet(CONFIG, 16)
    features = torch.randn(300, 16)
    points = vertices(200, seed=9)
    results = []
    for _ in range(2):
        given = features.clone().requires_grad_()
        loss = query(net(given, made, torch.float32), points).square().sum()
        results.append(torch.autograd.grad(loss, [given, *net.parameters()]))
    for first, second in zip(*results, strict=True):
        assert torch.equal(first, second)


def test_released_size() -> None:
    config = SparseConfig()
    net = SparseNet(config, 255)
    assert sum(p.numel() for p in net.parameters()) == 2_875_840
    assert sum(len(stage) for stage in net.stages if isinstance(stage, nn.ModuleList)) == 13
    assert config.tapped_channels == 256
    bound = 1 / math.sqrt(27 * 255)
    first = net.stages[0][0].weight.detach()  # type: ignore[index]  # modules are untyped
    assert float(first.abs().max()) <= bound


def test_half_precision_products_stay_close() -> None:
    torch.manual_seed(0)
    made, net = plan(), SparseNet(CONFIG, 8)
    features = torch.randn(60, 8)
    with torch.no_grad():
        exact = net(features, made, torch.float32)
        rough = net(features, made, torch.bfloat16)
    for a, b in zip(exact, rough, strict=True):
        assert b.features.dtype == torch.float32
        assert float((a.features - b.features).square().mean().sqrt()) < 0.05
