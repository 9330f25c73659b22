from collections.abc import Callable
from typing import Protocol

import pytest
import torch

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked.actor import BakedActorData
from actorsnerf_model.baked.baking import FOLLOWS, BakeOptions, BakeReport, bake
from actorsnerf_model.baked.bricks import VISIBLE_DENSITY, brick_table, look_up
from actorsnerf_model.baked.offset_nodes import offsets_in_pose

Bake = Callable[[float], tuple[BakedActorData, BakeReport]]


class Fitted(Protocol):
    method: ActorsNeRF
    actor: ActorsNeRFState
    views: tuple[View, ...]


def test_nodes_hold_the_field_of_the_mean_deformation(fitted: Fitted, baked_at: Bake) -> None:
    data, report = baked_at(0.04)
    field = data.field
    place = (field.index >= 0).nonzero()[::7]  # each brick's first node
    points = field.low + place.flip(-1) * 4 * field.voxel
    rgb, density = look_up(brick_table(field), points + 1e-6)
    poses = torch.stack([view.pose for view in fitted.views[:3]])
    with torch.no_grad():
        wanted = fitted.method.mean_field(fitted.actor, points, poses)
        colours = wanted.rgb
    solid = (density > VISIBLE_DENSITY) & (wanted.density > VISIBLE_DENSITY)
    assert int(solid.sum()) > 10
    assert float((rgb - colours)[solid].abs().max()) < 0.01
    ratio = density[solid] / wanted.density.detach()[solid]
    assert float(ratio.log().abs().max()) < 0.1
    assert report.bricks == field.codes.shape[0] and report.bytes == field.bytes


def test_offsets_are_the_networks_beyond_their_mean(fitted: Fitted, baked_at: Bake) -> None:
    data, report = baked_at(0.04)
    nodes = data.offsets
    assert nodes is not None and nodes.nodes.shape[0] == report.offset_nodes
    assert report.follow in FOLLOWS and 1e-3 < report.slide < 0.1
    _, y, x = nodes.sizes
    number = nodes.nodes.long()
    place = torch.stack([number % x, number // x % y, number // (x * y)], -1)
    points = nodes.low + place * nodes.spacing
    poses = torch.stack([view.pose for view in fitted.views])
    with torch.no_grad():
        mean = fitted.method.offsets(fitted.actor, points, poses[:3])
        moved = fitted.method.offsets(fitted.actor, points, poses[3:])
    wanted = report.follow * (moved - mean)
    torch.testing.assert_close(offsets_in_pose(nodes, poses[3]), wanted, atol=2e-4, rtol=0.02)


def test_without_deformation_nothing_follows(fitted: Fitted) -> None:
    with torch.no_grad():
        actor = fitted.method.actor_state(fitted.views[:3], 0.0)
    data, report = bake(fitted.method, actor, fitted.views[:3], BakeOptions(voxel=0.08))
    assert data.offsets is None
    assert (report.offset_nodes, report.slide, report.follow) == (0, 0.0, 0.0)


def test_finer_means_more(baked_at: Bake) -> None:
    coarse, fine = baked_at(0.08)[1], baked_at(0.04)[1]
    assert 3 * coarse.bricks < fine.bricks < 10 * coarse.bricks


def test_what_is_stored_small_is_used_small(fitted: Fitted, baked_at: Bake) -> None:
    data, _ = baked_at(0.08)
    weights = data.skinning.weights
    assert torch.equal(weights.half().float(), weights)
    assert weights.numpy() == pytest.approx(fitted.actor.body.skinning.weights, abs=5e-4)
    assert data.offsets is not None
    assert torch.equal(data.offsets.given.half().float(), data.offsets.given)
    assert torch.equal(data.home_pose, fitted.views[0].pose)
