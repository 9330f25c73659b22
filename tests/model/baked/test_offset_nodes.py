import dataclasses

import torch
from torch import Tensor

from actorsnerf_model.baked.offset_nodes import (
    Layer,
    OffsetNodes,
    offset_volume,
    offsets_at,
    offsets_in_pose,
)
from actorsnerf_model.deformation import POSE_NUMBERS
from actorsnerf_model.interpolation import trilinear

LOW = torch.tensor([1.0, 2.0, 3.0])


def made(kept: list[int], given: Tensor, mean: Tensor) -> OffsetNodes:
    """Two layers: relu(given + pose[3]), then times (1, 2, 3)."""
    pose = torch.zeros(1, POSE_NUMBERS)
    pose[0, 0] = 1  # x of joint 1
    first = Layer(torch.zeros(1, 0), pose, torch.zeros(1))
    last = Layer(torch.tensor([[1.0], [2.0], [3.0]]), torch.zeros(3, 0), torch.zeros(3))
    nodes = torch.tensor(kept, dtype=torch.int32)
    return OffsetNodes(LOW, 0.5, (2, 2, 2), nodes, given, (0,), (first, last), mean)


def test_hand_numbers() -> None:
    nodes = made([0, 7], torch.tensor([[[1.0], [-5.0]]]), torch.tensor([[0.5, 0, 0], [0, 0, 0]]))
    pose = torch.zeros(24, 3)
    pose[1, 0] = 2.0
    pose[0] = 100.0  # the root is ignored
    moved = offsets_in_pose(nodes, pose)
    assert moved.tolist() == [[2.5, 6.0, 9.0], [0.0, 0.0, 0.0]]
    volume = offset_volume(nodes, moved)
    assert volume.shape == (3, 4, 4, 4) and volume[:, 1, 1, 1].tolist() == [2.5, 6.0, 9.0]
    assert int(volume.count_nonzero()) == 3
    places = torch.stack(
        [LOW + torch.tensor([0.25, 0.0, 0.0]), LOW + torch.tensor([0.0, 0.0, 9.0])]
    )
    half = offsets_at(places.T, nodes, volume)
    assert half.T.tolist() == [[1.25, 3.0, 4.5], [0.0, 0.0, 0.0]]


def test_offsets_between_nodes_are_a_volumes(generator: torch.Generator) -> None:
    """A few nodes of a box that is no cube, against the slow interpolation of the whole box."""
    sizes, kept = (3, 4, 5), [0, 7, 23, 38, 59]
    nodes = dataclasses.replace(made(kept, torch.zeros(1, 5, 1), torch.zeros(5, 3)), sizes=sizes)
    moved = torch.rand(5, 3, generator=generator)
    whole = torch.zeros(60, 3).index_copy(0, torch.tensor(kept), moved).reshape(*sizes, 3)
    places = torch.rand(300, 3, generator=generator) * torch.tensor([7.0, 6.0, 5.0]) - 1.5
    found = offsets_at((LOW + places * 0.5).T, nodes, offset_volume(nodes, moved))
    torch.testing.assert_close(found.T, trilinear(whole, places), atol=1e-5, rtol=0)
