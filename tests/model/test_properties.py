"""Properties that hold for every input; hypothesis looks for one that breaks them.

Derandomised: the same examples on every machine. What a longer search found stays as `@example`.
"""

import math
from typing import TYPE_CHECKING

import torch
import torch.nn.functional as F
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from torch import Tensor

from actorsnerf_datasets import rotations as numpy_rotations
from actorsnerf_model.interpolation import bilinear, trilinear
from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames
from actorsnerf_model.occupancy import pose_occupancy
from actorsnerf_model.projection import NEAR_PLANE, project
from actorsnerf_model.rays import Rays, intersect_box, rays_through
from actorsnerf_model.rotations import matrix_from_axis_angle
from actorsnerf_model.skinning import backward_warp
from actorsnerf_model.skinning_bounds import possible
from actorsnerf_model.states import Camera
from actorsnerf_model.volume_rendering import composite, optical_depth

if TYPE_CHECKING:
    from tests.model.conftest import ToyScene

SEARCH = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
angles = st.lists(st.floats(-20, 20, width=32), min_size=3, max_size=3)
places = st.lists(st.floats(-3, 3, width=32), min_size=3, max_size=3)


def leaf(numbers: list[float], dtype: torch.dtype) -> Tensor:
    return torch.tensor(numbers, dtype=torch.float64).to(dtype).requires_grad_()


@SEARCH
@given(angles)
@example([0.0, 0.0, 0.0])
@example([1e-30, 0.0, 0.0])
@example([0.1, 0.0, 0.0])  # where series and formula meet
@example([math.pi, 0.0, 0.0])
@example([0.0, 2 * math.pi, 0.0])
def test_rotations_are_orthogonal_right_handed_and_smooth(numbers: list[float]) -> None:
    for dtype, close in ((torch.float64, 1e-12), (torch.float32, 1e-6)):
        turn = leaf(numbers, dtype)
        matrix = matrix_from_axis_angle(turn)
        fixed = matrix.detach()
        assert float((fixed @ fixed.T - torch.eye(3, dtype=dtype)).abs().max()) <= close
        assert float(torch.linalg.det(fixed.double())) > 0.99
        exact = numpy_rotations.matrix_from_axis_angle(turn.detach().double().numpy())
        away = float((fixed.double() - torch.from_numpy(exact)).abs().max())
        assert away <= 10 * close * max(1.0, float(turn.detach().norm()))
        torch.autograd.backward(matrix.sum())
        assert turn.grad is not None
        assert torch.isfinite(turn.grad).all()


@SEARCH
@given(angles)
def test_the_opposite_rotation_undoes_it(numbers: list[float]) -> None:
    turn = torch.tensor(numbers, dtype=torch.float64)
    both = matrix_from_axis_angle(turn) @ matrix_from_axis_angle(-turn)
    torch.testing.assert_close(both, torch.eye(3, dtype=torch.float64), rtol=0, atol=1e-12)


@SEARCH
@given(places, places)
@example([0.25, 0.0, -3.0], [1e-30, 0.0, 1.0])  # its gradient once was infinity times zero
@example([0.5, 0.0, -3.0], [0.0, 0.0, 1.0])  # in a face
@example([0.5, 1.0, -3.0], [0.0, 0.0, 1.0])  # along an edge
@example([0.0, 0.0, 0.25], [0.0, 0.0, 0.0])  # no direction
@example([1.5, 2.0, 1.75], [-1.0, -1.0, -1.0])  # through a corner
@example([0.0, 0.0, 0.1796875], [0.0, 0.0, -1.40625])  # its end is a rounding beyond the face
def test_spans_lie_in_the_box_and_gradients_are_finite(
    origin: list[float], direction: list[float]
) -> None:
    box = torch.tensor([[-0.5, -1.0, -0.25], [0.5, 1.0, 0.75]], dtype=torch.float64)
    for dtype, slack in ((torch.float64, 1e-9), (torch.float32, 1e-4)):
        start, way = leaf(origin, dtype), leaf(direction, dtype)
        span = intersect_box(Rays(start, way[None]), box.to(dtype))
        torch.autograd.backward((span.near + span.far).sum())
        for tensor in (start.grad, way.grad):
            assert tensor is not None
            assert torch.isfinite(tensor).all()
        near, far = span.near.item(), span.far.item()
        if not bool(span.hit):
            assert (near, far) == (0, 0)
            continue
        assert near >= NEAR_PLANE * (1 - 1e-7)
        assert near < far
        with torch.no_grad():
            ends = start + torch.stack([span.near, span.far]) * way
        reach = slack * max(1.0, far)
        assert ((ends >= box[0] - reach) & (ends <= box[1] + reach)).all()


@SEARCH
@given(
    st.lists(st.floats(-10, 6), min_size=2, max_size=40),
    st.floats(1e-4, 1),
    st.one_of(st.none(), st.floats(0, 24)),
)
@example([6.0, -10.0, 6.0], 1.0, None)
@example([6.0, 6.0], 1.0, 24.0)  # more than all the light is asked for
def test_weights_and_passing_light_sum_to_one(
    exponents: list[float], spacing: float, likelihood: float | None
) -> None:
    """Densities from 1e-10 to 1e6; the smallest count as none."""
    powers = torch.tensor([exponents], dtype=torch.float64)
    for dtype, close in ((torch.float64, 1e-12), (torch.float32, 1e-6)):
        density = torch.where(powers < -9, 0, 10**powers).to(dtype).requires_grad_()
        soft = None if likelihood is None else torch.full_like(density, likelihood)
        thickness = optical_depth(density, torch.full_like(density, spacing), soft)
        rgb = torch.ones(1, len(exponents), 3, dtype=dtype)
        seen = composite(rgb, thickness, torch.ones_like(thickness), torch.ones(3, dtype=dtype))
        whole = seen.weights.sum(-1) + torch.exp(-thickness.sum(-1))
        assert (whole - 1).abs().max().item() <= close
        assert (seen.rgb - 1).abs().max().item() <= close
        assert seen.weights.min().item() >= 0
        torch.autograd.backward(seen.depth.sum() + seen.alpha.sum())
        assert density.grad is not None
        assert torch.isfinite(density.grad).all()


@SEARCH
@given(places, angles, st.floats(1, 5000))
@example([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 100.0)  # the camera's centre
@example([1e-3, 0.0, -1e-8], [0.0, 0.0, 0.0], 5000.0)
def test_projection_is_finite_and_rays_return(
    place: list[float], turn: list[float], focal: float
) -> None:
    K = torch.tensor([[focal, 0, 100], [0, focal, 80], [0, 0, 1]], dtype=torch.float64)
    camera_from_body = torch.eye(4, dtype=torch.float64)
    camera_from_body[:3, :3] = matrix_from_axis_angle(torch.tensor(turn, dtype=torch.float64))
    point = leaf(place, torch.float64)
    seen = project(point[None], K, camera_from_body)
    torch.autograd.backward(seen.pixels.sum() + seen.depth.sum())
    assert point.grad is not None
    assert torch.isfinite(seen.pixels).all() and torch.isfinite(point.grad).all()
    assert bool(seen.in_front) == (seen.depth.item() > NEAR_PLANE)
    if bool(seen.in_front):
        rays = rays_through(seen.pixels.detach(), Camera(K, camera_from_body, (200, 160)))
        back = rays.origin + seen.depth.detach() * rays.directions
        torch.testing.assert_close(back[0], point.detach(), rtol=0, atol=1e-9)


@SEARCH
@given(st.lists(st.floats(-1e5, 1e5, width=32), min_size=2, max_size=2))
@example([0.0, 0.0])
@example([6.0, 4.0])  # the last node
@example([-1.0, 2.0])  # a node outside
@example([6.5, 4.5])
@example([1e5, -1e5])
def test_bilinear_is_grid_sample(coordinates: list[float]) -> None:
    table = torch.arange(5 * 7 * 2, dtype=torch.float64).sin().reshape(5, 7, 2)
    xy = torch.tensor([coordinates], dtype=torch.float64)
    normal = 2 * xy / torch.tensor([6.0, 4.0], dtype=torch.float64) - 1
    expected = F.grid_sample(table.permute(2, 0, 1)[None], normal[None, None], align_corners=True)[
        0, :, 0
    ].T
    torch.testing.assert_close(bilinear(table[None], xy[None])[0], expected, rtol=0, atol=1e-11)


@SEARCH
@given(st.lists(st.floats(-2, 7, width=32), min_size=3, max_size=3))
@example([0.0, 0.0, 0.0])
@example([5.0, 4.0, 3.0])
@example([-1e-38, 2.0, 3.0])
def test_trilinear_is_grid_sample(coordinates: list[float]) -> None:
    volume = torch.arange(4 * 5 * 6 * 2, dtype=torch.float64).sin().reshape(4, 5, 6, 2)
    xyz = torch.tensor([coordinates], dtype=torch.float64)
    normal = 2 * xyz / torch.tensor([5.0, 4.0, 3.0], dtype=torch.float64) - 1
    expected = F.grid_sample(
        volume.permute(3, 0, 1, 2)[None], normal[None, None, None], align_corners=True
    )[0, :, 0, 0].T
    torch.testing.assert_close(trilinear(volume, xyz), expected, rtol=0, atol=1e-11)


@settings(SEARCH, max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0, 4), threshold=st.floats(0.005, 0.5))
@example(seed=0, size=math.pi, threshold=0.01)
def test_no_cull_loses_a_point(scene: "ToyScene", seed: int, size: float, threshold: float) -> None:
    """Neither the bones' boxes nor the cells, in any pose, at any threshold."""
    generator = torch.Generator().manual_seed(seed)
    joints, actor = scene.actor.canonical_joints, scene.actor
    pose = size * torch.randn(24, 3, generator=generator)
    pose[0] = 0
    there, _ = bone_motions(pose, joints, joints)
    box = observation_bounds(posed_frames(pose, joints)[1])
    points = box[0] + (box[1] - box[0]) * torch.rand(6000, 3, generator=generator)
    _, likelihood = backward_warp(points, actor.volume, there)
    person = (likelihood >= threshold).nonzero()[:, 0]
    kept = possible(points, actor.volume, actor.bounds, there, threshold)
    assert torch.isin(person, kept).all()
    cells = pose_occupancy(actor.tables, there, box, threshold)
    sizes = torch.tensor(cells.cells.shape)
    cell = ((points - cells.box[0]) / (cells.box[1] - cells.box[0]) * sizes).floor().long()
    cell = cell.minimum(sizes - 1).clamp(min=0)[person]
    assert cells.cells[tuple(cell.unbind(-1))].all()
