"""Pictures, videos and meshes of a trained actor from new views and in new poses."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Motion = Literal["turntable", "t-pose", "view", "sequence", "pose-file"]


@dataclass(frozen=True)
class AnimateOptions:
    """Renders a trained actor; no data file is needed for turntable, t-pose and pose-file."""

    checkpoint: Path
    """Few-shot checkpoint (its folder)."""
    out: Path
    """Folder for the pictures and video.mp4."""
    motion: Motion = "turntable"
    """turntable: around the actor in a support pose. t-pose: the same in the T-pose. view: poses
    of `data` from its camera `camera`. sequence: poses of another actor's prepared file `data`.
    pose-file: poses of an AIST++ .pkl or AMASS-style .npz, `pose_file`."""
    data: Path | None = None
    """Prepared file (view, sequence)."""
    camera: str | None = None
    """Camera of `data` (view, sequence); its training camera if left out."""
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
    """Samples per ray; the checkpoint's own if left out."""
    device: str = "cpu"
    """cpu, cuda, cuda:1, ..."""


def run_render(options: AnimateOptions) -> tuple[Path, ...]:
    """The files written.

    Raises:
        UserError: no such checkpoint, file, camera or pose; a pose file of another convention.
    """
    raise NotImplementedError(options)
