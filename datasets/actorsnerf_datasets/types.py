"""What a prepared sequence is, as frozen dataclasses of numpy arrays."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Float32 = NDArray[np.float32]
UInt8 = NDArray[np.uint8]
Int64 = NDArray[np.int64]
Role = Literal["pretraining", "held_out"]
ListName = Literal["official", "auto"]


@dataclass(frozen=True)
class Camera:
    """One static camera, OpenCV axes, metres; `K` belongs to the full stored picture."""

    name: str
    source_index: int
    K: Float64
    """(3, 3) pixels; the centre of the top-left pixel is (0, 0)."""
    R: Float64
    """(3, 3) camera from world."""
    T: Float64
    """(3,) camera from world, metres."""
    size: tuple[int, int]
    """Width and height of the full stored picture."""
    source_K: Float64
    source_distortion: Float64
    """(5,) k1 k2 p1 p2 k3, as found."""
    source_size: tuple[int, int]


@dataclass(frozen=True)
class BodyFits:
    """SMPL fits of F frames. Body frame: SMPL's own, without global rotation and translation."""

    global_orient: Float64
    """(F, 3) axis-angle, about the pelvis."""
    transl: Float64
    """(F, 3) metres; v = R (x - j0) + j0 + transl."""
    body_pose: Float64
    """(F, 23, 3) axis-angle of joints 1 to 23."""
    betas: Float64
    """(F, B)."""
    world_from_body: Float64
    """(F, 4, 4) rigid: [R | transl + j0 - R j0]."""
    rest_joints: Float64
    """(F, 24, 3) body frame, metres."""
    posed_joints: Float64
    """(F, 24, 3) body frame, metres."""
    posed_vertices: Float32
    """(F, V, 3) body frame, metres; (0, V, 3) in `SequenceFile.header`, which leaves them in the
    file: `SequenceFile.posed_vertices` reads one frame's."""


@dataclass(frozen=True)
class ActorShape:
    """The actor at rest: mean betas over the prepared frames, zero pose, body frame, metres."""

    betas: Float64
    rest_joints: Float64
    rest_vertices: Float32


@dataclass(frozen=True)
class Shots:
    """M training frames and K support frames of one few-shot setting (frame numbers)."""

    name: str
    """fewshot-5, fewshot-10, fewshot-30, fewshot-100, fewshot-300 or short-video."""
    list_name: ListName
    frames: tuple[int, ...]
    support: tuple[int, ...]


@dataclass(frozen=True)
class Protocol:
    """Who does what in a study; frames are frame numbers of the source."""

    name: str
    role: Role
    training_camera: str
    evaluation_cameras: tuple[str, ...]
    pretraining_frames: tuple[int, ...]
    evaluation_frames: tuple[int, ...]
    shots: tuple[Shots, ...]


@dataclass(frozen=True)
class Provenance:
    """Where the file came from; the fields are root attributes of the same names."""

    dataset: Literal["zju-mocap", "aist++", "synthetic", "converted"]
    variant: str
    body_model: str
    scale: float
    background: Literal["dropped", "kept"]
    mask_source: str
    source_terms: str
    notes: tuple[str, ...]
    source_digests: tuple[tuple[str, str], ...]
    """(path inside the source, hex SHA-256)."""


@dataclass(frozen=True)
class SequenceHeader:
    """All of a sequence but its pictures."""

    sequence: str
    actor: str
    world_up: Float64
    """(3,) unit vector."""
    cameras: tuple[Camera, ...]
    frames: Int64
    """(F,) frame numbers, ascending."""
    fits: BodyFits
    shape: ActorShape
    protocols: tuple[Protocol, ...]
    provenance: Provenance


@dataclass(frozen=True)
class Picture:
    """A stored crop: straight RGB, the person's alpha, and where it sits in the full picture."""

    rgb: UInt8
    """(H, W, 3)."""
    alpha: UInt8
    """(H, W)."""
    offset: tuple[int, int]
    """x, y of the top-left pixel in the full stored picture; may be negative."""
