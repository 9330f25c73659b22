from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import nn

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.humannerf import HumanNeRF, HumanNeRFConfig, HumanNeRFState
from actorsnerf_model.presets import HUMANNERF_OFFICIAL, HUMANNERF_TINY
from actorsnerf_model.rays import rays_through
from actorsnerf_model.reference import reference_render_pixels
from actorsnerf_model.render import render_pixels
from actorsnerf_model.states import Camera, Method, RenderOptions

Views = Callable[..., tuple[View, ...]]
OPTIONS = RenderOptions(samples=24, soft_mask=True)
ABLATIONS = [
    HUMANNERF_TINY,
    replace(HUMANNERF_TINY, refiner=None),
    replace(HUMANNERF_TINY, motion=None),
]


def awake(config: HumanNeRFConfig, dtype: torch.dtype = torch.float32) -> HumanNeRF:
    """Random weights with which every part does something."""
    torch.manual_seed(5)
    method = HumanNeRF(config).to(dtype)
    if method.motion is not None:
        nn.init.normal_(method.motion.offset.weight, std=0.01)
    if method.refiner is not None:
        nn.init.normal_(method.refiner.correction.weight, std=0.02)
    nn.init.constant_(method.canonical.out.bias[3:], 5.0)
    return method


def is_method(method: HumanNeRF) -> Method[HumanNeRFState]:
    """For the type checker: the contract is kept."""
    return method


def camera_of(view: View) -> Camera:
    return Camera(view.K, view.camera_from_body, (view.image.shape[1], view.image.shape[0]))


def some_pixels(view: View) -> torch.Tensor:
    height, width = view.image.shape[:2]
    x, y = torch.meshgrid(torch.arange(1, width, 5), torch.arange(1, height, 5), indexing="xy")
    return torch.stack([x, y], -1).reshape(-1, 2).to(view.K.dtype)


def test_the_renderer_gives_the_references_picture(support_views: Views) -> None:
    views = support_views(4, dtype=torch.float64)
    method = awake(HUMANNERF_TINY, torch.float64).eval()
    with torch.no_grad():
        actor = method.actor_state(views[:3], 3.0)
        pose = method.pose_state(actor, views[3].pose, views[3].rest_joints)
        rays = rays_through(some_pixels(views[3]), camera_of(views[3]))
        found = render_pixels(method, actor, pose, rays, OPTIONS)
        expected = reference_render_pixels(method, actor, pose, rays, OPTIONS)
    assert expected.alpha.max() > 0.3
    assert (found.rgb - expected.rgb).abs().max() < 1e-7
    assert (found.alpha - expected.alpha).abs().max() < 1e-7


@pytest.mark.parametrize("config", ABLATIONS)
def test_every_parameter_learns(config: HumanNeRFConfig, support_views: Views) -> None:
    """The picture pulls at refiner and skinning through the warp, at the rest through the field."""
    views = support_views(4, dtype=torch.float64)
    method = awake(config, torch.float64)
    assert (method.refiner is None) == (config.refiner is None)
    assert (method.motion is None) == (config.motion is None)
    actor = method.actor_state(views[:3], 3.0)
    pose = method.pose_state(actor, views[3].pose, views[3].rest_joints)
    rays = rays_through(some_pixels(views[3]), camera_of(views[3]))
    seen = render_pixels(method, actor, pose, rays, OPTIONS)
    torch.autograd.backward(seen.rgb.square().sum() + seen.alpha.sum())
    for name, parameter in method.named_parameters():
        assert parameter.grad is not None, name
        assert bool(parameter.grad.isfinite().all()), name
        assert bool((parameter.grad != 0).any()), name


def test_a_closed_window_leaves_the_motion_out(support_views: Views) -> None:
    views = support_views(4)
    method = awake(HUMANNERF_TINY).eval()
    still = awake(replace(HUMANNERF_TINY, motion=None)).eval()
    kept = {k: v for k, v in method.state_dict().items() if not k.startswith("motion.")}
    still.load_state_dict(kept)
    pictures = []
    for network, window in ((method, 0.0), (still, 3.0), (method, 3.0)):
        with torch.no_grad():
            actor = network.actor_state(views[:3], window)
            pose = network.pose_state(actor, views[3].pose, views[3].rest_joints)
            located = network.locate(actor, pose, views[3].posed_vertices, 0.01)
            pictures.append(network.field(actor, pose, located).rgb)
    assert torch.equal(pictures[0], pictures[1])
    assert (pictures[2] - pictures[0]).abs().max() > 1e-4


def test_the_refiner_moves_the_bones_but_not_the_bounds(support_views: Views) -> None:
    views = support_views(4)
    method = awake(HUMANNERF_TINY).eval()
    plain = awake(replace(HUMANNERF_TINY, refiner=None)).eval()
    poses = []
    for network in (method, plain):
        actor = network.actor_state(views[:3], 0.0)
        poses.append(network.pose_state(actor, views[3].pose, views[3].rest_joints))
    moved, still = poses
    assert torch.equal(moved.bounds, still.bounds)
    assert (moved.canonical_from_body - still.canonical_from_body).abs().max() > 1e-3
    identity = moved.canonical_from_body @ moved.body_from_canonical
    assert (identity - torch.eye(4)).abs().max() < 1e-5
    # The root is the camera's business.
    torch.testing.assert_close(moved.canonical_from_body[0], still.canonical_from_body[0])


def test_reads_no_picture(support_views: Views) -> None:
    views = support_views(4)
    dark = tuple(replace(view, image=torch.zeros_like(view.image)) for view in views[:3])
    method = awake(HUMANNERF_TINY).eval()
    with torch.no_grad():
        found = []
        for supports in (views[:3], dark):
            actor = method.actor_state(supports, 3.0)
            pose = method.pose_state(actor, views[3].pose, views[3].rest_joints)
            located = method.locate(actor, pose, views[3].posed_vertices, 0.01)
            found.append(method.field(actor, pose, located).rgb)
    assert torch.equal(*found)


def test_nothing_pulls_at_the_skinning_and_nothing_freezes(support_views: Views) -> None:
    method = awake(HUMANNERF_TINY)
    method.freeze_category_prior()
    assert all(parameter.requires_grad for parameter in method.parameters())
    prior = method.category_prior(support_views(3))
    assert method.skinning_residual(prior) == 0
    low, high = prior.box
    joints = prior.canonical_joints
    torch.testing.assert_close(low, joints.amin(0) - 0.3)
    torch.testing.assert_close(high, joints.amax(0) + 0.3)


def test_half_precision_stays_in_the_networks(support_views: Views) -> None:
    views = support_views(4)
    exact = awake(HUMANNERF_TINY).eval()
    half = HumanNeRF(HUMANNERF_TINY, torch.bfloat16).eval()
    half.load_state_dict(exact.state_dict())
    located, colours = [], []
    for method in (exact, half):
        with torch.no_grad():
            actor = method.actor_state(views[:3], 3.0)
            pose = method.pose_state(actor, views[3].pose, views[3].rest_joints)
            located.append(method.locate(actor, pose, views[3].posed_vertices, 0.01))
            colours.append(method.field(actor, pose, located[-1]).rgb)
    assert colours[1].dtype == torch.float32
    # The refiner's half precision turns a joint by milliradians.
    assert abs(located[0].index.numel() - located[1].index.numel()) <= 2


def test_the_released_model_has_the_released_skinning_decoder() -> None:
    assert HUMANNERF_OFFICIAL.skinning.nodes == 32
    assert HUMANNERF_TINY.skinning.nodes == 16
