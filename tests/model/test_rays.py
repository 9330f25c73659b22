import dataclasses
from typing import TYPE_CHECKING

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from actorsnerf_model.projection import NEAR_PLANE, project
from actorsnerf_model.rays import (
    PARALLEL,
    Rays,
    draw_jitter,
    intersect_box,
    rays_through,
    sample_depths,
    spacings,
    unit,
)

if TYPE_CHECKING:
    from tests.model.conftest import ToyScene

BOX = torch.tensor([[-1.0, -2.0, -0.5], [1.0, 2.0, 0.5]], dtype=torch.float64)


def rays(origin: list[float], *directions: list[float]) -> Rays:
    return Rays(
        torch.tensor(origin, dtype=torch.float64), torch.tensor(directions, dtype=torch.float64)
    )


def test_unit_directions() -> None:
    """Also of a direction without length, which no camera gives: finite, its gradient too."""
    given = torch.tensor([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]], requires_grad=True)
    found = unit(given)
    torch.testing.assert_close(found, torch.tensor([[0.6, 0.0, 0.8], [0.0, 0.0, 0.0]]))
    (gradient,) = torch.autograd.grad(found.sum(), given)
    assert bool(gradient.isfinite().all())


def test_a_ray_returns_to_its_pixel(scene64: "ToyScene") -> None:
    pixels = torch.tensor([[0.0, 0.0], [31.0, 39.0], [3.25, 17.5]], dtype=torch.float64)
    cast = rays_through(pixels, scene64.camera)
    points = cast.origin + 2.5 * cast.directions
    seen = project(points, scene64.camera.K, scene64.camera.camera_from_body)
    torch.testing.assert_close(seen.pixels, pixels, rtol=0, atol=1e-12)
    torch.testing.assert_close(seen.depth, torch.full((3,), 2.5, dtype=torch.float64))


def test_the_principal_point_looks_along_the_axis(scene64: "ToyScene") -> None:
    K = scene64.camera.K.clone()
    camera = dataclasses.replace(scene64.camera, K=K)
    cast = rays_through(K[:2, 2][None], camera)
    torch.testing.assert_close(cast.directions[0], camera.camera_from_body[2, :3])


def test_through_the_middle_of_a_face() -> None:
    span = intersect_box(rays([0, 0, -3], [0, 0, 1]), BOX)
    assert (span.near.item(), span.far.item(), span.hit.item()) == (2.5, 3.5, True)


@pytest.mark.parametrize(
    ("origin", "direction", "near", "far"),
    [
        ([1, 0, -3], [0, 0, 1], 2.5, 3.5),  # along a face
        ([1, 2, -3], [0, 0, 1], 2.5, 3.5),  # along an edge
        ([-2, -4, -1], [1, 2, 0.5], 1.0, 3.0),  # through two corners
        ([0, 0, 0], [1, 0, 0], NEAR_PLANE, 1.0),  # camera inside
        ([0, 0, 0.5], [0, 0, -1], NEAR_PLANE, 1.0),  # camera on a face
    ],
)
def test_hard_rays_meet_the_box(
    origin: list[float], direction: list[float], near: float, far: float
) -> None:
    span = intersect_box(rays(origin, direction), BOX)
    assert span.hit.item()
    assert span.near.item() == pytest.approx(near, abs=1e-12)
    assert span.far.item() == pytest.approx(far, abs=1e-12)


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ([0, 0, 3], [0, 0, 1]),  # box behind the camera
        ([1.0001, 0, -3], [0, 0, 1]),  # beside a face, parallel to it
        ([-2, 0, 0], [0, 0, 1]),  # parallel to two pairs of faces, outside
        ([-3, -2, 0], [1, -1, 0]),  # away from it
        ([0, 0, 0.5], [0, 0, 1]),  # on a face, looking out
        ([-2, 0, -0.5], [1, 0, 1]),  # touches one edge: nothing to integrate
        ([0, 0, -3], [0, 0, 0]),  # no direction
    ],
)
def test_hard_rays_miss_the_box(origin: list[float], direction: list[float]) -> None:
    span = intersect_box(rays(origin, direction), BOX)
    assert not span.hit.item()
    assert (span.near.item(), span.far.item()) == (0, 0)


def test_tiny_and_negative_components_change_little() -> None:
    exact = intersect_box(rays([1, 0, -3], [0, 0, 1]), BOX)
    for tiny in (1e-300, -1e-300, -1e-12, 5e-324):
        span = intersect_box(rays([1, 0, -3], [tiny, 0, 1]), BOX)
        assert torch.isfinite(span.near).all() and torch.isfinite(span.far).all()
        if tiny < 0:
            assert span.far.item() == exact.far.item()


def test_a_nearly_parallel_ray_has_a_finite_gradient_in_float32() -> None:
    direction = torch.tensor([[1e-30, 0.0, 1.0]], requires_grad=True)
    span = intersect_box(Rays(torch.tensor([0.25, 0.0, -3.0]), direction), BOX.float())
    assert (span.near.item(), span.far.item()) == (2.5, 3.5)
    torch.autograd.backward((span.near + span.far).sum())
    assert direction.grad is not None
    assert torch.isfinite(direction.grad).all()


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-4, 4), min_size=6, max_size=6))
@example([-1.0, 0.0, 0.0, -9e-299, 0.0, 0.0])  # leaves a face too slowly for float64
def test_the_span_is_where_the_ray_is_inside(numbers: list[float]) -> None:
    cast = rays(numbers[:3], numbers[3:])
    span = intersect_box(cast, BOX)
    depth = torch.linspace(NEAR_PLANE, 40, 4001, dtype=torch.float64)
    points = cast.origin + depth[:, None] * cast.directions
    well_inside = ((points > BOX[0] + 1e-9) & (points < BOX[1] - 1e-9)).all(-1)
    nearly_inside = ((points >= BOX[0] - 1e-9) & (points <= BOX[1] + 1e-9)).all(-1)
    within = (depth >= span.near) & (depth <= span.far) & span.hit
    if cast.directions.abs().max() >= PARALLEL:
        assert (within | ~well_inside).all()
    assert (nearly_inside | ~within).all()


def test_samples_by_hand() -> None:
    near, far = torch.tensor([1.0]), torch.tensor([3.0])
    assert sample_depths(near, far, 5, None).tolist() == [[1.0, 1.5, 2.0, 2.5, 3.0]]
    assert sample_depths(near, far, 1, None).tolist() == [[2.0]]
    half = torch.full((1, 3), 0.5)
    assert sample_depths(near, far, 3, half).tolist() == [[1.25, 2.0, 2.75]]


def test_jittered_samples_ascend_inside_their_strata(generator: torch.Generator) -> None:
    near, far = torch.tensor([1.0, 2.0]), torch.tensor([3.0, 2.5])
    cast = rays([0, 0, 0], [0, 0, 1], [0, 0, 1])
    jitter = draw_jitter(cast, 16, generator)
    assert jitter is not None
    depths = sample_depths(near.double(), far.double(), 16, jitter)
    assert (depths[:, 1:] >= depths[:, :-1]).all()
    assert (depths >= near[:, None]).all() and (depths <= far[:, None]).all()
    assert draw_jitter(cast, 16, None) is None


def test_a_seed_gives_the_same_samples_in_both_precisions() -> None:
    cast = rays([0, 0, 0], [0, 0, 1], [0, 1, 1])
    single = Rays(cast.origin.float(), cast.directions.float())
    found = [draw_jitter(one, 8, torch.Generator().manual_seed(3)) for one in (cast, single)]
    assert found[0] is not None and found[1] is not None
    assert (found[0].dtype, found[1].dtype) == (torch.float64, torch.float32)
    torch.testing.assert_close(found[0], found[1].double(), rtol=0, atol=0)


def test_spacing_is_a_distance_and_the_last_is_regular() -> None:
    cast = rays([0, 0, 0], [0, 3, 1])
    near, far = torch.tensor([1.0]).double(), torch.tensor([2.0]).double()
    depths = sample_depths(near, far, 5, None)
    found = spacings(depths, near, far, cast)
    expected = torch.full((1, 5), 0.25 * 10**0.5, dtype=torch.float64)
    torch.testing.assert_close(found, expected)
    alone = spacings(sample_depths(near, far, 1, None), near, far, cast)
    torch.testing.assert_close(alone, torch.full((1, 1), 10**0.5, dtype=torch.float64))


def test_no_rays() -> None:
    none = Rays(torch.zeros(3), torch.zeros(0, 3))
    span = intersect_box(none, BOX.float())
    assert span.hit.shape == (0,)
    assert sample_depths(span.near, span.far, 4, None).shape == (0, 4)
