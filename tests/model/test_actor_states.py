from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import (
    actor_geometry,
    check_supports,
    support_cameras,
    support_motions,
)
from actorsnerf_model.skinning import canonical_box
from actorsnerf_model.sparse_conv import SparseConfig

Views = Callable[..., tuple[View, ...]]
SPARSE = SparseConfig(0.05, (4, 4), (1, 1), (0, 1))


def test_geometry_is_the_same_from_every_view(support_views: Views) -> None:
    views = support_views()
    first, last = (actor_geometry(view, 8, SPARSE) for view in (views[0], views[2]))
    assert torch.equal(first.box, last.box)
    assert torch.equal(first.box, canonical_box(views[1].canonical_joints))
    assert torch.equal(first.log_prior, last.log_prior)
    assert first.log_prior.shape == (25, 8, 8, 8)
    assert first.plan is not None and last.plan is not None
    assert torch.equal(first.plan.levels[0].voxels, last.plan.levels[0].voxels)


def test_no_sparse_network_no_plan(support_views: Views) -> None:
    assert actor_geometry(support_views()[0], 8, None).plan is None


def test_motions_carry_the_vertices_to_each_view(support_views: Views) -> None:
    views = support_views()
    motions = support_motions(views, views[0].canonical_joints)
    for view, moved in zip(views, motions, strict=True):
        ends = torch.cat([view.rest_vertices, torch.ones(len(view.rest_vertices), 1)], 1)
        everywhere = (moved[:, :3] @ ends.T).permute(2, 0, 1)
        nearest = (everywhere - view.posed_vertices[:, None]).norm(dim=-1).amin(1)
        assert float(nearest.max()) < 1e-5


def test_cameras_in_one_batch(support_views: Views) -> None:
    views = support_views()
    cameras = support_cameras(views)
    assert cameras.K.shape == (3, 3, 3)
    assert torch.equal(cameras.camera_from_body[1], views[1].camera_from_body)


def test_a_crop_that_hangs_over_knows_where_its_picture_ends(support_views: Views) -> None:
    over = replace(support_views()[0], offset=(-3, 5), full_size=(40, 30))
    (edges,) = support_cameras((over,)).edges
    assert edges.tolist() == [[2.5, -5.5], [42.5, 24.5]]


def test_wrong_number_of_views(support_views: Views) -> None:
    with pytest.raises(UserError, match="2 support views were given, the model was built for 3"):
        check_supports(support_views(2), 3)


def test_views_of_two_actors(support_views: Views) -> None:
    first, second = support_views(2)
    with pytest.raises(UserError, match=r"show 2 actors \(actor, other\), expected one"):
        check_supports((first, replace(second, actor="other")), 2)
