from dataclasses import replace

import pytest
import torch
from torch import Tensor

from actorsnerf_model.skinning import SkinningVolume, backward_warp
from actorsnerf_train.stability import cases_skinning
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import judged
from actorsnerf_train.stability.cases_skinning import pose_points, skinning_cases, slow_warp
from actorsnerf_train.stability.hard_poses import named_poses


def test_all_within_their_bounds(bench: Bench) -> None:
    rows = [judged(case, bench.subjects) for case in skinning_cases(bench.subjects[0])]
    assert [row.name for row in rows if not row.passed] == []
    assert {row.group for row in rows} == {"warp", "skinning", "prior", "betas"}


def test_the_slow_twin_by_hand(bench: Bench) -> None:
    """One bone holds everything with half its weight and moves it 10 cm."""
    subject = bench.subjects[0]
    volume = subject.state.body.skinning
    weights = torch.zeros_like(volume.weights)
    weights[5] = 0.5
    motion = torch.eye(4).to(weights).repeat(24, 1, 1)
    motion[5, 0, 3] = 0.1
    points = subject.supports[0].canonical_joints[:3]
    warped = slow_warp(points, replace(volume, weights=weights), motion)
    torch.testing.assert_close(warped[:, :3] - points, points.new_tensor([[0.1, 0, 0]] * 3))
    torch.testing.assert_close(warped[:, 3], points.new_full((3,), 0.5))


def test_points_are_the_same_at_every_precision(bench: Bench) -> None:
    pose = named_poses()["splits"]
    points = [pose_points(subject, pose)[1].double() for subject in bench.subjects]
    assert torch.equal(points[0], points[1])
    assert torch.equal(points[0], points[2])


def test_a_warp_that_divides_by_nothing_is_found_out(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def careless(
        points: Tensor, volume: SkinningVolume, canonical_from_body: Tensor
    ) -> tuple[Tensor, Tensor]:
        canonical, likelihood = backward_warp(points, volume, canonical_from_body)
        return canonical * likelihood.clamp(min=1e-4)[:, None] / likelihood[:, None], likelihood

    monkeypatch.setattr(cases_skinning, "backward_warp", careless)
    cases = {case.name: case for case in skinning_cases(bench.subjects[0])}
    row = judged(cases["rows of zeros"], bench.subjects)
    assert not row.passed
    assert not row.results[0].finite
