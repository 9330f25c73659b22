import pytest
import torch

from actorsnerf_model.projection import project
from actorsnerf_model.rays import Rays, Span
from actorsnerf_train.stability import cases_rays
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import judged
from actorsnerf_train.stability.cases_rays import looking, ray_cases


def test_all_within_their_bounds(bench: Bench) -> None:
    rows = [judged(case, bench.subjects) for case in ray_cases()]
    assert [row.name for row in rows if not row.passed] == []


def test_slabs_without_care_are_found_out(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Dividing by a zero component gives NaN on a face."""

    def careless(rays: Rays, box: torch.Tensor) -> Span:
        low, high = (
            (box[0] - rays.origin) / rays.directions,
            (box[1] - rays.origin) / rays.directions,
        )
        near, far = low.minimum(high).amax(-1), low.maximum(high).amin(-1)
        return Span(near, far, far > near)

    monkeypatch.setattr(cases_rays, "intersect_box", careless)
    rows = {row.name: row for row in (judged(case, bench.subjects) for case in ray_cases())}
    assert not rows["in a face"].passed
    assert not rows["box behind the camera"].passed


def test_a_box_fills_its_share_of_the_picture() -> None:
    bounds = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], dtype=torch.float64)
    camera = looking(bounds, 0.3, (40, 60), 1.0)
    seen = project(bounds.mean(0, keepdim=True), camera.K, camera.camera_from_body)
    torch.testing.assert_close(seen.pixels[0], bounds.new_tensor([19.5, 29.5]))
    up = bounds.new_tensor([[0.0, 3**0.5, 0.0], [0.0, -(3**0.5), 0.0]])
    ends = project(up, camera.K, camera.camera_from_body).pixels[:, 1]
    assert float((ends[1] - ends[0]).abs()) == pytest.approx(60)
