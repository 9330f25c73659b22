import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.states import FieldValues, Located, PoseState
from actorsnerf_train.mesh import Mesh, MeshOptions, PosedActor, posed_mesh, write_mesh

RADIUS = 0.35


class Ball:
    """A method whose actor is a ball at the origin: its state is the density there."""

    reads_directions = False

    def actor_state(self, supports: tuple[View, ...], window: float) -> float:
        return 40.0

    def pose_state(self, actor: float, pose: Tensor, rest_joints: Tensor) -> PoseState:
        still = torch.eye(4).expand(24, 4, 4)
        bounds = torch.tensor([[-0.5, -0.6, -0.5], [0.5, 0.4, 0.52]])
        return PoseState(pose, still, still, bounds, None)

    def locate(self, actor: float, pose: PoseState, points: Tensor, threshold: float) -> Located:
        likelihood = (0.7 - points.norm(dim=1)).clamp(0, 1)
        index = (likelihood >= threshold).nonzero()[:, 0]
        return Located(index, points[index], likelihood[index])

    def field(self, actor: float, pose: PoseState, located: Located) -> FieldValues:
        """Falls linearly from the actor's density through half of it at the radius."""
        distance = located.canonical.norm(dim=1)
        density = (actor * (1 - distance / (2 * RADIUS))).clamp(min=0)
        return FieldValues((located.canonical + 0.5).clamp(0, 1), density)


@pytest.fixture
def ball() -> PosedActor[float]:
    method = Ball()
    zeros = torch.zeros(24, 3)
    return PosedActor(method, 40.0, method.pose_state(40.0, zeros, zeros))


def test_the_surface_of_a_ball(ball: PosedActor[float]) -> None:
    mesh = posed_mesh(ball, MeshOptions(resolution=0.05, level=20.0))
    distance = np.linalg.norm(mesh.vertices, axis=1)
    assert np.abs(distance - RADIUS).max() < 0.004
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.02)  # > 0: outward
    expected = (mesh.vertices + 0.5) * 255
    assert np.abs(mesh.colours - expected).max() <= 1


def test_chunks_change_nothing(ball: PosedActor[float]) -> None:
    whole = posed_mesh(ball, MeshOptions(resolution=0.1))
    parts = posed_mesh(ball, MeshOptions(resolution=0.1, chunk=7))
    assert np.array_equal(whole.vertices, parts.vertices)
    assert np.array_equal(whole.colours, parts.colours)


def test_a_soft_mask_thins_the_ball_as_it_does_in_pictures(ball: PosedActor[float]) -> None:
    mesh = posed_mesh(ball, MeshOptions(resolution=0.05, level=20.0, soft_mask=True))
    # Where 40 (1 - d / 0.7) (0.7 - d) falls through 20.
    radius = 0.7 - np.sqrt(0.7 / 2)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - radius).max() < 0.01


def test_a_body_cut_by_the_bounds_is_closed(ball: PosedActor[float]) -> None:
    tight = dataclasses.replace(ball.pose, bounds=torch.tensor([[0.0, -1, -1], [1.0, 1, 1]]))
    mesh = posed_mesh(dataclasses.replace(ball, pose=tight), MeshOptions(resolution=0.1))
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert solid.is_watertight
    assert solid.bounds[0, 0] > -0.1


def test_no_surface_is_a_sentence(ball: PosedActor[float]) -> None:
    message = r"nowhere above 41 1/m \(its highest value is 40\).* --mesh-level, or train longer"
    with pytest.raises(UserError, match=message):
        posed_mesh(ball, MeshOptions(resolution=0.1, level=41.0))


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_files_hold_the_mesh(tmp_path: Path, ball: PosedActor[float], suffix: str) -> None:
    mesh = posed_mesh(ball, MeshOptions(resolution=0.1))
    path = tmp_path / f"body{suffix}"
    write_mesh(path, mesh)
    found = trimesh.load_mesh(path, process=False)
    assert found.is_watertight and len(found.faces) == len(mesh.faces)
    assert np.allclose(found.bounds, trimesh.Trimesh(mesh.vertices, mesh.faces).bounds, atol=1e-5)
    assert isinstance(found.visual, trimesh.visual.ColorVisuals)
    assert sorted(map(tuple, found.visual.vertex_colors[:, :3].tolist())) == sorted(
        map(tuple, mesh.colours.tolist())
    )
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_other_formats_are_refused(tmp_path: Path) -> None:
    nothing = Mesh(
        np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.uint8)
    )
    with pytest.raises(UserError, match=r"body\.stl: a mesh is written as \.ply or \.obj"):
        write_mesh(tmp_path / "body.stl", nothing)
