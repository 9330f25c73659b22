from typing import TYPE_CHECKING, Any

import pytest
import torch
from torch.overrides import TorchFunctionMode

from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames
from actorsnerf_model.occupancy import asks_every_sample, occupancy_tables, pose_occupancy
from actorsnerf_model.skinning import SkinningVolume, backward_warp, skinning_volume
from actorsnerf_model.skinning_bounds import skinning_bounds
from actorsnerf_model.skinning_prior import log_prior
from actorsnerf_model.states import Occupancy

if TYPE_CHECKING:
    from tests.model.conftest import ToyScene


class Transfers(TorchFunctionMode):
    """Counts what brings numbers of a tensor to the host."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def __torch_function__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        names = ("tolist", "item", "cpu", "numpy", "__bool__", "__int__", "__float__", "__index__")
        self.count += getattr(func, "__name__", "") in names
        return func(*args, **(kwargs or {}))


def spread(bounds: torch.Tensor, count: int, generator: torch.Generator) -> torch.Tensor:
    share = torch.rand(count, 3, generator=generator, dtype=torch.float64).to(bounds.dtype)
    return bounds[0] + (bounds[1] - bounds[0]) * share


def in_true_cells(points: torch.Tensor, occupancy: Occupancy) -> torch.Tensor:
    sizes = torch.tensor(occupancy.cells.shape)
    place = (points - occupancy.box[0]) / (occupancy.box[1] - occupancy.box[0]) * sizes
    cell = place.floor().long().minimum(sizes - 1).clamp(min=0)
    return occupancy.cells[tuple(cell.unbind(-1))]


def posed(
    generator: torch.Generator, joints: torch.Tensor, size: float = 0.7
) -> tuple[torch.Tensor, torch.Tensor]:
    pose = (size * torch.randn(24, 3, generator=generator)).to(joints.dtype)
    pose[0] = 0
    there, _ = bone_motions(pose, joints, joints)
    return there, observation_bounds(posed_frames(pose, joints)[1])


@pytest.mark.parametrize("cell", [0.025, 0.04, 0.11])
def test_no_possible_point_lies_in_an_empty_cell(
    generator: torch.Generator, scene: "ToyScene", cell: float
) -> None:
    volume, bounds = scene.actor.volume, scene.actor.bounds
    tables = occupancy_tables(volume, bounds, cell)
    for _ in range(3):
        there, box = posed(generator, scene.actor.canonical_joints)
        occupancy = pose_occupancy(tables, there, box, 0.01)
        points = spread(box, 30_000, generator)
        _, likelihood = backward_warp(points, volume, there)
        assert in_true_cells(points[likelihood >= 0.01], occupancy).all()


def test_autocast_empties_no_cell(generator: torch.Generator, scene: "ToyScene") -> None:
    tables = occupancy_tables(scene.actor.volume, scene.actor.bounds, 0.04)
    there, box = posed(generator, scene.actor.canonical_joints)
    with torch.autocast("cpu", torch.bfloat16):
        inside = pose_occupancy(tables, there, box, 0.01)
    assert torch.equal(inside.cells, pose_occupancy(tables, there, box, 0.01).cells)


def test_most_of_the_box_is_empty(
    generator: torch.Generator, scene: "ToyScene", rest_joints: torch.Tensor
) -> None:
    joints = rest_joints.float()
    box = scene.actor.volume.box
    prior = log_prior(joints, box, (32, 32, 32))
    volume = skinning_volume(torch.zeros_like(prior), prior, box)
    tables = occupancy_tables(volume, skinning_bounds(volume))
    there, bounds = posed(generator, joints, 0.3)
    occupancy = pose_occupancy(tables, there, bounds, 0.01)
    _, likelihood = backward_warp(spread(bounds, 20_000, generator), volume, there)
    share = (likelihood >= 0.01).float().mean()
    assert share < occupancy.cells.float().mean() < 2.5 * share


def test_sharp_weights_on_unlike_axes(generator: torch.Generator, scene: "ToyScene") -> None:
    """Random single nodes: nothing smooth to hide behind."""
    weights = torch.zeros(24, 6, 9, 5)
    for bone in range(24):
        z, y, x = (int(torch.randint(size, (), generator=generator)) for size in (6, 9, 5))
        weights[bone, z, y, x] = 0.9
    volume = SkinningVolume(weights, scene.actor.volume.box)
    tables = occupancy_tables(volume, skinning_bounds(volume), 0.05)
    there, box = posed(generator, scene.actor.canonical_joints)
    occupancy = pose_occupancy(tables, there, box, 0.01)
    points = spread(box, 50_000, generator)
    _, likelihood = backward_warp(points, volume, there)
    assert (likelihood >= 0.01).sum() > 100
    assert in_true_cells(points[likelihood >= 0.01], occupancy).all()


def test_the_grid_covers_the_bounds(generator: torch.Generator, scene: "ToyScene") -> None:
    there, box = posed(generator, scene.actor.canonical_joints)
    occupancy = pose_occupancy(scene.actor.tables, there, box, 0.01)
    assert torch.equal(occupancy.box[0], box[0])
    assert (occupancy.box[1] >= box[1] - 1e-6).all()
    assert (occupancy.box[1] - box[1] < scene.actor.tables.cell + 1e-6).all()


def test_only_a_training_step_off_the_cpu_goes_without_cells() -> None:
    cpu, other = torch.device("cpu"), torch.device("meta")
    assert asks_every_sample(other) and not asks_every_sample(cpu)
    with torch.no_grad():
        assert not asks_every_sample(other)


def test_a_pose_asks_the_device_once(generator: torch.Generator, scene: "ToyScene") -> None:
    there, box = posed(generator, scene.actor.canonical_joints)
    with Transfers() as transfers:
        pose_occupancy(scene.actor.tables, there, box, 0.01)
    assert transfers.count == 1


def test_an_empty_volume_occupies_nothing(generator: torch.Generator, scene: "ToyScene") -> None:
    volume = SkinningVolume(torch.zeros(24, 4, 4, 4), scene.actor.volume.box)
    tables = occupancy_tables(volume, skinning_bounds(volume))
    there, box = posed(generator, scene.actor.canonical_joints)
    assert not pose_occupancy(tables, there, box, 0.01).cells.any()


def test_no_threshold_occupies_everything(generator: torch.Generator, scene: "ToyScene") -> None:
    there, box = posed(generator, scene.actor.canonical_joints)
    assert pose_occupancy(scene.actor.tables, there, box, 0.0).cells.all()


def test_a_level_too_coarse_for_the_threshold_stays_conservative(
    generator: torch.Generator, scene: "ToyScene"
) -> None:
    bounds = skinning_bounds(scene.actor.volume, level=1e-3)
    tables = occupancy_tables(scene.actor.volume, bounds, 0.05)
    there, box = posed(generator, scene.actor.canonical_joints)
    assert pose_occupancy(tables, there, box, 0.01).cells.all()
