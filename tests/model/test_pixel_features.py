from dataclasses import replace

import torch

from actorsnerf_model.encoder import FeatureMap
from actorsnerf_model.pixel_features import SupportCameras, read_features

EVERYWHERE = torch.tensor([[-100.0, -100.0], [100.0, 100.0]])
"""Edges of a picture far around its crop."""


def made() -> tuple[FeatureMap, SupportCameras]:
    """Two views whose features are the cell's x, y and the view's number plus one."""
    y, x = torch.meshgrid(torch.arange(10.0), torch.arange(8.0), indexing="ij")
    tables = [torch.stack([x, y, torch.full_like(x, view + 1.0)], -1) for view in range(2)]
    K = torch.tensor([[10.0, 0, 7], [0, 10.0, 9], [0, 0, 1]])
    camera = torch.eye(4)
    camera[2, 3] = 2.0
    return FeatureMap(torch.stack(tables), first=0.5), SupportCameras(
        K.expand(2, 3, 3), camera.expand(2, 4, 4), EVERYWHERE.expand(2, 2, 2)
    )


def test_features_lie_where_points_project() -> None:
    features, cameras = made()
    # 10 * 0.4 / 2 + 7 = 9 -> cell (9 - 0.5) / 2 = 4.25; 10 * -0.6 / 2 + 9 = 6 -> 2.75
    points = torch.tensor([[[0.4, -0.6, 0.0]], [[0.0, 0.0, 0.0]]])
    read = read_features(features, cameras, points)
    assert read.shape == (2, 1, 3)
    torch.testing.assert_close(read[0, 0], torch.tensor([4.25, 2.75, 1.0]))
    torch.testing.assert_close(read[1, 0], torch.tensor([3.25, 4.25, 2.0]))


def test_zero_outside_and_behind_and_finite_gradient_everywhere() -> None:
    features, cameras = made()
    places = [[50.0, 0, 0], [0, -50.0, 0], [0, 0, -4.0], [0.1, 0.1, -2.0], [0.0, 0.0, 0.0]]
    points = torch.tensor([places, places], requires_grad=True)
    read = read_features(features, cameras, points)
    assert torch.equal(read[:, :4], torch.zeros(2, 4, 3))
    assert bool((read[:, 4, 2] > 0).all())
    (gradient,) = torch.autograd.grad(read.sum(), points)
    assert bool(gradient.isfinite().all())
    assert torch.equal(gradient[:, :4], torch.zeros(2, 4, 3))


def test_zero_where_a_crop_hangs_over_its_pictures_edge() -> None:
    features, cameras = made()
    # the second view's picture ends between its pixel columns 8 and 9
    cut = torch.stack([EVERYWHERE, torch.tensor([[-100.0, -100.0], [8.5, 100.0]])])
    # at 5 pixels a metre, columns 8 and 9
    points = torch.tensor([[0.2, 0.0, 0.0], [0.4, 0.0, 0.0]]).expand(2, 2, 3)
    whole = read_features(features, cameras, points)
    read = read_features(features, replace(cameras, edges=cut), points)
    assert torch.equal(read[:, 0], whole[:, 0]) and torch.equal(read[0], whole[0])
    assert bool((whole[1, 1] > 0).all()) and torch.equal(read[1, 1], torch.zeros(3))
