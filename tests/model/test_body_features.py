import torch

from actorsnerf_model.body_features import vertex_channels, vertex_features
from actorsnerf_model.encoder import FeatureMap
from actorsnerf_model.fourier import fourier_features
from actorsnerf_model.pixel_features import SupportCameras, read_features


def test_released_size() -> None:
    assert vertex_channels(64, 3) == 255


def test_views_side_by_side_then_the_place_at_rest() -> None:
    generator = torch.Generator().manual_seed(0)
    table = torch.rand(3, 6, 5, 4, generator=generator)
    K = torch.tensor([[8.0, 0, 4], [0, 8.0, 5], [0, 0, 1]]).expand(3, 3, 3)
    camera = torch.eye(4)
    camera[2, 3] = 3.0
    edges = torch.tensor([[-0.5, -0.5], [9.5, 11.5]]).expand(3, 2, 2)
    cameras = SupportCameras(K, camera.expand(3, 4, 4), edges)
    posed = torch.rand(3, 11, 3, generator=generator)
    rest = torch.rand(11, 3, generator=generator)
    features = FeatureMap(table, first=0.0)
    given = vertex_features(features, cameras, posed, rest)
    assert given.shape == (11, vertex_channels(4, 3))
    read = read_features(features, cameras, posed)
    for view in range(3):
        assert torch.equal(given[:, 4 * view : 4 * view + 4], read[view])
    assert torch.equal(given[:, 12:], fourier_features(rest, 10, identity=True))
