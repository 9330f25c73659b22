import dataclasses
from typing import TYPE_CHECKING

import torch

from actorsnerf_model.rays import Rays, intersect_box, rays_through, sample_depths
from actorsnerf_model.reference import reference_render_pixels
from actorsnerf_model.skinning import backward_warp
from actorsnerf_model.states import RenderOptions

if TYPE_CHECKING:
    from tests.model.conftest import ToyScene

OPTIONS = RenderOptions(samples=12, background=(0.25, 0.5, 1.0))


def middle_rays(scene: "ToyScene") -> Rays:
    pixels = torch.tensor([[15.0, 12.0], [16.0, 20.0], [0.0, 0.0], [18.0, 27.0]])
    return rays_through(pixels.to(scene.camera.K.dtype), scene.camera)


def test_one_ray_by_hand(scene64: "ToyScene") -> None:
    rays = middle_rays(scene64)
    found = reference_render_pixels(scene64.method, scene64.actor, scene64.pose, rays, OPTIONS)
    ray = 1
    span = intersect_box(rays, scene64.pose.bounds)
    depths = sample_depths(span.near, span.far, 12, None)[ray]
    light, colour = torch.ones((), dtype=torch.float64), torch.zeros(3, dtype=torch.float64)
    step = (depths[1] - depths[0]) * rays.directions[ray].norm()
    for depth in depths:
        point = rays.origin + depth * rays.directions[ray]
        canonical, likelihood = backward_warp(
            point[None], scene64.actor.volume, scene64.pose.canonical_from_body
        )
        if likelihood < 0.01:
            continue
        wave = torch.sin(7 * canonical[0] @ scene64.method.colours)
        density = scene64.method.density * (0.5 + wave.sum()).clamp(min=0)
        opacity = 1 - torch.exp(-density * step)
        colour = colour + light * opacity * torch.sigmoid(3 * wave)
        light = light * (1 - opacity)
    colour = colour + light * torch.tensor([0.25, 0.5, 1.0], dtype=torch.float64)
    assert light < 0.9
    torch.testing.assert_close(found.rgb[ray], colour, rtol=1e-10, atol=1e-12)


def test_every_sample_goes_through_the_field(scene: "ToyScene") -> None:
    before = scene.method.asked
    found = reference_render_pixels(
        scene.method, scene.actor, scene.pose, middle_rays(scene), OPTIONS
    )
    assert scene.method.asked - before == 4 * 12 == found.counts.survivors


def test_a_missed_box_is_background(scene: "ToyScene") -> None:
    found = reference_render_pixels(
        scene.method, scene.actor, scene.pose, middle_rays(scene), OPTIONS
    )
    assert found.rgb[2].tolist() == [0.25, 0.5, 1.0]
    assert found.alpha[2] == 0 and found.depth[2] == 0
    assert found.counts.rays == 3


def test_the_chunk_changes_nothing(scene: "ToyScene") -> None:
    rays = middle_rays(scene)
    args = (scene.method, scene.actor, scene.pose, rays)
    whole = reference_render_pixels(*args, OPTIONS)
    pieces = reference_render_pixels(*args, dataclasses.replace(OPTIONS, chunk=5))
    torch.testing.assert_close(whole.rgb, pieces.rgb, rtol=0, atol=1e-6)
