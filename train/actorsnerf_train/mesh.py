"""An actor's surface: where the density field passes a level, as a coloured triangle mesh."""

from dataclasses import dataclass
from pathlib import Path
from typing import Generic

import numpy as np
import torch
import trimesh
from jaxtyping import Float
from numpy.typing import NDArray
from skimage.measure import marching_cubes
from torch import Tensor

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.types import Float32, UInt8
from actorsnerf_model.states import ActorState, Method, PoseState
from actorsnerf_train.checkpoint import write_whole

UNSEEN_GREY = 0.5
"""Colour of a vertex that the field says nothing about."""
MESH_SUFFIXES = (".ply", ".obj")


@dataclass(frozen=True)
class MeshOptions:
    """How fine, and where the surface lies."""

    resolution: float = 0.01
    """Grid spacing, metres."""
    level: float = 20.0
    """Density of the surface, 1/metre: at 20 light halves in 3.5 cm."""
    threshold: float = 0.01
    """Foreground likelihood below which there is nothing (as in `RenderOptions`)."""
    chunk: int = 16384
    """Points through the networks at once."""
    soft_mask: bool = False
    """Multiply density by likelihood, as the method's pictures multiply opacity (HumanNeRF)."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in the body frame, metres; normals point outward."""

    vertices: Float32
    """(V, 3)."""
    faces: NDArray[np.int32]
    """(T, 3)."""
    colours: UInt8
    """(V, 3)."""


@dataclass(frozen=True)
class PosedActor(Generic[ActorState]):
    """A field in the body frame: a method with the actor and the pose it looks at."""

    method: Method[ActorState]
    actor: ActorState
    pose: PoseState

    @torch.no_grad()
    def at(
        self, points: Float[Tensor, "points 3"], options: MeshOptions
    ) -> tuple[Float[Tensor, "points 3"], Float[Tensor, " points"]]:
        """Colour and density at points; grey and 0 where the actor is not."""
        rgb = torch.full_like(points, UNSEEN_GREY)
        density = points.new_zeros(len(points))
        for start in range(0, len(points), options.chunk):
            part = points[start : start + options.chunk]
            located = self.method.locate(self.actor, self.pose, part, options.threshold)
            values = self.method.field(self.actor, self.pose, located)
            rgb[start + located.index] = values.rgb.to(rgb.dtype)
            held = values.density * located.likelihood if options.soft_mask else values.density
            density[start + located.index] = held.to(density.dtype)
        return rgb, density


def posed_mesh(posed: PosedActor[ActorState], options: MeshOptions) -> Mesh:
    """The closed surface where the density reaches the level, inside the pose's bounds.

    Raises:
        UserError: the density reaches the level nowhere.
    """
    lower, upper = posed.pose.bounds
    counts = torch.ceil((upper - lower) / options.resolution).int().tolist()
    axes = [
        corner + options.resolution * torch.arange(count + 1).to(lower)
        for corner, count in zip(lower, counts, strict=True)
    ]
    density = torch.zeros([len(axis) for axis in axes])
    for i, x in enumerate(axes[0]):  # a slice at a time bounds the memory
        plane = torch.stack(torch.meshgrid(x[None], axes[1], axes[2], indexing="ij"), dim=-1)
        density[i] = posed.at(plane.reshape(-1, 3), options)[1].reshape(plane.shape[1:3]).cpu()
    if float(density.max()) <= options.level:
        raise UserError(
            f"The density is nowhere above {options.level:g} 1/m (its highest value is "
            f"{float(density.max()):.3g}), so there is no surface: choose a lower level with "
            "--mesh-level, or train longer."
        )
    padded = np.pad(density.numpy(), 1)  # closes the surface where the body touches the bounds
    found, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]  # has no annotations
        padded, options.level, gradient_direction="ascent", allow_degenerate=False
    )
    origin = lower.cpu().numpy() - options.resolution
    vertices = (found * options.resolution + origin).astype(np.float32)
    rgb, _ = posed.at(torch.from_numpy(vertices).to(lower), options)
    colours = (rgb.cpu().clamp(0, 1) * 255).round().numpy().astype(np.uint8)
    return Mesh(vertices=vertices, faces=faces.astype(np.int32), colours=colours)


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Write .ply or .obj with vertex colours.

    Raises:
        UserError: another suffix.
    """
    if path.suffix not in MESH_SUFFIXES:
        raise UserError(f"{path}: a mesh is written as {' or '.join(MESH_SUFFIXES)}.")
    model = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=mesh.colours, process=False)
    content = model.export(file_type=path.suffix[1:])
    assert isinstance(content, str | bytes)
    write_whole(path, content.encode() if isinstance(content, str) else content)
