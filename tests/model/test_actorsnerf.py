from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest
import torch
from tests.model.ablations import ABLATIONS, name
from torch import Tensor, nn

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_file import support_tensors, supports_from_tensors
from actorsnerf_model.actor_states import ActorsNeRFState, CategoryPrior, UnreadMap
from actorsnerf_model.actorsnerf import ActorsNeRF, ActorsNeRFConfig
from actorsnerf_model.encoder import FeatureMap
from actorsnerf_model.presets import TINY
from actorsnerf_model.states import DensityFirst, Located, Method, PoseState

Views = Callable[..., tuple[View, ...]]
OPEN = 3.0
"""All octaves of `TINY`'s deformation."""
THRESHOLD = 0.01


@dataclass(frozen=True)
class Scene:
    method: ActorsNeRF
    prior: CategoryPrior
    actor: ActorsNeRFState
    pose: PoseState
    located: Located


def stage(config: ActorsNeRFConfig, views: tuple[View, ...], window: float = OPEN) -> Scene:
    torch.manual_seed(4)
    method = ActorsNeRF(config).to(views[0].image.dtype)
    if method.deformation is not None:
        nn.init.normal_(method.deformation.offset.weight, std=0.02)
    prior = method.category_prior(views[:3])
    actor = method.instance_state(prior, window)
    pose = method.pose_state(actor, views[-1].pose, views[-1].rest_joints)
    share = torch.rand(400, 3, dtype=views[0].image.dtype)
    joints = views[-1].posed_vertices[torch.randint(0, 150, (400,))]
    points = joints + 0.05 * (share - 0.5)
    return Scene(method, prior, actor, pose, method.locate(actor, pose, points, THRESHOLD))


def field(scene: Scene) -> DensityFirst:
    return scene.method.field(scene.actor, scene.pose, scene.located)


def is_method(method: ActorsNeRF) -> Method[ActorsNeRFState]:
    """For the type checker: the contract is kept."""
    return method


@pytest.mark.parametrize("config", ABLATIONS, ids=name)
def test_every_parameter_learns(config: ActorsNeRFConfig, support_views: Views) -> None:
    scene = stage(config, support_views(4))
    values = field(scene)
    loss = values.rgb.square().sum() + values.density.sum()
    loss = loss + scene.actor.body.residual.abs().sum() + scene.located.canonical.sum()
    torch.autograd.backward(loss)
    for parameter, value in scene.method.named_parameters():
        assert value.grad is not None, parameter
        assert bool(value.grad.isfinite().all()), parameter


@pytest.mark.parametrize("config", ABLATIONS, ids=name)
def test_a_part_that_is_off_does_not_exist(config: ActorsNeRFConfig, support_views: Views) -> None:
    scene = stage(config, support_views(4))
    method, actor = scene.method, scene.actor
    assert (method.deformation is None) == (not config.deformation)
    assert (method.sparse is None) == (not config.body_features)
    assert (method.radiance.pixel is None) == (not config.pixel_features)
    assert (method.encoder is None) == (not (config.pixel_features or config.body_features))
    assert (actor.maps is None) == (not config.pixel_features)
    assert (actor.levels == ()) == (not config.body_features)
    assert (actor.body.geometry.plan is None) == (not config.body_features)
    if method.encoder is not None:
        assert (method.encoder.reduction is None) == (not config.body_features)
    if method.deformation is not None:
        assert (method.deformation.pixel_code is None) == (not config.pixel_features)
    if actor.maps is not None:
        code = config.deformation_net.code if config.deformation else 0
        assert isinstance(actor.maps, UnreadMap)
        assert actor.maps.weight.shape[0] == config.radiance.code + code


def test_without_deformation_nothing_moves(support_views: Views) -> None:
    """A closed window gives, bit for bit, the field of a method that has no such network."""
    views = support_views(4)
    closed = stage(TINY, views, window=0.0)
    without = ActorsNeRF(replace(TINY, deformation=False))
    state = closed.method.state_dict()
    without.load_state_dict({k: v for k, v in state.items() if not k.startswith("deformation.")})
    values = field(closed)
    with torch.no_grad():
        other = without.field(closed.actor, closed.pose, closed.located)
    assert torch.equal(values.rgb.detach(), other.rgb)
    assert torch.equal(values.density.detach(), other.density)
    assert isinstance(closed.actor.maps, UnreadMap)
    assert closed.actor.maps.weight.shape[0] == TINY.radiance.code
    assert closed.method.deformation is not None
    parts = list(closed.method.deformation.parameters())
    gradients = torch.autograd.grad(values.rgb.sum(), parts, allow_unused=True)
    assert all(gradient is None for gradient in gradients)


def test_an_open_window_moves_points(support_views: Views) -> None:
    views = support_views(4)
    moved, still = field(stage(TINY, views)), field(stage(TINY, views, window=0.0))
    assert float((moved.rgb - still.rgb).detach().abs().max()) > 1e-4


def test_freezing_stops_the_category_prior_and_nothing_else(support_views: Views) -> None:
    views = support_views(4)
    torch.manual_seed(4)
    method = ActorsNeRF(TINY)
    method.freeze_category_prior()
    method.train()
    assert method.encoder is not None and method.sparse is not None
    assert method.sparse.training and not method.encoder.training
    kept = {k: v.clone() for k, v in method.encoder.state_dict().items()}
    actor = method.actor_state(views[:3], OPEN)
    pose = method.pose_state(actor, views[3].pose, views[3].rest_joints)
    located = method.locate(actor, pose, views[3].posed_vertices, THRESHOLD)
    values = method.field(actor, pose, located)
    torch.autograd.backward(values.rgb.sum() + values.density.sum())
    for key, value in method.encoder.state_dict().items():
        assert torch.equal(value, kept[key]), key
    for key, parameter in method.named_parameters():
        frozen = key.startswith(("encoder.", "skinning."))
        assert parameter.requires_grad == (not frozen), key
        assert (parameter.grad is None) == frozen, key


def test_prior_once_and_state_each_step_is_the_whole_state(support_views: Views) -> None:
    views = support_views(4)
    scene = stage(TINY, views)
    method = scene.method.eval()
    with torch.no_grad():
        prior = method.category_prior(views[:3], method.geometry(views[3]))
        once = method.instance_state(prior, OPEN)
        whole = method.actor_state(views[:3], OPEN)
    assert isinstance(once.maps, FeatureMap) and isinstance(whole.maps, FeatureMap)
    assert torch.equal(once.maps.table, whole.maps.table)
    for a, b in zip(once.levels, whole.levels, strict=True):
        assert torch.equal(a.features, b.features)
    step = method.instance_state(prior, OPEN)
    assert isinstance(step.maps, UnreadMap) and step.maps.weight.requires_grad
    assert not step.body.skinning.weights.requires_grad


def test_where_a_gradient_is_wanted_only_nodes_that_are_read_are_computed(
    support_views: Views, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = stage(TINY, support_views(4))
    method, actor = scene.method, scene.actor
    with torch.no_grad():
        whole = method.instance_state(scene.prior, OPEN)
        expected = method.field(whole, scene.pose, scene.located)
    assert isinstance(actor.maps, UnreadMap) and isinstance(whole.maps, FeatureMap)
    layer, rows = method._reduced, []

    def counted(given: Tensor, weight: Tensor, dtype: torch.dtype) -> Tensor:
        rows.append(given.shape[0])
        return layer(given, weight, dtype)

    monkeypatch.setattr(method, "_reduced", counted)
    learned = method.field(actor, scene.pose, scene.located)
    with torch.no_grad():
        looked = method.field(actor, scene.pose, scene.located)
    assert len(rows) == 2
    assert 0 < max(rows) < whole.maps.table[..., 0].numel()
    for values in (learned, looked):
        torch.testing.assert_close(values.density, expected.density, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(values.rgb, expected.rgb, rtol=1e-4, atol=1e-5)


def test_views_of_different_sizes(support_views: Views) -> None:
    views = support_views(3)
    cut = replace(views[1], image=views[1].image[:50, :40], alpha=views[1].alpha[:50, :40])
    with torch.no_grad():
        actor = ActorsNeRF(TINY).actor_state((views[0], cut, views[2]), OPEN)
    assert isinstance(actor.maps, FeatureMap)
    assert actor.maps.table.shape[:3] == (3, 32, 24)
    assert bool(actor.maps.table.isfinite().all())


def test_stored_views_give_the_same_state(support_views: Views) -> None:
    views = support_views(3)
    method = ActorsNeRF(TINY).eval()
    stored = supports_from_tensors(support_tensors(views), torch.device("cpu"))
    with torch.no_grad():
        first, again = method.actor_state(views, OPEN), method.actor_state(stored, OPEN)
    assert isinstance(first.maps, FeatureMap) and isinstance(again.maps, FeatureMap)
    assert torch.equal(first.maps.table, again.maps.table)
    assert torch.equal(first.body.skinning.weights, again.body.skinning.weights)


def test_networks_in_half_precision_leave_geometry_alone(support_views: Views) -> None:
    views = support_views(4)
    exact = stage(TINY, views)
    rough = ActorsNeRF(TINY, torch.bfloat16)
    rough.load_state_dict(exact.method.state_dict())
    actor = rough.eval().actor_state(views[:3], OPEN)
    pose = rough.pose_state(actor, views[3].pose, views[3].rest_joints)
    located = rough.locate(actor, pose, views[3].posed_vertices, THRESHOLD)
    values = rough.field(actor, pose, located)
    assert torch.equal(actor.body.skinning.weights, exact.actor.body.skinning.weights)
    assert located.canonical.dtype == values.rgb.dtype == values.density.dtype == torch.float32
    reference = exact.method.eval().actor_state(views[:3], OPEN)
    wanted = exact.method.field(reference, pose, located)
    assert float((values.rgb - wanted.rgb).detach().abs().max()) < 0.05


def test_no_survivors(support_views: Views) -> None:
    scene = stage(TINY, support_views(4))
    far = torch.full((5, 3), 50.0)
    located = scene.method.locate(scene.actor, scene.pose, far, THRESHOLD)
    values = scene.method.field(scene.actor, scene.pose, located)
    assert values.rgb.shape == (0, 3)
    assert values.density.shape == (0,)


def test_gradient_of_the_whole_field(support_views: Views) -> None:
    """Against differences, along random directions of each kind of parameter."""
    scene = stage(TINY, support_views(4, dtype=torch.float64))
    method = scene.method.eval()
    views = support_views(4, dtype=torch.float64)[:3]
    parameters = [
        value for key, value in method.named_parameters() if key.endswith(("t.bias", "norm.bias"))
    ]
    assert len(parameters) >= 4

    def loss() -> Tensor:
        actor = method.actor_state(views, OPEN)
        located = method.locate(actor, scene.pose, views[0].rest_vertices, THRESHOLD)
        values = method.field(actor, scene.pose, located)
        return values.rgb.mean() + values.density.mean()

    slopes = torch.autograd.grad(loss(), parameters)
    step = 1e-6
    for parameter, slope in zip(parameters, slopes, strict=True):
        direction = torch.randn_like(parameter)
        with torch.no_grad():
            parameter.add_(step * direction)
            above = loss()
            parameter.sub_(2 * step * direction)
            below = loss()
            parameter.add_(step * direction)
        expected = (above - below) / (2 * step)
        torch.testing.assert_close((slope * direction).sum(), expected, atol=1e-6, rtol=1e-3)


def test_wrong_number_of_views(support_views: Views) -> None:
    with pytest.raises(UserError, match="4 support views were given, the model was built for 3"):
        ActorsNeRF(TINY).actor_state(support_views(4), OPEN)
