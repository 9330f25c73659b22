"""What the model's tests share: a skeleton, poses, and a method without networks."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest
import torch
from torch import Tensor, nn

from actorsnerf_datasets.skeleton import PARENTS
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked.actor import (
    BakedActor,
    BakedActorData,
    BakedPose,
    BakedState,
    baked_state,
)
from actorsnerf_model.baked.baking import BakeOptions, BakeReport, bake
from actorsnerf_model.kinematics import bone_motions, observation_bounds, posed_frames
from actorsnerf_model.occupancy import OccupancyTables, occupancy_tables, pose_occupancy
from actorsnerf_model.presets import TINY
from actorsnerf_model.skinning import SkinningVolume, canonical_box, skinning_volume
from actorsnerf_model.skinning_bounds import SkinningBounds, locate, skinning_bounds
from actorsnerf_model.skinning_prior import log_prior
from actorsnerf_model.states import Camera, DensityFirst, Located, Method, PoseState

SEED = 20231002
THRESHOLD = 0.01
HALF = [
    [0.06, -0.31, 0.02],
    [0.10, -0.70, 0.01],
    [0.09, -1.10, -0.03],
    [0.12, -1.16, 0.09],
    [0.08, 0.19, 0.00],
    [0.17, 0.22, -0.02],
    [0.43, 0.21, -0.04],
    [0.68, 0.22, -0.04],
    [0.76, 0.21, -0.06],
]
"""Left hip, knee, ankle, foot, collar, shoulder, elbow, wrist and hand of a T-pose, metres."""
MIDDLE = [[0, -0.22, 0.02], [0, -0.11, -0.01], [0, 0.03, 0], [0, 0.08, 0.03]]
NECK = [[0, 0.29, -0.01], [0, 0.38, 0.04]]


@pytest.fixture
def generator() -> torch.Generator:
    """Seeded; the seed is in this file."""
    return torch.Generator().manual_seed(SEED)


@pytest.fixture
def rest_joints() -> Tensor:
    """The 24 joints of an invented adult at rest, metres, float64."""
    places = torch.zeros(24, 3, dtype=torch.float64)
    places[[0, 3, 6, 9]] = torch.tensor(MIDDLE, dtype=torch.float64)
    places[[12, 15]] = torch.tensor(NECK, dtype=torch.float64)
    left = torch.tensor(HALF, dtype=torch.float64)
    places[[1, 4, 7, 10, 13, 16, 18, 20, 22]] = left
    places[[2, 5, 8, 11, 14, 17, 19, 21, 23]] = left * left.new_tensor([-1, 1, 1])
    return places


@pytest.fixture
def support_views(
    rest_joints: Tensor, generator: torch.Generator
) -> Callable[..., tuple[View, ...]]:
    """Makes views of one actor: random pictures and poses, vertices around the bones."""

    def make(
        count: int = 3,
        size: tuple[int, int] = (48, 64),
        vertices: int = 150,
        dtype: torch.dtype = torch.float32,
    ) -> tuple[View, ...]:
        bone = torch.randint(1, 24, (vertices,), generator=generator)
        holder = torch.tensor(PARENTS)[bone]
        share = torch.rand(vertices, 1, generator=generator, dtype=torch.float64)
        around = torch.randn(vertices, 3, generator=generator, dtype=torch.float64)
        rest = rest_joints[holder] * (1 - share) + rest_joints[bone] * share + 0.03 * around
        body = (rest_joints, rest, holder)
        return tuple(_view(body, size, frame, dtype) for frame in range(count))

    def _view(
        body: tuple[Tensor, Tensor, Tensor], size: tuple[int, int], frame: int, dtype: torch.dtype
    ) -> View:
        (joints, rest, holder), (width, height) = body, size
        pose = 0.2 * torch.randn(24, 3, generator=generator, dtype=torch.float64)
        pose[0] = 0
        motion = bone_motions(pose, joints, joints)[1][holder]
        posed = (motion[:, :3, :3] @ rest[..., None])[..., 0] + motion[:, :3, 3]
        camera = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0]))
        camera[:3, 3] = torch.tensor([0.0, -0.4, 2.7])
        focal = 1.2 * height
        K = torch.tensor([[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1]])
        image = torch.rand(height, width, 3, generator=generator)
        alpha = torch.ones(height, width)
        return View(
            image=image.to(dtype),
            alpha=alpha.to(dtype),
            K=K.to(dtype),
            camera_from_body=camera.to(dtype),
            pose=pose.to(dtype),
            rest_joints=joints.to(dtype),
            rest_vertices=rest.to(dtype),
            posed_vertices=posed.to(dtype),
            canonical_joints=joints.to(dtype),
            actor="actor",
            camera="camera",
            frame=frame,
            offset=(0, 0),
            full_size=size,
        )

    return make


@dataclass(frozen=True)
class Fitted:
    """A tiny ActorsNeRF with random networks that show a coloured, opaque body."""

    method: ActorsNeRF
    actor: ActorsNeRFState
    views: tuple[View, ...]
    """Its supports, and one more."""


@pytest.fixture(scope="session")
def kept() -> list[Fitted]:
    """What is made once for all tests."""
    return []


@pytest.fixture(scope="session")
def kept_bakes() -> dict[float, tuple[BakedActorData, BakeReport]]:
    """What is made once for all tests."""
    return {}


@pytest.fixture
def fitted(support_views: Callable[..., tuple[View, ...]], kept: list[Fitted]) -> Fitted:
    """The same for all tests; read it, do not write it."""
    if not kept:
        views = support_views(4)
        torch.manual_seed(SEED)
        radiance = replace(TINY.radiance, density_shift=0.0, density_scale=30.0)
        method = ActorsNeRF(replace(TINY, radiance=radiance)).eval()
        assert method.deformation is not None
        with torch.no_grad():
            nn.init.normal_(method.deformation.offset.weight, std=0.02)
            method.radiance.density_out.weight.mul_(100)
            method.radiance.colour_out.weight.mul_(150)
            actor = method.actor_state(views[:3], 3.0)
        kept.append(Fitted(method, actor, views))
    return kept[0]


@pytest.fixture
def baked_at(
    fitted: Fitted, kept_bakes: dict[float, tuple[BakedActorData, BakeReport]]
) -> Callable[[float], tuple[BakedActorData, BakeReport]]:
    """Bakes the fitted actor at a voxel size, in metres; read it, do not write it."""

    def make(voxel: float) -> tuple[BakedActorData, BakeReport]:
        if voxel not in kept_bakes:
            options = BakeOptions(voxel=voxel, offset_spacing=0.08)
            baked = bake(fitted.method, fitted.actor, fitted.views[:3], options)
            kept_bakes[voxel] = baked
        return kept_bakes[voxel]

    return make


@pytest.fixture(scope="session")
def kept_states() -> list[BakedState]:
    """What is made once for all tests."""
    return []


@pytest.fixture
def state(
    baked_at: Callable[[float], tuple[BakedActorData, BakeReport]], kept_states: list[BakedState]
) -> BakedState:
    """The fitted actor baked at 4 cm; read it, do not write it."""
    if not kept_states:
        kept_states.append(baked_state(baked_at(0.04)[0]))
    return kept_states[0]


@pytest.fixture
def pose(fitted: Fitted, state: BakedState) -> BakedPose:
    """That actor in a pose that was not baked."""
    view = fitted.views[3]
    return BakedActor().pose_state(state, view.pose, view.rest_joints)


@dataclass(frozen=True)
class ToyActor:
    """What the toy method knows of its actor."""

    canonical_joints: Tensor
    volume: SkinningVolume
    bounds: SkinningBounds
    tables: OccupancyTables


class ToyMethod(nn.Module):
    """Real skinning, and a field that is a formula of the canonical point."""

    reads_directions = False

    def __init__(self, canonical_joints: Tensor, nodes: int) -> None:
        super().__init__()
        dtype = canonical_joints.dtype
        self.canonical_joints = canonical_joints
        generator = torch.Generator().manual_seed(SEED)
        shape = (25, nodes, nodes, nodes)
        residual = 0.5 * torch.randn(shape, generator=generator, dtype=dtype)
        self.residual = nn.Parameter(residual)
        self.colours = nn.Parameter(torch.randn(3, 3, generator=generator, dtype=dtype))
        self.density = nn.Parameter(torch.tensor(30.0, dtype=dtype))
        self.asked = 0
        """Points that went through `field`."""
        self.painted = 0
        """Points whose colour was asked for."""

    def actor_state(self, supports: tuple[View, ...], window: float) -> ToyActor:
        box = canonical_box(self.canonical_joints)
        nodes = self.residual.shape[1]
        prior = log_prior(self.canonical_joints, box, (nodes, nodes, nodes))
        volume = skinning_volume(self.residual, prior, box)
        bounds = skinning_bounds(volume)
        tables = occupancy_tables(volume, bounds, cell=0.06)
        return ToyActor(self.canonical_joints, volume, bounds, tables)

    def pose_state(self, actor: ToyActor, pose: Tensor, rest_joints: Tensor) -> PoseState:
        there, back = bone_motions(pose, rest_joints, actor.canonical_joints)
        box = observation_bounds(posed_frames(pose, rest_joints)[1])
        occupancy = pose_occupancy(actor.tables, there, box, THRESHOLD)
        return PoseState(pose, there, back, box, occupancy)

    def locate(self, actor: ToyActor, pose: PoseState, points: Tensor, threshold: float) -> Located:
        return locate(points, actor.volume, actor.bounds, pose.canonical_from_body, threshold)

    def field(self, actor: ToyActor, pose: PoseState, located: Located) -> DensityFirst:
        self.asked += located.index.shape[0]
        wave = torch.sin(7 * located.canonical @ self.colours)
        density = self.density * torch.relu(0.5 + wave.sum(-1))

        def paint(which: Tensor | None) -> Tensor:
            seen = wave if which is None else wave[which]
            self.painted += seen.shape[0]
            return torch.sigmoid(3 * seen)

        return DensityFirst(density, paint)


@dataclass(frozen=True)
class ToyScene:
    """Everything a renderer needs."""

    method: ToyMethod
    actor: ToyActor
    pose: PoseState
    camera: Camera


def make_scene(rest_joints: Tensor, dtype: torch.dtype, nodes: int) -> ToyScene:
    generator = torch.Generator().manual_seed(SEED)
    joints = rest_joints.to(dtype)
    axis_angles = 0.35 * torch.randn(24, 3, generator=generator, dtype=torch.float64)
    axis_angles[0] = 0
    method = ToyMethod(joints, nodes)
    actor = method.actor_state((), 0.0)
    pose = method.pose_state(actor, axis_angles.to(dtype), joints * 1.02)
    K = torch.tensor([[44.0, 0, 15.5], [0, 44.0, 19.5], [0, 0, 1]], dtype=dtype)
    camera_from_body = torch.eye(4, dtype=dtype)
    # Camera y points down: turn the body about x by pi, then step back 3 m.
    camera_from_body[:3, :3] = torch.diag(torch.tensor([1.0, -1.0, -1.0], dtype=dtype))
    camera_from_body[:3, 3] = torch.tensor([0.05, -0.4, 3.0], dtype=dtype)
    return ToyScene(method, actor, pose, Camera(K, camera_from_body, (32, 40)))


@pytest.fixture
def scene(rest_joints: Tensor) -> ToyScene:
    """A posed toy actor before a camera of 32x40 pixels, float32."""
    return make_scene(rest_joints, torch.float32, 16)


@pytest.fixture
def scene64(rest_joints: Tensor) -> ToyScene:
    """The same in float64 with a smaller volume."""
    return make_scene(rest_joints, torch.float64, 12)


def _is_method(method: ToyMethod) -> Method[ToyActor]:
    """For the type checker: the toy keeps the contract."""
    return method
