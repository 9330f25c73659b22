import copy
import dataclasses
from collections.abc import Callable
from typing import Protocol

import pytest
import torch
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked import filled_voxels
from actorsnerf_model.baked import render as baked_render
from actorsnerf_model.baked.actor import (
    BakedActor,
    BakedActorData,
    BakedPose,
    BakedState,
    baked_state,
)
from actorsnerf_model.baked.baking import BakeOptions, BakeReport, bake
from actorsnerf_model.baked.bricks import VISIBLE_DENSITY
from actorsnerf_model.baked.march import STEP
from actorsnerf_model.baked.render import render_baked
from actorsnerf_model.render import render
from actorsnerf_model.states import Camera, RenderOptions

GROUND = (0.2, 0.4, 0.6)
LOST = 0.03
"""Mean difference of colour to the unbaked picture of a cloud, of its mean opacity, at most."""
OPTIONS = RenderOptions(samples=64, background=GROUND)
Bake = Callable[[float], tuple[BakedActorData, BakeReport]]


class Fitted(Protocol):
    method: ActorsNeRF
    actor: ActorsNeRFState
    views: tuple[View, ...]


def camera_of(view: View, moved: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Camera:
    into = view.camera_from_body.clone()
    into[:3, 3] += torch.tensor(moved)
    return Camera(view.K, into, (48, 64))


def decibel(a: Tensor, b: Tensor) -> float:
    return float(-10 * torch.log10((a - b).square().mean()))


def test_finer_grids_come_nearer_to_the_unbaked_picture(fitted: Fitted, baked_at: Bake) -> None:
    """A pose that was not baked; mistaken axes or motions would end below 15 dB."""
    view = fitted.views[3]
    exact = fitted.method.pose_state(fitted.actor, view.pose, view.rest_joints)
    with torch.no_grad():
        truth = render(fitted.method, fitted.actor, exact, camera_of(view), OPTIONS)
    seen = truth.alpha > 0.01
    assert 0.03 < float(seen.float().mean()) < 0.5
    assert float(truth.rgb[seen].std(0).max()) > 0.2
    found = []
    for voxel in (0.08, 0.04):
        state = baked_state(baked_at(voxel)[0])
        pose = BakedActor().pose_state(state, view.pose, view.rest_joints)
        fast = render_baked(BakedActor(), state, pose, camera_of(view), OPTIONS)
        found.append(decibel(fast.rgb[seen], truth.rgb[seen]))
        assert float((fast.alpha - truth.alpha).abs().mean()) < 0.02
    assert found[0] > 21 and found[1] > 27 and found[1] > found[0] + 2


def test_it_agrees_with_the_general_renderer(
    fitted: Fitted, state: BakedState, pose: BakedPose
) -> None:
    """Which warps every sample exactly. The body ends abruptly where the likelihood does, and its
    rim is a pixel's matter; a wrong warp would end below 20 dB."""
    camera = camera_of(fitted.views[3])
    dense = dataclasses.replace(OPTIONS, occupancy=False)
    slow = render(BakedActor(), state, pose, camera, dense)
    fast = render_baked(BakedActor(), state, pose, camera, OPTIONS)
    assert decibel(fast.rgb, slow.rgb) > 28
    both = (slow.alpha > 0.99) & (fast.alpha > 0.99)
    assert int(both.sum()) > 50
    assert float((slow.depth - fast.depth)[both].abs().median()) < 1.5 * STEP
    assert fast.counts.survivors < slow.counts.survivors


def test_it_keeps_its_precision_within_autocast(
    fitted: Fitted, state: BakedState, pose: BakedPose
) -> None:
    view = fitted.views[3]
    alone = render_baked(BakedActor(), state, pose, camera_of(view), OPTIONS)
    with torch.autocast("cpu", torch.bfloat16):
        again = BakedActor().pose_state(state, pose.pose, view.rest_joints)
        seen = render_baked(BakedActor(), state, again, camera_of(view), OPTIONS)
    assert torch.equal(seen.rgb, alone.rgb)
    assert seen.alpha.max() > 0.5


def test_an_image_side_is_only_a_cut(fitted: Fitted, state: BakedState, pose: BakedPose) -> None:
    """Half the picture is the half of the whole picture."""
    camera = camera_of(fitted.views[3])
    whole = render_baked(BakedActor(), state, pose, camera, OPTIONS)
    K = camera.K.clone()
    K[0, 2] -= 20
    part = Camera(K, camera.camera_from_body, (28, 64))
    cut = render_baked(BakedActor(), state, pose, part, OPTIONS)
    torch.testing.assert_close(cut.rgb, whole.rgb[:, 20:], atol=5e-3, rtol=0)


@pytest.mark.parametrize("moved", [(0.0, 0.0, -9.0), (50.0, 0.0, 0.0), (0.0, 0.0, 1e4)])
def test_nobody_before_the_camera_is_background(
    fitted: Fitted, state: BakedState, pose: BakedPose, moved: tuple[float, float, float]
) -> None:
    """Behind it, beside it, ten kilometres away."""
    seen = render_baked(BakedActor(), state, pose, camera_of(fitted.views[3], moved), OPTIONS)
    assert torch.isfinite(seen.rgb).all() and torch.isfinite(seen.depth).all()
    far = torch.tensor(GROUND).expand(64, 48, 3)
    assert int((seen.rgb - far).abs().amax(-1).gt(1e-6).sum()) <= 1


def test_a_camera_amid_the_body_sees_by_the_general_renderer(
    fitted: Fitted, state: BakedState, pose: BakedPose
) -> None:
    camera = camera_of(fitted.views[3], (0.0, 0.0, -2.7))
    few = dataclasses.replace(OPTIONS, samples=8)
    seen = render_baked(BakedActor(), state, pose, camera, few)
    assert torch.isfinite(seen.rgb).all()
    assert torch.equal(seen.rgb, render(BakedActor(), state, pose, camera, few).rgb)


def test_an_empty_actor_shows_the_background(fitted: Fitted, state: BakedState) -> None:
    field = state.data.field
    nothing = dataclasses.replace(
        field, index=torch.full_like(field.index, -1), codes=field.codes[:0]
    )
    empty = baked_state(dataclasses.replace(state.data, field=nothing))
    view = fitted.views[3]
    pose = BakedActor().pose_state(empty, view.pose, view.rest_joints)
    seen = render_baked(BakedActor(), empty, pose, camera_of(view), OPTIONS)
    assert torch.equal(seen.rgb, torch.tensor(GROUND).expand(64, 48, 3))
    assert not seen.alpha.any() and seen.counts.rays == 0


def test_what_is_stepped_over_is_not_missed(
    fitted: Fitted, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cloud against its unbaked picture, which knows no `VISIBLE_DENSITY`.

    Stepping over what is 50 times as dense loses most of it.
    """
    method = copy.deepcopy(fitted.method)
    thin = dataclasses.replace(method.config.radiance, density_shift=0.0, density_scale=0.5)
    method.radiance.config = thin
    view, supports = fitted.views[3], fitted.views[:3]
    with torch.no_grad():
        actor = method.actor_state(supports, 3.0)
        exact = method.pose_state(actor, view.pose, view.rest_joints)
        truth = render(method, actor, exact, camera_of(view), OPTIONS)
    assert 0.1 < float(truth.alpha.max()) < 0.9
    data, _ = bake(method, actor, supports, BakeOptions(voxel=0.04, offset_spacing=0.08))

    def missed() -> float:
        state = baked_state(data)
        pose = BakedActor().pose_state(state, view.pose, view.rest_joints)
        fast = render_baked(BakedActor(), state, pose, camera_of(view), OPTIONS)
        return float((fast.rgb - truth.rgb).abs().mean() / truth.alpha.mean())

    assert missed() < LOST
    monkeypatch.setattr(filled_voxels, "VISIBLE_DENSITY", 50 * VISIBLE_DENSITY)
    assert missed() > 2 * LOST


def test_interpolated_pixels_are_those_drawn(
    fitted: Fitted, state: BakedState, pose: BakedPose, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A picture of pixels much finer than the voxels, all drawn and half of them."""
    view = fitted.views[3]
    K = view.K.clone()
    K[:2] *= 4
    camera = Camera(K, view.camera_from_body, (192, 257))
    some = render_baked(BakedActor(), state, pose, camera, OPTIONS)
    monkeypatch.setattr(baked_render, "FINE", 0.0)
    every = render_baked(BakedActor(), state, pose, camera, OPTIONS)
    assert some.counts.rays < 0.7 * every.counts.rays
    assert some.counts.survivors < 0.7 * every.counts.survivors
    seen = every.alpha > 0.01
    assert decibel(some.rgb[seen], every.rgb[seen]) > 35
    assert float(((some.alpha - every.alpha).abs() > 0.1).float().mean()) < 2e-3
    solid = (some.alpha > 0.9) & (every.alpha > 0.9)
    assert float((some.depth - every.depth)[solid].abs().quantile(0.99)) < 0.02
