import math

import pytest
import torch

from actorsnerf_datasets.skeleton import PARENTS
from actorsnerf_model.projection import project
from actorsnerf_train.invented_actor import (
    DISTANCE,
    InventedSource,
    camera_around,
    invented_actor,
    invented_joints,
    invented_views,
)


def test_the_joints_are_an_adult_in_the_t_pose() -> None:
    joints = invented_joints()
    assert 1.4 < float(joints[:, 1].max() - joints[:, 1].min()) < 1.8
    assert 1.4 < float(joints[:, 0].max() - joints[:, 0].min()) < 1.8
    torch.testing.assert_close(joints[1] * torch.tensor([-1.0, 1, 1]).double(), joints[2])
    lengths = [float((joints[j] - joints[p]).norm()) for j, p in enumerate(PARENTS) if p >= 0]
    assert min(lengths) > 0.03


def test_a_seed_is_a_person() -> None:
    assert torch.equal(invented_actor(1).vertices, invented_actor(1).vertices)
    assert not torch.equal(invented_actor(1).colours, invented_actor(2).colours)


@pytest.mark.parametrize(("angle", "place"), [(0.0, [0, 1, 3]), (math.pi / 2, [3, 1, 0])])
def test_the_camera_stands_where_it_is_told(angle: float, place: list[float]) -> None:
    target = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    camera = camera_around(target, angle, 3.0)
    centre = -camera[:3, :3].T @ camera[:3, 3]
    torch.testing.assert_close(centre, torch.tensor(place).double(), rtol=0, atol=1e-12)
    # The target is straight ahead, and up is up: image y points down.
    seen = camera[:3, :3] @ target + camera[:3, 3]
    torch.testing.assert_close(seen, torch.tensor([0.0, 0, 3]).double(), rtol=0, atol=1e-12)
    assert camera[1, 1].item() == pytest.approx(-1)


def test_the_person_is_in_the_middle_of_its_pictures() -> None:
    for view in invented_views(3, (32, 40)):
        seen = project(view.posed_vertices, view.K, view.camera_from_body)
        assert bool(seen.in_front.all())
        assert float((seen.depth - DISTANCE).abs().max()) < 1.2
        x, y = seen.pixels.round().long().unbind(-1)
        inside = (x >= 0) & (x < 32) & (y >= 0) & (y < 40)
        assert float(inside.float().mean()) > 0.9
        assert bool((view.alpha[y[inside], x[inside]] == 1).all())
        assert 0.02 < float(view.alpha.mean()) < 0.5


def test_samples_are_a_function_of_their_index() -> None:
    source = InventedSource(3, (2, 8), (32, 40))
    sample, again, other = source[5], source[5], source[13]
    assert torch.equal(sample.patches, again.patches)
    assert not torch.equal(sample.patches, other.patches)
    assert sample.patches.shape == (2, 8, 8, 2)
    assert sample.patches.amin() >= 0
    assert sample.patches[..., 0].max() < 32
    assert sample.patches[..., 1].max() < 40
    assert len(sample.supports) == 3
    assert all(view is not sample.target for view in sample.supports)
