"""Synthetic actors written as a raw ZJU-MoCap tree: 23-camera form, millimetres, distorted lenses.

World as in the real data: z down, floor at z = 0. Each actor has a folder `CoreView_<name>` with
`annots.npy`, `Camera_B<k>/`, `mask_cihp/` (part labels), `mask/`, and both fits: `params` and
`vertices` without pose blend shapes, `new_params` and `new_vertices` with them.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from actorsnerf_datasets import body_model
from actorsnerf_datasets.conventions import world_from_body
from actorsnerf_datasets.protocols import generic_protocol, needed_pairs
from actorsnerf_datasets.rotations import axis_angle_from_matrix
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.renderer import MeshRenderer
from actorsnerf_preprocess.stage import (
    Lens,
    Performance,
    SyntheticOptions,
    meshes_of,
    performances,
    ring,
    take,
)

ZJU_FROM_STAGE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns y up into z down."""
RADIUS, HEIGHT = 3.0, 1.3
"""Metres; the real stage's cameras are 2.9 to 3.2 m from its axis."""
FOCAL = 1.05
"""Focal length over picture side (real: 1027 to 1111 pixels for 1024)."""
DISTORTIONS = np.array([[-0.27, 0.10, 3e-4, -2e-4, -0.02], [-0.24, 0.07, -2e-4, 3e-4, -0.01]])
"""Alternating lenses, of the real ones' size."""
FRAMES_PER_SECOND = 15.0
JPEG_QUALITY = 95
SIGN = "synthetic.json"
HELD_OUT = "held_out.txt"


def write_zju_tree(root: Path, options: SyntheticOptions, progress: bool = False) -> None:
    """Write the tree; a second call with the same options writes the same pictures.

    Args:
        root: folder; made if missing.
        options: size of the data set.
        progress: show a bar.
    """
    root.mkdir(parents=True, exist_ok=True)
    renderer = MeshRenderer()
    held_out = []
    for performance in performances(options, renderer, FRAMES_PER_SECOND):
        folder = root / f"CoreView_{performance.name}"
        _write_actor(folder, performance, renderer, options, progress)
        if performance.role == "held_out":
            held_out.append(folder.name)
    (root / HELD_OUT).write_text("".join(f"{name}\n" for name in held_out))
    sign = {"generator": "actorsnerf synthetic", "format": "ZJU-MoCap", "seed": options.seed}
    (root / SIGN).write_text(json.dumps(sign, indent=2) + "\n")
    renderer.close()


def lenses(options: SyntheticOptions) -> tuple[Lens, ...]:
    """The stage's cameras, in the y-up world."""
    size = (options.size, options.size)
    cameras = ring(options.cameras, RADIUS, HEIGHT, FOCAL * options.size, size)
    return tuple(
        Lens(camera, DISTORTIONS[index % len(DISTORTIONS)]) for index, camera in enumerate(cameras)
    )


def _write_actor(
    folder: Path,
    performance: Performance,
    renderer: MeshRenderer,
    options: SyntheticOptions,
    progress: bool,
) -> None:
    cameras = lenses(options)
    names = [f"Camera_B{index + 1}" for index in range(len(cameras))]
    for name in (*names, *(f"{mask}/{name}" for mask in ("mask", "mask_cihp") for name in names)):
        (folder / name).mkdir(parents=True, exist_ok=True)
    _write_annotations(folder, cameras, names, options.frames)
    _write_fits(folder, performance)
    pairs = _pairs(performance, names, options)
    frames: Iterable[int] = range(options.frames)
    for frame in tqdm(frames, desc=performance.name, disable=not progress, leave=False):
        meshes = None
        for name, lens in zip(names, cameras, strict=True):
            if (name, frame) not in pairs:
                continue
            meshes = meshes or meshes_of(performance, frame)
            shot = take(renderer, meshes, lens)
            picture = np.ascontiguousarray(shot.rgb[..., ::-1])
            quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
            cv2.imwrite(str(folder / name / f"{frame:06d}.jpg"), picture, quality)
            cv2.imwrite(str(folder / "mask_cihp" / name / f"{frame:06d}.png"), shot.labels)
            solid = (shot.labels > 0).astype(np.uint8)
            cv2.imwrite(str(folder / "mask" / name / f"{frame:06d}.png"), solid)


def _pairs(
    performance: Performance, names: list[str], options: SyntheticOptions
) -> frozenset[tuple[str, int]]:
    """(camera, frame) pairs that are drawn."""
    everything = frozenset((name, frame) for name in names for frame in range(options.frames))
    if options.full:
        return everything
    protocol = generic_protocol(performance.role, names, np.arange(options.frames))
    pool = {(names[0], frame) for frame in range(options.frames)}
    return frozenset(needed_pairs(protocol)) | pool


def _write_annotations(
    folder: Path, cameras: tuple[Lens, ...], names: list[str], frames: int
) -> None:
    """`annots.npy`: translations in millimetres, as the real file has them."""
    annotations = {
        "cams": {
            "K": [lens.pinhole.K for lens in cameras],
            "D": [lens.distortion[:, None] for lens in cameras],
            "R": [lens.pinhole.R @ ZJU_FROM_STAGE.T for lens in cameras],
            "T": [lens.pinhole.T[:, None] * 1000 for lens in cameras],
        },
        "ims": [{"ims": [f"{name}/{frame:06d}.jpg" for name in names]} for frame in range(frames)],
    }
    np.save(folder / "annots.npy", np.array(annotations, dtype=object))


def _write_fits(folder: Path, performance: Performance) -> None:
    """Both fits, EasyMocap's convention: v = R(Rh) x + Th."""
    for name in ("params", "vertices", "new_params", "new_vertices"):
        (folder / name).mkdir(exist_ok=True)
    motion, actor = performance.motion, performance.dressed.actor
    turned = np.eye(4)
    turned[:3, :3] = ZJU_FROM_STAGE
    for frame in range(motion.frame_count):
        for prefix, blend in (("", False), ("new_", True)):
            posed = body_model.pose(
                performance.dressed.body, actor.betas, motion.poses[frame], pose_blend=blend
            )
            pelvis = posed.rest_joints[0]
            stage: Float64 = world_from_body(
                motion.global_orient[frame], motion.transl[frame], pelvis
            )
            world = turned @ stage
            parameters = {
                "poses": motion.poses[frame].reshape(1, 72),
                "Rh": axis_angle_from_matrix(world[:3, :3])[None],
                "Th": world[None, :3, 3],
                "shapes": actor.betas[None],
            }
            vertices = posed.vertices @ world[:3, :3].T + world[:3, 3]
            np.save(folder / f"{prefix}params" / f"{frame}.npy", np.array(parameters, object))
            np.save(folder / f"{prefix}vertices" / f"{frame}.npy", vertices.astype(np.float32))


__all__ = ["write_zju_tree"]
