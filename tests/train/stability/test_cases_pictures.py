from dataclasses import replace

import pytest
import torch

from actorsnerf_model.rays import intersect_box
from actorsnerf_model.render import render_pixels
from actorsnerf_model.states import Rendering
from actorsnerf_train.stability import cases_pictures
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import judged
from actorsnerf_train.stability.cases_pictures import picture_cases, scene, sure_rays
from actorsnerf_train.stability.hard_poses import named_poses

FEW = (
    "hands clasped",
    "fastest frame 1",
    "camera inside the box",
    "cut by the border",
    "one-pixel person",
    "one-pixel picture",
    "box behind the camera",
    "person beside the picture",
    "density 0 everywhere",
    "density 1e+06 everywhere",
)


def test_hard_pictures_are_within_their_bounds(bench: Bench) -> None:
    cases = [case for case in picture_cases(bench.subjects[0]) if case.name in FEW]
    assert len(cases) == len(FEW)
    rows = {case.name: judged(case, bench.subjects) for case in cases}
    assert [name for name, row in rows.items() if not row.passed] == []
    assert rows["hands clasped"].results[1].gradient_error is not None
    assert "mean alpha 0," not in rows["one-pixel person"].note


def test_a_renderer_that_drops_light_is_found_out(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def careless(*arguments: object) -> Rendering:
        seen: Rendering = render_pixels(*arguments)  # type: ignore[arg-type]  # passed on as they came
        return replace(seen, rgb=0.99 * seen.rgb, alpha=0.99 * seen.alpha)

    monkeypatch.setattr(cases_pictures, "render_pixels", careless)
    cases = {case.name: case for case in picture_cases(bench.subjects[0])}
    assert not judged(cases["hands clasped"], bench.subjects[:2]).passed


def test_rays_at_the_threshold_are_not_compared(bench: Bench) -> None:
    """A threshold that some sample has exactly makes its ray unsure, and hardly another."""
    subject = bench.subjects[0]
    state, _ = scene(subject, named_poses()["T-pose"])
    rays = cases_pictures._grid(cases_pictures._before(subject, state, 0.0))
    assert bool(sure_rays(subject, state, rays).any())
    span = intersect_box(rays, state.bounds)
    ray = int(span.hit.nonzero()[len(span.hit.nonzero()) // 2])
    depth = torch.linspace(float(span.near[ray]), float(span.far[ray]), subject.options.samples)
    points = rays.origin + depth.to(rays.origin)[:, None] * rays.directions[ray]
    likely = subject.method.locate(subject.state, state, points, 0.0).likelihood
    options = replace(subject.options, threshold=float(likely.max()))
    sure = sure_rays(replace(subject, options=options), state, rays)
    assert not bool(sure[ray])
    assert int((~sure).sum()) < 10
