import dataclasses

import pytest
import torch

from actorsnerf_model.rays import Rays, rays_through
from actorsnerf_model.reference import reference_render_pixels
from actorsnerf_model.render import render, render_pixels
from actorsnerf_model.states import RenderOptions

OPTIONS = RenderOptions(samples=48, background=(0.2, 0.5, 0.9))


def all_rays(scene) -> Rays:
    width, height = scene.camera.size
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    pixels = torch.stack([x, y], -1).reshape(-1, 2).to(scene.camera.K.dtype)
    return rays_through(pixels, scene.camera)


def reference(scene, rays, options=OPTIONS, generator=None):
    with torch.no_grad():
        return reference_render_pixels(
            scene.method, scene.actor, scene.pose, rays, options, generator
        )


def fast(scene, rays, options=OPTIONS, generator=None):
    with torch.no_grad():
        return render_pixels(scene.method, scene.actor, scene.pose, rays, options, generator)


def assert_same(found, expected, tolerance=1e-5):
    assert (found.rgb - expected.rgb).abs().max() <= tolerance
    assert (found.alpha - expected.alpha).abs().max() <= tolerance
    assert (found.depth - expected.depth).abs().max() <= 10 * tolerance


@pytest.mark.parametrize("occupancy", [True, False])
@pytest.mark.parametrize("chunk", [100_000, 37])
@pytest.mark.parametrize("soft_mask", [True, False])
def test_equals_the_reference(scene, occupancy, chunk, soft_mask):
    options = dataclasses.replace(OPTIONS, soft_mask=soft_mask)
    expected = reference(scene, all_rays(scene), dataclasses.replace(options, chunk=16384))
    assert 0.05 < expected.alpha.mean() < 0.9  # a picture worth comparing
    found = fast(
        scene, all_rays(scene), dataclasses.replace(options, occupancy=occupancy, chunk=chunk)
    )
    assert_same(found, expected)
    assert found.counts.survivors < expected.counts.survivors / 5
