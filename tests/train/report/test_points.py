import dataclasses

import pytest
import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked.baking import BakeOptions, BakeReport
from actorsnerf_model.filled_cells import FilledActor, SkipEmpty
from actorsnerf_model.neuralbody import NeuralBody, NeuralBodyState
from actorsnerf_model.states import RenderOptions
from actorsnerf_train.report.contestants import contestants
from actorsnerf_train.report.points import (
    POINTS,
    at_named_point,
    at_point,
    named_point,
    options_at,
    skips_empty,
    where_filled,
)
from actorsnerf_train.trained import Baking, TrainedActor


def test_names_are_unique_and_enough() -> None:
    names = [point.name for point in POINTS]
    assert len(set(names)) == len(names)
    assert names[:3] == ["reference", "complete", "exact"]
    assert sum(point.kind == "stated" for point in POINTS) >= 6


def test_exact_points_keep_the_trainings_samples_and_threshold() -> None:
    base = RenderOptions(samples=48, threshold=0.02, background=(1.0, 1.0, 1.0))
    for point in POINTS:
        options = options_at(point, base)
        assert options.background == base.background
        if point.kind != "stated":
            assert (options.samples, options.threshold) == (48, 0.02)
            lost = options.stop_transmittance + options.samples * options.least_weight
            assert lost <= 1 / 255
            assert point.precision == "float32"


@pytest.mark.parametrize(("name", "samples"), [("half-samples", 6), ("quarter-samples", 3)])
def test_samples_are_shares_of_the_trainings(name: str, samples: int) -> None:
    assert options_at(named_point(name), RenderOptions(samples=12)).samples == samples  # type: ignore[arg-type]  # a PointName


def test_an_actor_at_a_point_shares_weights_and_leaves_the_original_alone(
    trained: TrainedActor[ActorsNeRFState],
) -> None:
    assert isinstance(trained.method, ActorsNeRF)
    tuned = at_point(trained, named_point("bfloat16"))
    assert isinstance(tuned.method, ActorsNeRF)
    assert tuned.method.network_dtype == torch.bfloat16
    assert trained.method.network_dtype == torch.float32
    assert tuned.method.radiance.density_out.weight is trained.method.radiance.density_out.weight
    assert tuned.state is trained.state


def test_a_thinner_shell_has_its_own_occupied_cells(
    trained: TrainedActor[ActorsNeRFState],
) -> None:
    tuned = at_point(trained, named_point("shell-0.1"))
    view = trained.supports[0]
    poses = [
        actor.method.pose_state(actor.state, view.pose, view.rest_joints)
        for actor in (trained, tuned)
    ]
    cells = [pose.occupancy for pose in poses]
    assert cells[0] is not None and cells[1] is not None
    assert cells[1].threshold == 0.1 == tuned.config.render.threshold
    assert cells[1].cells.sum() < cells[0].cells.sum()


def test_empty_cells_are_made_once_and_shared(trained: TrainedActor[ActorsNeRFState]) -> None:
    filled = where_filled(trained)
    fast = at_point(trained, named_point("fast"), filled)
    assert fast.state is filled and filled.actor is trained.state
    assert isinstance(fast.method, SkipEmpty)
    own = at_point(trained, named_point("skip-empty")).state
    assert isinstance(own, FilledActor)
    assert torch.equal(own.cells.filled, filled.cells.filled)
    view = trained.supports[0]
    pose = trained.method.pose_state(trained.state, view.pose, view.rest_joints)
    low, high = pose.bounds
    points = low + (high - low) * torch.rand(50_000, 3, generator=torch.Generator().manual_seed(1))
    every = trained.method.locate(trained.state, pose, points, 0.01).index
    kept = fast.method.locate(filled, pose, points, 0.01).index
    assert 0 < len(kept) <= len(every)  # so little training leaves fog nearly everywhere


def test_without_a_canonical_space_no_cells_are_passed_over(
    neuralbody: TrainedActor[NeuralBodyState],
) -> None:
    assert skips_empty(neuralbody, named_point("fast")) is False
    fast = at_named_point(neuralbody, "fast")
    assert isinstance(fast.method, NeuralBody)
    assert fast.method.network_dtype == torch.bfloat16
    assert fast.config.render.stop_transmittance == 1e-2
    assert [one.actor.state for one in contestants(neuralbody, POINTS[:5], ())] == [
        neuralbody.state
    ] * 5


def test_a_baked_actor_has_no_operating_points(trained: TrainedActor[ActorsNeRFState]) -> None:
    assert at_named_point(trained, None) is trained
    assert at_named_point(trained, "half-samples").config.render.samples == 6
    report = BakeReport(1, 1, 1, 0.0, 0.0)
    baking = Baking("eve", 3, "checkpoint", BakeOptions(), report)
    baked = dataclasses.replace(trained, baking=baking)
    with pytest.raises(UserError, match="is a baked actor, which has one way to be drawn"):
        at_named_point(baked, "fast")
