import dataclasses
from typing import TYPE_CHECKING

import pytest
import torch

from actorsnerf_model.rays import Rays, rays_through
from actorsnerf_model.reference import reference_render_pixels
from actorsnerf_model.render import render, render_pixels
from actorsnerf_model.states import DensityFirst, Located, PoseState, Rendering, RenderOptions

if TYPE_CHECKING:
    from tests.model.conftest import ToyActor, ToyScene

OPTIONS = RenderOptions(samples=48, background=(0.2, 0.5, 0.9))


def all_rays(scene: "ToyScene") -> Rays:
    width, height = scene.camera.size
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    pixels = torch.stack([x, y], -1).reshape(-1, 2).to(scene.camera.K.dtype)
    return rays_through(pixels, scene.camera)


def reference(
    scene: "ToyScene",
    rays: Rays,
    options: RenderOptions = OPTIONS,
    generator: torch.Generator | None = None,
) -> Rendering:
    with torch.no_grad():
        return reference_render_pixels(
            scene.method, scene.actor, scene.pose, rays, options, generator
        )


def fast(
    scene: "ToyScene",
    rays: Rays,
    options: RenderOptions = OPTIONS,
    generator: torch.Generator | None = None,
) -> Rendering:
    with torch.no_grad():
        return render_pixels(scene.method, scene.actor, scene.pose, rays, options, generator)


def assert_same(found: Rendering, expected: Rendering, tolerance: float = 1e-5) -> None:
    assert (found.rgb - expected.rgb).abs().max() <= tolerance
    assert (found.alpha - expected.alpha).abs().max() <= tolerance
    assert (found.depth - expected.depth).abs().max() <= 10 * tolerance


@pytest.mark.parametrize("occupancy", [True, False])
@pytest.mark.parametrize("chunk", [100_000, 37])
@pytest.mark.parametrize("soft_mask", [True, False])
def test_equals_the_reference(
    scene: "ToyScene", occupancy: bool, chunk: int, soft_mask: bool
) -> None:
    options = dataclasses.replace(OPTIONS, soft_mask=soft_mask)
    expected = reference(scene, all_rays(scene), dataclasses.replace(options, chunk=16384))
    assert 0.05 < expected.alpha.mean() < 0.9  # a picture worth comparing
    found = fast(
        scene, all_rays(scene), dataclasses.replace(options, occupancy=occupancy, chunk=chunk)
    )
    assert_same(found, expected)
    assert found.counts.survivors < expected.counts.survivors / 5


@pytest.mark.parametrize("samples", [1, 2, 33])
@pytest.mark.parametrize("threshold", [0.001, 0.01, 0.3])
def test_any_number_of_samples_and_threshold(
    scene: "ToyScene", samples: int, threshold: float
) -> None:
    options = dataclasses.replace(OPTIONS, samples=samples, threshold=threshold)
    assert_same(fast(scene, all_rays(scene), options), reference(scene, all_rays(scene), options))


def test_jitter_falls_on_the_same_samples(scene: "ToyScene") -> None:
    rays = all_rays(scene)
    expected = reference(scene, rays, generator=torch.Generator().manual_seed(3))
    found = fast(scene, rays, generator=torch.Generator().manual_seed(3))
    assert_same(found, expected)
    other = fast(scene, rays, generator=torch.Generator().manual_seed(4))
    assert (other.rgb - found.rgb).abs().max() > 1e-3


def test_only_survivors_reach_the_field(scene: "ToyScene") -> None:
    before = scene.method.asked
    found = fast(scene, all_rays(scene))
    assert scene.method.asked - before == found.counts.survivors
    assert found.counts.survivors < 0.2 * found.counts.samples
    assert found.counts.samples == found.counts.rays * OPTIONS.samples


def test_the_picture_is_its_pixels(scene: "ToyScene") -> None:
    with torch.no_grad():
        picture = render(scene.method, scene.actor, scene.pose, scene.camera, OPTIONS)
    width, height = scene.camera.size
    pixels = fast(scene, all_rays(scene))
    assert picture.rgb.shape == (height, width, 3)
    assert (picture.rgb.reshape(-1, 3) - pixels.rgb).abs().max() < 1e-6
    assert (picture.alpha.reshape(-1) - pixels.alpha).abs().max() < 1e-6
    assert (picture.depth.reshape(-1) - pixels.depth).abs().max() < 1e-5
    assert picture.counts.rays < pixels.counts.rays
    assert picture.counts.survivors == pixels.counts.survivors


def test_the_picture_without_cells(scene: "ToyScene") -> None:
    bare = dataclasses.replace(scene.pose, occupancy=None)
    with torch.no_grad():
        expected = render(scene.method, scene.actor, scene.pose, scene.camera, OPTIONS)
        found = render(scene.method, scene.actor, bare, scene.camera, OPTIONS)
    assert (found.rgb - expected.rgb).abs().max() < 1e-6


def test_the_cost_does_not_grow_with_the_picture(scene: "ToyScene") -> None:
    """The same person in a picture four times as large, same focal length."""
    K = scene.camera.K.clone()
    K[0, 2], K[1, 2] = 31.5, 39.5
    large = dataclasses.replace(scene.camera, K=K, size=(64, 80))
    with torch.no_grad():
        few = render(scene.method, scene.actor, scene.pose, scene.camera, OPTIONS)
        many = render(scene.method, scene.actor, scene.pose, large, OPTIONS)
    assert many.counts.rays <= 1.2 * few.counts.rays
    assert many.counts.survivors == pytest.approx(few.counts.survivors, rel=0.1)


@pytest.mark.parametrize("soft_mask", [True, False])
@pytest.mark.parametrize("light", [0.5, 0.05, 1e-3])
def test_stopping_early_costs_at_most_the_light_left(
    scene: "ToyScene", light: float, soft_mask: bool
) -> None:
    options = dataclasses.replace(OPTIONS, samples=200, soft_mask=soft_mask)
    scene.method.density.data.mul_(10)
    exact = fast(scene, all_rays(scene), options)
    stopped = fast(scene, all_rays(scene), dataclasses.replace(options, stop_transmittance=light))
    assert (stopped.rgb - exact.rgb).abs().max() <= light + 1e-5
    assert (stopped.alpha - exact.alpha).abs().max() <= light + 1e-5
    assert stopped.counts.survivors < exact.counts.survivors


@pytest.mark.parametrize("soft_mask", [True, False])
@pytest.mark.parametrize("least", [1e-5, 1e-3, 0.02])
def test_colours_of_what_hardly_shows_are_not_asked_for(
    scene: "ToyScene", least: float, soft_mask: bool
) -> None:
    options = dataclasses.replace(OPTIONS, samples=100, soft_mask=soft_mask)
    scene.method.density.data.mul_(10)
    exact = fast(scene, all_rays(scene), options)
    before = scene.method.painted
    spare = dataclasses.replace(options, least_weight=least)
    spared = fast(scene, all_rays(scene), spare)
    assert scene.method.painted - before == spared.counts.painted
    assert spared.counts.painted < 0.6 * spared.counts.survivors
    assert exact.counts.painted > spared.counts.painted
    assert (exact.rgb - spared.rgb).min() >= -1e-6  # only light can be missing
    assert (exact.rgb - spared.rgb).max() <= 100 * least + 1e-6
    torch.testing.assert_close(spared.alpha, exact.alpha, atol=1e-6, rtol=0)


@pytest.mark.parametrize("least", [1e-4, 1e-3, 1e-2])
def test_a_colour_is_asked_for_from_the_stated_share_on(scene: "ToyScene", least: float) -> None:
    """With one sample a ray, its share of the pixel is the ray's opacity."""
    options = dataclasses.replace(OPTIONS, samples=1, least_weight=least)
    scene.method.density.data.mul_(1e-3)
    seen = fast(scene, all_rays(scene), options)
    assert 0 < seen.counts.painted == int((seen.alpha > least).sum()) < seen.counts.survivors


def test_no_colour_is_asked_for_where_nothing_is(scene: "ToyScene") -> None:
    """Even exactly: the field has no density in half of its waves, and none behind a wall."""
    before = scene.method.painted
    fast(scene, all_rays(scene))
    some = scene.method.painted - before
    scene.method.density.data.mul_(1e6)
    before = scene.method.painted
    fast(scene, all_rays(scene))
    assert 0 < scene.method.painted - before < 0.5 * some


def test_rays_that_miss_and_no_rays_at_all(scene: "ToyScene") -> None:
    away = Rays(torch.tensor([0.0, 0.0, 9.0]), torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    none = Rays(torch.tensor([0.0, 0.0, 9.0]), torch.zeros(0, 3))
    for stop in (0.0, 0.1):
        options = dataclasses.replace(OPTIONS, stop_transmittance=stop)
        found = fast(scene, away, options)
        assert found.rgb.tolist() == [pytest.approx(OPTIONS.background)] * 2
        assert found.alpha.tolist() == [0, 0] and found.counts.survivors == 0
        assert fast(scene, none, options).rgb.shape == (0, 3)


def test_rays_inside_the_bounds_without_survivors(scene: "ToyScene") -> None:
    for stop in (0.0, 0.1):
        options = dataclasses.replace(OPTIONS, threshold=30.0, stop_transmittance=stop)
        found = fast(scene, all_rays(scene), options)
        assert found.counts.rays > 0 and found.counts.survivors == 0
        assert found.alpha.abs().max() == 0


def test_a_person_behind_the_camera(scene: "ToyScene") -> None:
    behind = scene.camera.camera_from_body.clone()
    behind[:3, 3] = torch.tensor([0.0, 0.0, -5.0])
    camera = dataclasses.replace(scene.camera, camera_from_body=behind)
    with torch.no_grad():
        found = render(scene.method, scene.actor, scene.pose, camera, OPTIONS)
    assert found.alpha.abs().max() == 0 and found.counts.rays == 0


def test_a_camera_inside_the_person(scene: "ToyScene") -> None:
    inside = scene.camera.camera_from_body.clone()
    inside[:3, 3] = torch.tensor([0.0, -0.1, 0.0])
    camera = dataclasses.replace(scene.camera, camera_from_body=inside)
    rays = all_rays(dataclasses.replace(scene, camera=camera))
    expected = reference(scene, rays)
    assert_same(fast(scene, rays), expected)
    with torch.no_grad():
        picture = render(scene.method, scene.actor, scene.pose, camera, OPTIONS)
    assert (picture.rgb.reshape(-1, 3) - expected.rgb).abs().max() < 1e-5


@pytest.mark.parametrize("density", [0.0, 1e6])
def test_no_density_and_far_too_much(scene: "ToyScene", density: float) -> None:
    scene.method.density.data.fill_(density)
    expected = reference(scene, all_rays(scene))
    assert torch.isfinite(expected.rgb).all()
    assert_same(fast(scene, all_rays(scene)), expected)


@pytest.mark.parametrize("soft_mask", [True, False])
@pytest.mark.parametrize(("stop", "least"), [(0.0, 0.0), (1e-9, 0.0), (0.0, 1e-10)])
def test_training_gradients_are_the_references(
    scene64: "ToyScene", soft_mask: bool, stop: float, least: float
) -> None:
    """Culling is hidden from the gradient: same numbers for every parameter, float64."""
    width, height = scene64.camera.size
    x, y = torch.meshgrid(torch.arange(4, width, 5), torch.arange(2, height, 5), indexing="xy")
    pixels = torch.stack([x, y], -1).reshape(-1, 2).double()
    options = dataclasses.replace(OPTIONS, samples=24, soft_mask=soft_mask)
    options = dataclasses.replace(options, stop_transmittance=stop, least_learned=least)
    gradients = []
    for renderer in (render_pixels, reference_render_pixels):
        actor = scene64.method.actor_state((), 0.0)
        rays = rays_through(pixels, scene64.camera)
        generator = torch.Generator().manual_seed(5)
        seen = renderer(scene64.method, actor, scene64.pose, rays, options, generator)
        loss = (seen.rgb**2).sum() + seen.alpha.sum() + 0.1 * seen.depth.sum()
        gradients.append(torch.autograd.grad(loss, list(scene64.method.parameters())))
    for found, expected in zip(*gradients, strict=True):
        assert expected.norm() > 0
        assert (found - expected).norm() <= 1e-5 * expected.norm()


@pytest.mark.parametrize("soft_mask", [True, False])
def test_what_hardly_shows_is_not_learned_from(scene: "ToyScene", soft_mask: bool) -> None:
    least = 1e-3
    options = dataclasses.replace(OPTIONS, soft_mask=soft_mask)
    some = dataclasses.replace(options, least_learned=least)
    arguments = (scene.method, scene.method.actor_state((), 0.0), scene.pose, all_rays(scene))
    whole, part = render_pixels(*arguments, options), render_pixels(*arguments, some)
    assert 0 < part.counts.survivors < 0.7 * whole.counts.survivors
    for found, expected in ((part.rgb, whole.rgb), (part.alpha, whole.alpha)):
        away = (found - expected).abs().max()
        assert 1e-6 < away <= options.samples * least
    assert part.rgb.requires_grad
    # without gradients there is nothing to learn, and the picture is whole
    with torch.no_grad():
        assert_same(render_pixels(*arguments, some), whole)


@pytest.mark.parametrize("least", [0.0, 1e-7])
def test_what_is_no_number_reaches_the_loss(
    scene: "ToyScene", least: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    field = scene.method.field

    def spoiled(actor: "ToyActor", pose: PoseState, located: Located) -> DensityFirst:
        found = field(actor, pose, located)
        near = (located.canonical - place).norm(dim=-1) < 0.04
        return dataclasses.replace(found, density=found.density.masked_fill(near, torch.nan))

    options = dataclasses.replace(OPTIONS, least_learned=least)
    actor = scene.method.actor_state((), 0.0)
    place = scene.method.canonical_joints[20]  # a wrist: nothing opaque before it
    monkeypatch.setattr(scene.method, "field", spoiled)
    seen = render_pixels(scene.method, actor, scene.pose, all_rays(scene), options)
    assert seen.rgb.isnan().any()
    assert seen.rgb.isfinite().any()


def test_nothing_to_learn_from_has_a_gradient_of_nothing(scene: "ToyScene") -> None:
    options = dataclasses.replace(OPTIONS, least_learned=1.1)
    actor = scene.method.actor_state((), 0.0)
    seen = render_pixels(scene.method, actor, scene.pose, all_rays(scene), options)
    assert seen.counts.survivors == 0
    assert not seen.alpha.any()


def test_what_is_not_kept_for_the_gradient_is_computed_twice(scene64: "ToyScene") -> None:
    gradients, asked = [], []
    for kept in (0, 150, 100_000):
        options = dataclasses.replace(OPTIONS, samples=24, chunk=100, kept=kept)
        actor = scene64.method.actor_state((), 0.0)
        before = scene64.method.asked
        seen = render_pixels(scene64.method, actor, scene64.pose, all_rays(scene64), options, None)
        loss = (seen.rgb**2).sum() + seen.alpha.sum()
        gradients.append(torch.autograd.grad(loss, list(scene64.method.parameters())))
        asked.append((scene64.method.asked - before) / seen.counts.survivors)
    assert asked[0] == 2
    assert 1 < asked[1] < 2
    assert asked[2] == 1
    for some in gradients[:2]:
        for found, expected in zip(some, gradients[2], strict=True):
            assert (found - expected).norm() <= 1e-12 * expected.norm()


def test_half_precision_networks_do_not_spoil_the_geometry(scene: "ToyScene") -> None:
    exact = fast(scene, all_rays(scene))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rays = all_rays(scene)
        found = fast(scene, rays)
    # The toy's field has one matrix product, which does run in half precision.
    assert dataclasses.replace(found.counts, painted=exact.counts.painted) == exact.counts
    assert found.rgb.dtype == torch.float32
    assert (found.rgb - exact.rgb).abs().mean() < 0.01


@pytest.mark.parametrize("stride", [2, 4])
def test_pixels_by_need_draw_fewer_rays_for_a_stated_error(scene: "ToyScene", stride: int) -> None:
    camera = dataclasses.replace(scene.camera, K=scene.camera.K * 4, size=(128, 160))
    camera.K[2, 2] = 1
    scene = dataclasses.replace(scene, camera=camera)
    options = dataclasses.replace(OPTIONS, samples=32)
    loose = dataclasses.replace(options, pixel_tolerance=0.1, pixel_stride=stride)
    with torch.no_grad():
        full = render(scene.method, scene.actor, scene.pose, scene.camera, options)
        found = render(scene.method, scene.actor, scene.pose, scene.camera, loose)
    assert found.counts.rays < 0.9 * full.counts.rays
    assert found.counts.survivors < 0.85 * full.counts.survivors
    assert (found.rgb - full.rgb).square().mean() < 1e-4  # 40 dB
    assert (found.alpha - full.alpha).abs().mean() < 0.01


def test_no_tolerance_draws_every_pixel(scene: "ToyScene") -> None:
    strict = dataclasses.replace(OPTIONS, pixel_tolerance=1e-9)
    with torch.no_grad():
        full = render(scene.method, scene.actor, scene.pose, scene.camera, OPTIONS)
        found = render(scene.method, scene.actor, scene.pose, scene.camera, strict)
    assert_same(found, full)
