from collections.abc import Callable

import pytest
import torch
from tests.model.ablations import ABLATIONS, name
from torch import Tensor, nn

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import CategoryPrior
from actorsnerf_model.actorsnerf import ActorsNeRF, ActorsNeRFConfig
from actorsnerf_model.presets import TINY
from actorsnerf_model.published_order import PublishedOrder, PublishedState
from actorsnerf_model.rays import rays_through
from actorsnerf_model.reference import reference_render_pixels
from actorsnerf_model.render import render_pixels
from actorsnerf_model.states import Camera, Method, RenderOptions

Views = Callable[..., tuple[View, ...]]
OPEN = 3.0
"""All octaves of `TINY`'s deformation."""


def made(config: ActorsNeRFConfig, views: tuple[View, ...]) -> tuple[ActorsNeRF, CategoryPrior]:
    torch.manual_seed(4)
    method = ActorsNeRF(config).to(views[0].image.dtype)
    if method.deformation is not None:
        nn.init.normal_(method.deformation.offset.weight, std=0.02)
    return method, method.category_prior(views[:3])


def is_method(method: PublishedOrder) -> Method[PublishedState]:
    """For the type checker: the contract is kept."""
    return method


@pytest.mark.parametrize("config", ABLATIONS, ids=name)
@pytest.mark.parametrize("window", [OPEN, 0.0])
def test_both_orders_are_one_field(
    config: ActorsNeRFConfig, window: float, support_views: Views
) -> None:
    views = support_views(4, dtype=torch.float64)
    method, prior = made(config, views)
    published = PublishedOrder(method)
    actor, plain = method.instance_state(prior, window), published.instance_state(prior, window)
    pose = method.pose_state(actor, views[3].pose, views[3].rest_joints)
    points = views[3].posed_vertices + 0.02
    located = published.locate(plain, pose, points, 0.01)
    assert len(located.index) > 50
    fast, slow = method.field(actor, pose, located), published.field(plain, pose, located)
    torch.testing.assert_close(fast.rgb, slow.rgb, atol=1e-10, rtol=0)
    torch.testing.assert_close(fast.density, slow.density, atol=1e-8, rtol=1e-10)


def test_float32_differs_by_rounding(support_views: Views) -> None:
    views = support_views(4)
    method, prior = made(TINY, views)
    published = PublishedOrder(method)
    actor, plain = method.instance_state(prior, OPEN), published.instance_state(prior, OPEN)
    pose = method.pose_state(actor, views[3].pose, views[3].rest_joints)
    located = method.locate(actor, pose, views[3].posed_vertices, 0.01)
    fast, slow = method.field(actor, pose, located), published.field(plain, pose, located)
    torch.testing.assert_close(fast.rgb, slow.rgb, atol=1e-5, rtol=0)
    # One unit of the raw density is worth 100 per metre here.
    torch.testing.assert_close(fast.density, slow.density, atol=1e-3, rtol=1e-5)


def test_pictures_and_gradients_are_the_renderers(support_views: Views) -> None:
    """The published order through the reference renderer, ours through the one that saves work."""
    views = support_views(4, dtype=torch.float64)
    target = views[3]
    method, _ = made(TINY, views)
    published = PublishedOrder(method)
    camera = Camera(target.K, target.camera_from_body, (48, 64))
    x, y = torch.meshgrid(torch.arange(16.0, 32, 3), torch.arange(8.0, 40, 4), indexing="ij")
    rays = rays_through(torch.stack([x, y], -1).reshape(-1, 2).double(), camera)
    options = RenderOptions(samples=24)
    weights = torch.linspace(0.5, 1.5, 3 * x.numel(), dtype=torch.float64).reshape(-1, 3)

    def gradients(rgb: Tensor) -> dict[str, Tensor]:
        method.zero_grad(set_to_none=True)
        torch.autograd.backward((rgb * weights).sum())
        named = method.named_parameters()
        return {key: p.grad.clone() for key, p in named if p.grad is not None}

    plain = published.actor_state(views[:3], OPEN)
    pose = published.pose_state(plain, target.pose, target.rest_joints)
    slow = reference_render_pixels(published, plain, pose, rays, options).rgb
    expected = gradients(slow)
    actor = method.actor_state(views[:3], OPEN)
    pose = method.pose_state(actor, target.pose, target.rest_joints)
    fast = render_pixels(method, actor, pose, rays, options).rgb
    found = gradients(fast)
    assert slow.std() > 0.01
    torch.testing.assert_close(fast, slow, atol=1e-10, rtol=0)
    assert found.keys() == expected.keys()
    assert {"encoder", "radiance"} <= {key.split(".")[0] for key in found}
    for key, value in expected.items():
        error = (found[key] - value).norm() / value.norm().clamp(min=1e-12)
        assert error < 1e-8, key
