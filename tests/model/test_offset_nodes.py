import torch
from torch import Tensor

from actorsnerf_model.deformation import POSE_NUMBERS
from actorsnerf_model.offset_nodes import (
    Layer,
    OffsetNodes,
    offset_volume,
    offsets_at,
    offsets_in_pose,
)

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
    assert volume.shape == (2, 2, 2, 3) and volume[0, 0, 0].tolist() == [2.5, 6.0, 9.0]
    assert int(volume.count_nonzero()) == 3
    half = offsets_at(LOW + torch.tensor([[0.25, 0.0, 0.0], [0.0, 0.0, 9.0]]), nodes, volume)
    assert half.tolist() == [[1.25, 3.0, 4.5], [0.0, 0.0, 0.0]]
