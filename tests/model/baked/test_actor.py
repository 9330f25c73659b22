from collections.abc import Callable
from typing import Protocol

import pytest
import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked.actor import BakedActor, BakedActorData, BakedState, baked_state
from actorsnerf_model.baked.baking import BakeReport
from actorsnerf_model.states import Method

Bake = Callable[[float], tuple[BakedActorData, BakeReport]]


class Fitted(Protocol):
    method: ActorsNeRF
    actor: ActorsNeRFState
    views: tuple[View, ...]


def _is_method(method: BakedActor) -> Method[BakedState]:
    """A type checker's test: the class fulfils the protocol."""
    return method


def test_it_is_a_method_that_knows_one_actor(fitted: Fitted) -> None:
    assert isinstance(BakedActor(), Method)
    with pytest.raises(UserError, match="cannot be made anew of 3 support views: fit a checkpoint"):
        BakedActor().actor_state(fitted.views[:3], 3.0)


def test_motions_and_places_are_the_methods_own(fitted: Fitted, baked_at: Bake) -> None:
    state = baked_state(baked_at(0.08)[0])
    view = fitted.views[3]
    pose = BakedActor().pose_state(state, view.pose, view.rest_joints)
    exact = fitted.method.pose_state(fitted.actor, view.pose, view.rest_joints)
    assert torch.equal(pose.canonical_from_body, exact.canonical_from_body)
    assert torch.equal(pose.body_from_canonical, exact.body_from_canonical)
    assert torch.equal(pose.bounds, exact.bounds)
    ours = BakedActor().locate(state, pose, view.posed_vertices, 0.01)
    theirs = fitted.method.locate(fitted.actor, exact, view.posed_vertices, 0.01)
    assert torch.equal(ours.index, theirs.index) and ours.index.shape[0] > 100
    torch.testing.assert_close(ours.canonical, theirs.canonical, atol=2e-4, rtol=0)
    torch.testing.assert_close(ours.likelihood, theirs.likelihood, atol=2e-3, rtol=0)


def test_its_field_comes_nearer_with_finer_voxels(fitted: Fitted, baked_at: Bake) -> None:
    view = fitted.views[0]  # a pose that was baked
    exact = fitted.method.pose_state(fitted.actor, view.pose, view.rest_joints)
    located = fitted.method.locate(fitted.actor, exact, view.posed_vertices, 0.05)
    with torch.no_grad():
        wanted = fitted.method.field(fitted.actor, exact, located)
        colours = wanted.rgb
    solid = wanted.density > 5
    assert int(solid.sum()) > 30
    missed = []
    for voxel in (0.08, 0.04):
        state = baked_state(baked_at(voxel)[0])
        pose = BakedActor().pose_state(state, view.pose, view.rest_joints)
        found = BakedActor().field(state, pose, located)
        missed.append(float((found.rgb - colours)[solid].square().mean().sqrt()))
    assert missed[1] < 0.8 * missed[0] and missed[1] < 0.15
