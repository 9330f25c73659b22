import torch

from actorsnerf_model.baked.actor import BakedPose, BakedState
from actorsnerf_model.baked.node_warp import warped
from actorsnerf_model.skinning import backward_warp


def test_it_is_the_backward_warp_where_anything_is_likely(
    state: BakedState, pose: BakedPose, generator: torch.Generator
) -> None:
    low, high = pose.bounds
    points = low + (high - low) * torch.rand(20000, 3, generator=generator)
    volume = state.data.skinning
    found = warped(points.T.contiguous(), volume, state.support, pose.canonical_from_body)
    place, likelihood = backward_warp(points, volume, pose.canonical_from_body)
    torch.testing.assert_close(found[3], likelihood, atol=1e-5, rtol=0)
    likely = likelihood > 0.01
    assert int(likely.sum()) > 1000
    torch.testing.assert_close(found[:3].T[likely], place[likely], atol=1e-3, rtol=0)
    assert torch.isfinite(found).all()


def test_a_place_is_a_mean_of_the_bones_however_unlikely(
    state: BakedState, generator: torch.Generator
) -> None:
    """The backward warp divides by 1e-4 at least, and pulls unlikely places to the origin."""
    volume = state.data.skinning
    low, high = volume.box
    points = low + (high - low) * torch.rand(20000, 3, generator=generator)
    at_rest = torch.eye(4).expand(24, 4, 4)
    found = warped(points.T.contiguous(), volume, state.support, at_rest)
    held = (found[3] > 1.1e-5) & (found[3] < 5e-5)
    assert int(held.sum()) > 20
    torch.testing.assert_close(found[:3, held], points.T[:, held], atol=1e-4, rtol=0)


def test_no_points(state: BakedState, pose: BakedPose) -> None:
    none = warped(torch.zeros(3, 0), state.data.skinning, state.support, pose.canonical_from_body)
    assert none.shape == (4, 0)
