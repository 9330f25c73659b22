from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.neuralbody import (
    NeuralBody,
    NeuralBodyConfig,
    NeuralBodyPose,
    NeuralBodyState,
)
from actorsnerf_model.presets import NEURALBODY_TINY
from actorsnerf_model.rays import Rays, rays_through
from actorsnerf_model.reference import reference_render_pixels
from actorsnerf_model.render import render_pixels
from actorsnerf_model.sparse_conv import query
from actorsnerf_model.states import (
    Camera,
    DensityFirst,
    Located,
    Method,
    PoseState,
    Rendering,
    RenderOptions,
)

Views = Callable[..., tuple[View, ...]]
OPTIONS = RenderOptions(samples=24)
CONFIG = replace(
    NEURALBODY_TINY,
    vertices=150,
    frames=(4, 7, 9),
    field=replace(NEURALBODY_TINY.field, density_shift=-1.0),
)


def awake(config: NeuralBodyConfig = CONFIG, dtype: torch.dtype = torch.float32) -> NeuralBody:
    """Random weights with which every part does something."""
    torch.manual_seed(5)
    method = NeuralBody(config).to(dtype)
    nn.init.normal_(method.codes.frames)
    for layer in (method.radiance.density_out, method.radiance.colour_out):
        nn.init.normal_(layer.weight, std=0.5)
    return method


def is_method(method: NeuralBody) -> Method[NeuralBodyState]:
    """For the type checker: the contract is kept."""
    return method


def camera_of(view: View) -> Camera:
    return Camera(view.K, view.camera_from_body, (view.image.shape[1], view.image.shape[0]))


def some_rays(view: View) -> Rays:
    height, width = view.image.shape[:2]
    x, y = torch.meshgrid(torch.arange(1, width, 5), torch.arange(1, height, 5), indexing="xy")
    pixels = torch.stack([x, y], -1).reshape(-1, 2).to(view.K.dtype)
    return rays_through(pixels, camera_of(view))


def posed(
    method: NeuralBody, views: tuple[View, ...], frame: int | None = None
) -> tuple[NeuralBodyState, NeuralBodyPose]:
    actor = method.actor_state(views[:3], 0.0)
    return actor, method.pose_state(actor, views[3].pose, views[3].rest_joints, frame)


def drawn(
    method: NeuralBody, views: tuple[View, ...], frame: int | None = None, chunk: int = 16384
) -> Rendering:
    actor, pose = posed(method, views, frame)
    options = replace(OPTIONS, chunk=chunk, kept=chunk)
    return render_pixels(method, actor, pose, some_rays(views[3]), options)


def test_the_renderer_gives_the_references_picture(support_views: Views) -> None:
    views = support_views(4, dtype=torch.float64)
    method = awake(dtype=torch.float64).eval()
    with torch.no_grad():
        actor, pose = posed(method, views, 7)
        rays = some_rays(views[3])
        found = render_pixels(method, actor, pose, rays, OPTIONS)
        expected = reference_render_pixels(method, actor, pose, rays, OPTIONS)
    assert expected.alpha.max() > 0.3
    assert expected.alpha.min() < 0.01
    assert (found.rgb - expected.rgb).abs().max() < 1e-9
    assert (found.alpha - expected.alpha).abs().max() < 1e-9
    assert found.counts.survivors < 0.6 * expected.counts.survivors


def test_every_parameter_learns(support_views: Views) -> None:
    views = support_views(4, dtype=torch.float64)
    method = awake(dtype=torch.float64)
    seen = drawn(method, views, 7)
    torch.autograd.backward(seen.rgb.square().sum() + seen.alpha.sum())
    for name, parameter in method.named_parameters():
        assert parameter.grad is not None, name
        assert bool(parameter.grad.isfinite().all()), name
        assert bool((parameter.grad != 0).any()), name


@pytest.mark.parametrize(
    "name", ["codes.vertices", "codes.frames", "sparse.stages.1.0.weight", "radiance.framed.weight"]
)
def test_gradients_are_differences(
    name: str, support_views: Views, generator: torch.Generator
) -> None:
    """Through voxels, convolutions, networks and renderer, in pieces that are computed again."""
    views = support_views(4, dtype=torch.float64)
    method = awake(dtype=torch.float64).eval()
    parameter = dict(method.named_parameters())[name]
    step = torch.randn(
        parameter.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1)
    )

    def loss() -> Tensor:
        seen = drawn(method, views, 7, chunk=100)
        return seen.rgb.square().sum() + seen.alpha.sum()

    (gradient,) = torch.autograd.grad(loss(), parameter)
    values = []
    with torch.no_grad():
        for sign in (1, -2):
            parameter.add_(sign * 1e-6 * step)
            values.append(float(loss()))
    slope = (values[0] - values[1]) / 2e-6
    assert float((gradient * step).sum()) == pytest.approx(slope, rel=1e-4)


def test_the_picture_depends_on_side_and_frame(support_views: Views) -> None:
    views = support_views(4)
    method = awake().eval()
    with torch.no_grad():
        actor, pose = posed(method, views, 4)
        located = method.locate(actor, pose, views[3].posed_vertices, 0.5)
        ahead = torch.tensor([0.0, 0.0, 1.0]).expand(len(located.index), 3)
        sides = [
            method.field(actor, pose, replace(located, directions=side))
            for side in (ahead, -ahead, None)
        ]
        frames = [
            method.field(actor, method.pose_state(actor, view.pose, view.rest_joints, f), located)
            for view, f in ((views[3], 7), (views[3], 9))
        ]
    assert method.reads_directions
    for one, other in ((sides[0], sides[1]), (sides[0], sides[2]), (frames[0], frames[1])):
        assert torch.equal(one.density, other.density)
        assert (one.rgb - other.rgb).abs().max() > 1e-3


def test_colours_of_some_points_are_their_own(support_views: Views) -> None:
    views = support_views(4)
    method = awake().eval()
    with torch.no_grad():
        actor, pose = posed(method, views, 4)
        located = method.locate(actor, pose, views[3].posed_vertices, 0.5)
        sides = nn.functional.normalize(located.canonical - torch.tensor([0.3, 0.2, 2.0]))
        some = torch.tensor([7, 2, 40])
        for directions in (sides, None):
            values = method.field(actor, pose, replace(located, directions=directions))
            torch.testing.assert_close(values.colours(some), values.rgb[some])


def test_rays_bring_the_directions(support_views: Views, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both renderers tell from where each point is seen, chunk by chunk and when asked again."""
    views = support_views(4)
    method = awake()
    rays = some_rays(views[3])
    field, asked = method.field, []

    def spied(actor: NeuralBodyState, pose: PoseState, located: Located) -> DensityFirst:
        asked.append(located)
        return field(actor, pose, located)

    monkeypatch.setattr(method, "field", spied)
    for draw in (render_pixels, reference_render_pixels):
        asked.clear()
        actor, pose = posed(method, views)
        seen = draw(method, actor, pose, rays, replace(OPTIONS, chunk=100, kept=0))
        torch.autograd.backward(seen.rgb.sum())
        assert len(asked) > 1
        for located in asked:
            towards = nn.functional.normalize(located.canonical - rays.origin)
            assert located.directions is not None
            torch.testing.assert_close(located.directions, towards, rtol=0, atol=1e-5)


def test_a_frame_is_a_deviation_from_the_mean_frame(support_views: Views) -> None:
    method = awake()
    latents = torch.stack([method.latent(frame) for frame in CONFIG.frames])
    torch.testing.assert_close(latents.mean(0), torch.zeros(8), rtol=0, atol=1e-6)
    torch.testing.assert_close(
        latents[1] - latents[0], method.codes.frames[1] - method.codes.frames[0]
    )
    for unknown in (None, 0, 5, -1, 10**9):
        assert torch.equal(method.latent(unknown), torch.zeros(8))
    nameless = NeuralBody(replace(CONFIG, frames=()))
    assert torch.equal(nameless.latent(4), torch.zeros(8))
    fresh = NeuralBody(CONFIG)
    assert torch.equal(fresh.latent(7), torch.zeros(8))


def test_a_picture_of_no_frame_is_the_mean_frames(support_views: Views) -> None:
    views = support_views(4)
    method = awake().eval()
    with torch.no_grad():
        pictures = [drawn(method, views, frame).rgb for frame in (None, 4, 9, 1000)]
        method.codes.frames.copy_(method.codes.frames.mean(0))
        mean = drawn(method, views, 4).rgb
    assert torch.equal(pictures[0], pictures[3])
    torch.testing.assert_close(pictures[0], mean, rtol=0, atol=1e-5)
    assert (pictures[1] - pictures[2]).abs().max() > 1e-3


def test_codes_go_where_the_pose_puts_the_vertices(support_views: Views) -> None:
    """Also in poses and bodies that no support shows."""
    views = support_views(5)
    method = awake().eval()
    with torch.no_grad():
        actor = method.actor_state(views[:3], 0.0)
        for view in views[3:]:
            pose = method.pose_state(actor, view.pose, view.rest_joints)
            level = pose.levels[0]
            voxels = ((view.posed_vertices - level.origin) / level.cell).round().long()
            x, y, z = voxels.unbind(1)
            found = (level.index[z, y, x] >= 0).float().mean()
            # Recovered weights put a vertex beside its voxel's face on the other side of it.
            assert found > 0.95
            assert bool(method.locate(actor, pose, view.posed_vertices, 0.5).likelihood.all())


def test_the_cull_leaves_out_only_what_no_feature_reaches(
    support_views: Views, generator: torch.Generator
) -> None:
    views = support_views(4)
    method = awake().eval()
    with torch.no_grad():
        actor, pose = posed(method, views)
        low, high = pose.bounds
        points = low + torch.rand(20_000, 3, generator=generator) * (high - low)
        located = method.locate(actor, pose, points, 0.01)
        everything = method.locate(actor, pose, points, 0.0)
        outside = torch.ones(len(points), dtype=torch.bool).index_fill_(0, located.index, False)
        features = query(pose.levels, points[outside])
    assert 0.02 < len(located.index) / len(points) < 0.6
    assert torch.equal(located.likelihood, torch.ones(len(located.index)))
    assert torch.equal(located.canonical, points[located.index])
    assert len(everything.index) == len(points)
    assert torch.equal(everything.likelihood == 0, outside)
    assert not bool(features.any())
    occupancy = pose.occupancy
    assert occupancy is not None
    size = torch.tensor(occupancy.cells.shape)
    place = (located.canonical - occupancy.box[0]) / (occupancy.box[1] - occupancy.box[0]) * size
    x, y, z = place.long().unbind(1)
    assert bool(occupancy.cells[x, y, z].all())
    assert occupancy.cells.float().mean() < 0.7


def test_poses_are_planned_once(support_views: Views) -> None:
    views = support_views(4)
    method = awake()
    actor, pose = posed(method, views, 4)
    again = method.pose_state(actor, views[3].pose, views[3].rest_joints, 9)
    assert len(actor.plans.plans) == 1
    assert torch.equal(again.levels[0].index, pose.levels[0].index)
    method.pose_state(actor, views[0].pose, views[0].rest_joints)
    assert len(actor.plans.plans) == 2


def test_reads_no_picture(support_views: Views) -> None:
    views = support_views(4)
    dark = tuple(replace(view, image=torch.zeros_like(view.image)) for view in views[:3])
    method = awake().eval()
    with torch.no_grad():
        assert torch.equal(drawn(method, views).rgb, drawn(method, (*dark, views[3])).rgb)


def test_another_body_is_refused(support_views: Views) -> None:
    views = support_views(3, vertices=60)
    with pytest.raises(UserError, match="has 60 vertices, but the model has codes for 150"):
        awake().actor_state(views, 0.0)


def test_nothing_freezes_and_no_skinning_learns(support_views: Views) -> None:
    views = support_views(3)
    method = awake()
    method.freeze_category_prior()
    assert all(parameter.requires_grad for parameter in method.parameters())
    prior = method.category_prior(views)
    assert method.prior_frozen
    assert method.skinning_residual(prior) == 0
    assert method.instance_state(prior, 3.0) is prior


def test_directions_without_length_do_no_harm(support_views: Views) -> None:
    views = support_views(4)
    method = awake()
    actor, pose = posed(method, views, 4)
    located = method.locate(actor, pose, views[3].posed_vertices, 0.5)
    nowhere = torch.zeros(len(located.index), 3, requires_grad=True)
    values = method.field(actor, pose, replace(located, directions=nowhere))
    torch.autograd.backward(values.rgb.sum() + values.density.sum())
    assert bool(values.rgb.isfinite().all())
    assert nowhere.grad is not None
    assert bool(nowhere.grad.isfinite().all())


def test_half_precision_stays_in_the_networks(support_views: Views) -> None:
    views = support_views(4)
    exact = awake().eval()
    half = NeuralBody(CONFIG, torch.bfloat16).eval()
    half.load_state_dict(exact.state_dict())
    pictures = []
    for method in (exact, half):
        with torch.no_grad():
            pictures.append(drawn(method, views, 4))
    assert pictures[1].rgb.dtype == torch.float32
    assert pictures[0].counts == pictures[1].counts
    assert 0 < (pictures[0].rgb - pictures[1].rgb).abs().max() < 0.1


def test_it_learns_a_picture(support_views: Views) -> None:
    views = support_views(4)
    method = awake().train()
    optimiser = torch.optim.Adam(method.parameters(), lr=5e-3)
    truth = torch.where(drawn(method, views).alpha[:, None] > 0.5, 0.9, 0.1).detach()
    losses = []
    for _ in range(20):
        loss = (drawn(method, views, 4).rgb - truth).square().mean()
        optimiser.zero_grad()
        torch.autograd.backward(loss)
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.5 * losses[0]
