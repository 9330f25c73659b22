"""Pictures, videos and meshes of a trained actor from new views and in new poses."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from tqdm import tqdm

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_model.states import ActorState, PoseState, Rendering
from actorsnerf_train.bounds import above, at_least, below
from actorsnerf_train.distributed import local_device
from actorsnerf_train.mesh import MESH_SUFFIXES, MeshOptions, PosedActor, posed_mesh, write_mesh
from actorsnerf_train.pictures import is_own, to_bytes, write_depth, write_png, write_video
from actorsnerf_train.pose_file import load_poses
from actorsnerf_train.report.points import PointName, at_named_point
from actorsnerf_train.shots import (
    Shot,
    Turn,
    chosen_frames,
    file_shots,
    foreign_shots,
    own_shots,
    turntable_shots,
)
from actorsnerf_train.trained import TrainedActor, draw, load_actor, with_samples

Kind = Literal["rgb", "alpha", "depth"]
Motion = Literal["turntable", "t-pose", "view", "sequence", "pose-file"]


@dataclass(frozen=True)
class AnimateOptions:
    """Renders a trained actor; no data file is needed for turntable, t-pose and pose-file."""

    checkpoint: Path
    """Few-shot run folder, one of its checkpoints, or a baked actor's file."""
    out: Path
    """Folder for the pictures (rgb_0000.png, ...) and video.mp4. Pictures of an earlier rendering
    there are replaced; those that this one has no like of are removed, and their number told."""
    motion: Motion = "turntable"
    """turntable: around the actor in a support pose. t-pose: the same in the T-pose. view: poses
    of `data` from its camera `camera`. sequence: poses of another actor's prepared file `data`.
    pose-file: poses of an AIST++ .pkl or AMASS-style .npz, `pose_file`."""
    data: Path | None = None
    """Prepared file (view, sequence)."""
    camera: str | None = None
    """Camera of `data` (view, sequence); its first if left out."""
    pose_file: Path | None = None
    """Motion file (pose-file)."""
    first: int = 0
    """First pose taken: a position in the pose file, a position among the frames of `data`."""
    step: int = 1
    """Every how many-th pose."""
    pictures: int = 24
    """At most this many pictures."""
    size: int = 512
    """Height and width in pixels; `view` and `sequence` keep the camera's own size."""
    elevation: float = 0.0
    """Degrees that the turning camera is above the actor's middle."""
    fps: float = 12.0
    """Pictures per second of the video."""
    video: bool = True
    """Write video.mp4."""
    alpha: bool = False
    """Also write opacity (8-bit grey PNG)."""
    depth: bool = False
    """Also write depth (16-bit grey PNG, millimetres)."""
    mesh: Path | None = None
    """Also write the surface in the first pose to this .ply or .obj."""
    mesh_resolution: float = 0.01
    """Grid spacing of that surface, metres."""
    mesh_level: float = 20.0
    """Density of that surface, 1/metre."""
    samples: int | None = None
    """Samples per ray; the training's own if left out."""
    point: PointName | None = None
    """Operating point, e.g. exact or fast (see `report`); left out: every sample that matters."""
    device: str = "cpu"
    """cpu, cuda, cuda:1, ..."""


def run_render(options: AnimateOptions) -> tuple[Path, ...]:
    """The files written.

    Raises:
        UserError: no such checkpoint, file, camera or pose; a pose file of another convention.
    """
    if options.mesh is not None and options.mesh.suffix not in MESH_SUFFIXES:
        raise UserError(f"{options.mesh}: a mesh is written as {' or '.join(MESH_SUFFIXES)}.")
    _refuse_nonsense(options)
    trained = load_actor(options.checkpoint, local_device(options.device))
    return animate(at_named_point(trained, options.point), options)


def _refuse_nonsense(options: AnimateOptions) -> None:
    at_least(1, options, "pictures", "size", "samples")
    above(0, options, "fps", "mesh_resolution", "mesh_level")
    above(-90, options, "elevation")  # straight above, a camera has no upright
    below(90, options, "elevation")


def animate(trained: TrainedActor[ActorState], options: AnimateOptions) -> tuple[Path, ...]:
    """The files written: pictures, video and mesh as the options ask.

    Raises:
        UserError: no such file, camera or pose; a pose file of another convention.
    """
    shots = shots_of(trained, options)
    options.out.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []

    def pictures() -> Iterator[UInt8]:
        for i, shot in enumerate(tqdm(shots, desc="render", unit="picture")):
            seen = take(trained, shot, options)
            picture = to_bytes(seen.rgb)
            written.extend(_write_shot(options, i, picture, seen))
            yield picture

    if options.video:
        video = options.out / "video.mp4"
        write_video(video, pictures(), options.fps)
        written.append(video)
    else:
        for _ in pictures():
            pass
    remove_earlier(options.out, written)
    if options.mesh is not None:
        posed = PosedActor(trained.method, trained.state, _pose_state(trained, shots[0]))
        drawn = trained.config.render
        surface = MeshOptions(
            options.mesh_resolution,
            options.mesh_level,
            drawn.threshold,
            soft_mask=drawn.soft_mask,
        )
        options.mesh.parent.mkdir(parents=True, exist_ok=True)
        write_mesh(options.mesh, posed_mesh(posed, surface))
        written.append(options.mesh)
    return tuple(written)


def shots_of(trained: TrainedActor[ActorState], options: AnimateOptions) -> list[Shot]:
    """The poses and cameras that the options ask for.

    Raises:
        UserError: an option that the motion needs is missing, or names something that is not there.
    """
    turn = Turn(options.pictures, options.size, options.elevation)
    home = trained.home
    rest_joints = _float64(home.canonical_joints)
    match options.motion:
        case "turntable":
            return turntable_shots(_float64(home.pose), _float64(home.rest_joints), turn)
        case "t-pose":
            return turntable_shots(np.zeros((24, 3)), rest_joints, turn)
        case "pose-file":
            if options.pose_file is None:
                raise UserError("--motion pose-file needs --pose-file FILE.pkl or FILE.npz.")
            poses = load_poses(options.pose_file)
            frames = _frames(options, len(poses.body_pose))
            return file_shots(poses, frames, rest_joints, turn)
        case "view" | "sequence":
            return _sequence_shots(trained, options, rest_joints)


def _sequence_shots(
    trained: TrainedActor[ActorState], options: AnimateOptions, rest_joints: Float64
) -> list[Shot]:
    if options.data is None:
        raise UserError(f"--motion {options.motion} needs --data FILE.h5, a prepared sequence.")
    with SequenceFile(options.data) as file:
        camera = 0 if options.camera is None else options.camera
        frames = _frames(options, len(file.header.frames))
        if options.motion == "sequence":
            return foreign_shots(file, camera, frames, rest_joints)
        if file.header.actor != trained.actor:
            raise UserError(
                f"{options.data}: shows actor {file.header.actor}, but the checkpoint was fitted "
                f"to {trained.actor}; for another's motion take --motion sequence."
            )
        return own_shots(file, camera, frames)


@torch.no_grad()
def take(trained: TrainedActor[ActorState], shot: Shot, options: AnimateOptions) -> Rendering:
    """One shot rendered."""
    device = trained.device
    camera = replace(
        shot.camera,
        K=shot.camera.K.to(device),
        camera_from_body=shot.camera.camera_from_body.to(device),
    )
    return draw(
        trained,
        _pose_state(trained, shot),
        camera,
        with_samples(trained.config.render, options.samples),
    )


def surface_depth(seen: Rendering) -> Float[Tensor, "height width"]:
    """Distance along the optical axis, metres; 0 where less than half of the light is stopped."""
    return torch.where(seen.alpha >= 0.5, seen.depth / seen.alpha.clamp(min=0.5), 0.0)


def _pose_state(trained: TrainedActor[ActorState], shot: Shot) -> PoseState:
    pose = torch.from_numpy(shot.pose).to(trained.device, torch.float32)
    rest_joints = torch.from_numpy(shot.rest_joints).to(trained.device, torch.float32)
    return trained.method.pose_state(trained.state, pose, rest_joints)


def _write_shot(
    options: AnimateOptions, number: int, picture: UInt8, seen: Rendering
) -> list[Path]:
    color = _picture_path(options.out, "rgb", number)
    write_png(color, picture)
    written = [color]
    if options.alpha:
        written.append(_picture_path(options.out, "alpha", number))
        write_png(written[-1], to_bytes(seen.alpha[..., None].expand_as(seen.rgb))[..., 0])
    if options.depth:
        written.append(_picture_path(options.out, "depth", number))
        write_depth(written[-1], surface_depth(seen))
    return written


def remove_earlier(out: Path, written: Sequence[Path]) -> None:
    """Remove the pictures of an earlier rendering of more of them, and say so.

    Such pictures are numbered on from 0 without a gap, and say themselves that this program wrote
    them. All else stays, a file of the user's of such a name too.

    Args:
        out: folder of both renderings.
        written: what belongs to the new one.
    """
    kept, earlier = set(written), []
    for kind in get_args(Kind):
        number = 0
        while (path := _picture_path(out, kind, number)).is_file():
            number += 1
            if path not in kept and is_own(path):
                earlier.append(path)
    for path in earlier:
        path.unlink()
    if earlier:
        names = f"{earlier[0].name} to {earlier[-1].name}"
        tqdm.write(f"removed: {len(earlier)} pictures of an earlier rendering, {names}")


def _picture_path(out: Path, kind: Kind, number: int) -> Path:
    return out / f"{kind}_{number:04d}.png"


def _frames(options: AnimateOptions, count: int) -> list[int]:
    return chosen_frames(count, options.first, options.step, options.pictures)


def _float64(values: Tensor) -> Float64:
    array: Float64 = values.detach().cpu().double().numpy()
    return array
