from typing import TYPE_CHECKING

import pytest
import torch

from actorsnerf_model.filled_cells import CELL, LEAST_DENSITY, FilledCells, SkipEmpty, may_hold
from actorsnerf_model.render import render
from actorsnerf_model.skinning import canonical_box
from actorsnerf_model.states import Method, RenderOptions

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.model.conftest import ToyScene

    from actorsnerf_datasets.torch_dataset import View

OPTIONS = RenderOptions(samples=64)


def test_empty_cells_reach_no_network_and_the_picture_stays(
    scene: "ToyScene", support_views: "Callable[..., tuple[View, ...]]"
) -> None:
    method = SkipEmpty(scene.method)
    with torch.no_grad():
        actor = method.filled(scene.actor, support_views(2))
        plain = render(scene.method, scene.actor, scene.pose, scene.camera, OPTIONS)
        found = render(method, actor, scene.pose, scene.camera, OPTIONS)
    assert plain.alpha.mean() > 0.03
    assert found.counts.survivors < 0.85 * plain.counts.survivors
    assert (found.rgb - plain.rgb).abs().max() <= 1 / 255
    assert (found.alpha - plain.alpha).abs().max() <= 1 / 255


def test_only_empty_points_are_left_out(
    scene: "ToyScene", support_views: "Callable[..., tuple[View, ...]]"
) -> None:
    method = SkipEmpty(scene.method)
    low, high = scene.pose.bounds
    shares = torch.rand(100_000, 3, generator=torch.Generator().manual_seed(2))
    points = low + shares * (high - low)
    with torch.no_grad():
        actor = method.filled(scene.actor, support_views(1))
        every = scene.method.locate(scene.actor, scene.pose, points, 0.01)
        kept = method.locate(actor, scene.pose, points, 0.01)
        density = scene.method.field(scene.actor, scene.pose, every).density
    dropped = ~torch.isin(every.index, kept.index)
    assert 0.05 < dropped.float().mean() < 0.95
    assert float(density[dropped].max()) < LEAST_DENSITY
    assert torch.equal(every.index[~dropped], kept.index)
    assert torch.equal(every.canonical[~dropped], kept.canonical)


def test_a_poses_cells_leave_out_only_what_nothing_fills(
    scene: "ToyScene", support_views: "Callable[..., tuple[View, ...]]"
) -> None:
    method = SkipEmpty(scene.method)
    views = support_views(2)
    with torch.no_grad():
        actor = method.filled(scene.actor, views)
        coarse = scene.method.pose_state(scene.actor, scene.pose.pose, views[0].rest_joints)
        pose = method.pose_state(actor, scene.pose.pose, views[0].rest_joints)
        plain = render(scene.method, scene.actor, coarse, scene.camera, OPTIONS)
        found = render(method, actor, pose, scene.camera, OPTIONS)
    assert coarse.occupancy is not None and pose.occupancy is not None
    assert torch.equal(pose.occupancy.box, coarse.occupancy.box)
    assert [size // 2 for size in pose.occupancy.cells.shape] == list(coarse.occupancy.cells.shape)
    halved = coarse.occupancy.cells
    for axis in range(3):
        halved = halved.repeat_interleave(2, axis)
    assert not bool((pose.occupancy.cells & ~halved).any())
    share = pose.occupancy.cells.float().mean() / halved.float().mean()
    assert 0.1 < share < 0.45
    assert found.counts.rays < 0.8 * plain.counts.rays
    assert plain.alpha.mean() > 0.03
    # An invented limb that ends at full density where its likelihood does may lose its very tip.
    worse = (found.rgb - plain.rgb).abs().amax(-1) > 1 / 255
    assert int(worse.sum()) <= 2
    assert (found.rgb - plain.rgb).abs().max() <= 0.06


def test_an_actor_made_of_supports_is_the_same(
    scene: "ToyScene", support_views: "Callable[..., tuple[View, ...]]"
) -> None:
    method = SkipEmpty(scene.method)
    assert isinstance(method, Method)
    views = support_views(1)
    with torch.no_grad():
        cells = method.actor_state(views, 0.0).cells
        again = method.filled(scene.actor, views).cells
    assert torch.equal(cells.filled, again.filled)
    box = canonical_box(views[0].canonical_joints)
    assert torch.equal(cells.low, box[0])
    reach = cells.low + CELL * torch.tensor(list(reversed(cells.filled.shape)))
    assert bool((reach >= box[1] - 1e-6).all())


@pytest.mark.parametrize(
    ("point", "expected"),
    [([0.5, 0.5, 0.5], True), ([1.5, 0.5, 0.5], False), ([0.5, 0.5, 1.5], False)],
)
def test_points_are_looked_up_along_x_y_z(point: list[float], expected: bool) -> None:
    filled = torch.zeros(2, 2, 2, dtype=torch.bool)
    filled[0, 0, 0] = True
    cells = FilledCells(torch.zeros(3), filled, 1.0)
    assert may_hold(cells, torch.tensor([point])).tolist() == [expected]
    # Rounding can carry a point a hair beyond the box: the last cell counts.
    assert may_hold(cells, torch.tensor([[-1e-6, 0.0, 0.0]])).tolist() == [True]
