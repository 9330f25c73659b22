"""Synthetic actors written as a raw ZJU-MoCap tree: millimetres, distorted lenses, two fits.

World as in the real data: z down, floor at z = 0. Each actor has a folder `CoreView_<name>` with
`annots.npy`, a folder of JPEGs per camera, `mask_cihp/` (part labels), `mask/` (0 and 1), and both
fits: `params` and `vertices` without pose blend shapes, `new_params` and `new_vertices` with them.
At the root: `synthetic.json`, `held_out.txt`, and `truth/` with what real data could not know.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from actorsnerf_datasets import body_model
from actorsnerf_datasets.conventions import world_from_body
from actorsnerf_datasets.protocols import generic_protocol, needed_pairs
from actorsnerf_datasets.rotations import axis_angle_from_matrix
from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_preprocess.actors import FramePose, actor_name, draw_meshes, skin_in_world
from actorsnerf_preprocess.backdrops import studio
from actorsnerf_preprocess.imperfections import noisy, ragged
from actorsnerf_preprocess.motions import Motion
from actorsnerf_preprocess.renderer import MeshRenderer
from actorsnerf_preprocess.shots import Lens, Rig, Shot, rig_of, take
from actorsnerf_preprocess.source import SourceError
from actorsnerf_preprocess.stage import (
    LIGHTING,
    TRUTH,
    Performance,
    Recording,
    SyntheticOptions,
    cast,
    claim,
    is_finished,
    keep_facts,
    performances,
    pool_size,
    ring,
    sign_finished,
)
from actorsnerf_preprocess.surface_share import seen_vertices, vertex_areas

ZJU_FROM_STAGE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns y up into z down."""
RADIUS, HEIGHT = 3.0, 1.3
"""Metres; the real stage's cameras are 2.9 to 3.2 m from its axis."""
FOCAL = 1.05
"""Focal length over picture side (real: 1027 to 1111 pixels for 1024)."""
DISTORTIONS = np.array([[-0.27, 0.10, 3e-4, -2e-4, -0.02], [-0.24, 0.07, -2e-4, 3e-4, -0.01]])
"""Alternating lenses, of the real ones' size."""
FRAMES_PER_SECOND = 15.0
STAMPED_FRAMES_PER_SECOND = 30.0
JPEG_QUALITY = 95


@dataclass(frozen=True)
class _Place:
    """One actor's folder and how its files are called."""

    folder: Path
    truth: Path
    cameras: tuple[str, ...]
    first: int
    """Number of the first frame."""

    def picture(self, camera: str, frame: int) -> str:
        """Path below the folder."""
        if self.first == 0:
            return f"{camera}/{frame:06d}.jpg"
        seconds = frame / STAMPED_FRAMES_PER_SECOND + 0.001 * self.cameras.index(camera)
        stamp = f"2019-08-23_16-{8 + int(seconds) // 60:02d}-{seconds % 60:06.3f}"
        name = f"{self.folder.name}_{camera.replace(' ', '_')}_{frame + 1:04d}_{stamp}"
        return f"{camera}/{name}.jpg"


def write_zju_tree(root: Path, options: SyntheticOptions, progress: bool = False) -> None:
    """Writes the tree; a call that was interrupted is gone on with by the next.

    Args:
        root: folder; new, empty, or a tree of the same options, of which only what is missing is
            written.
        options: size of the data set.
        progress: show a bar.

    Raises:
        SourceError: the folder holds something else.
        RendererError: headless GL does not work.
    """
    if not claim(root, "ZJU-MoCap", options):
        return
    names = [f"CoreView_{actor_name(index, role)}" for index, role in cast(options)]
    rigs = studio_rigs(options)
    recording = Recording(FRAMES_PER_SECOND)
    with MeshRenderer() as renderer:
        for performance in performances(
            options, renderer, recording, lambda position: is_finished(root, names[position])
        ):
            place = _place(root, performance, options)
            facts = _write_actor(place, performance, renderer, rigs, options, progress)
            keep_facts(root, place.folder.name, facts)
    sign_finished(root, names[options.actors :])


def studio_rigs(options: SyntheticOptions) -> tuple[Rig, ...]:
    """The stage's cameras, in the y-up world, each before its dark curtain."""
    size = (options.size, options.size)
    cameras = ring(options.cameras, RADIUS, HEIGHT, FOCAL * options.size, size)
    return tuple(
        rig_of(
            Lens(camera, DISTORTIONS[index % len(DISTORTIONS)]),
            studio(camera, np.random.default_rng([options.seed, index, 2])),
        )
        for index, camera in enumerate(cameras)
    )


def _place(root: Path, performance: Performance, options: SyntheticOptions) -> _Place:
    folder = root / f"CoreView_{performance.name}"
    stamped = options.variant == "classic-21"
    pattern = "Camera ({})" if stamped else "Camera_B{}"
    cameras = tuple(pattern.format(index + 1) for index in range(options.cameras))
    place = _Place(folder, root / TRUTH / folder.name, cameras, int(stamped))
    for base in (folder, folder / "mask", folder / "mask_cihp"):
        for camera in cameras:
            (base / camera).mkdir(parents=True, exist_ok=True)
    place.truth.mkdir(parents=True, exist_ok=True)
    return place


def _write_actor(
    place: _Place,
    performance: Performance,
    renderer: MeshRenderer,
    rigs: tuple[Rig, ...],
    options: SyntheticOptions,
    progress: bool,
) -> dict[str, object]:
    """Writes one actor's folder; returns what truth/ says of it."""
    _write_annotations(place, rigs, options)
    rng = np.random.default_rng([options.seed, *performance.name.encode(), 3])
    motion = performance.motion
    found = noisy(motion, rng) if options.fit_noise else motion
    _write_fits(place.folder, performance, found, place.first)
    if options.fit_noise:
        np.savez_compressed(
            place.truth / "motion.npz",
            poses=motion.poses,
            global_orient=motion.global_orient,
            transl=motion.transl,
        )
    pairs = _pairs(performance, place.cameras, options)
    seen = []
    for frame in tqdm(
        range(options.frames), desc=performance.name, disable=not progress, leave=False
    ):
        pose = performance.pose(frame)
        meshes = draw_meshes(performance.dressed, pose)
        for camera, rig in zip(place.cameras, rigs, strict=True):
            if (camera, frame) in pairs:
                shot = take(renderer, meshes, rig, LIGHTING)
                _write_shot(place, camera, frame, shot, rng if options.ragged_masks else None)
                if camera == place.cameras[0] and frame < pool_size(options.frames):
                    seen.append(_seen(performance, pose, shot))
    return _facts(performance, np.array(seen))


def _seen(performance: Performance, pose: FramePose, shot: Shot) -> NDArray[np.bool_]:
    vertices, normals = skin_in_world(performance.dressed, pose)
    if shot.view is None:
        return np.zeros(len(vertices), dtype=bool)
    return seen_vertices(shot.view, vertices, normals)


def _facts(performance: Performance, seen: NDArray[np.bool_]) -> dict[str, object]:
    """What nobody knows of a real actor; `seen` is (pool frames, V) from the first camera."""
    model, actor = performance.dressed.body, performance.dressed.actor
    areas = vertex_areas(model.template, model.faces)
    clip = max(len(seen) // 3, 1)
    return {
        "role": actor.role,
        "dance": performance.dance,
        "betas": actor.betas.round(6).tolist(),
        "outfit": asdict(actor.outfit),
        "first_camera": {
            "pool_frames": len(seen),
            "share_of_surface_seen_in_the_first_third": float(areas @ seen[:clip].any(axis=0)),
            "share_of_surface_seen_in_all": float(areas @ seen.any(axis=0)),
        },
    }


def _write_shot(
    place: _Place, camera: str, frame: int, shot: Shot, rng: np.random.Generator | None
) -> None:
    """A picture and its masks; with a generator the masks are ragged and the true one is kept."""
    name = place.picture(camera, frame)
    _write_image(place.folder / name, shot.rgb[..., ::-1])
    labels = shot.labels
    if rng is not None:
        _write_image((place.truth / "mask" / name).with_suffix(".png"), labels)
        labels = ragged(labels, rng)
    _write_image((place.folder / "mask_cihp" / name).with_suffix(".png"), labels)
    solid = (labels > 0).astype(np.uint8)
    _write_image((place.folder / "mask" / name).with_suffix(".png"), solid)


def _write_image(path: Path, image: UInt8) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if path.suffix == ".jpg" else []
    if not cv2.imwrite(str(path), np.ascontiguousarray(image), quality):
        raise SourceError(f"{path}: cannot be written; is the disk full?")


def _pairs(
    performance: Performance, cameras: tuple[str, ...], options: SyntheticOptions
) -> frozenset[tuple[str, int]]:
    """(camera, frame position) pairs that are drawn: of the first camera, the whole pool too."""
    if options.full:
        return frozenset((camera, frame) for camera in cameras for frame in range(options.frames))
    protocol = generic_protocol(performance.role, list(cameras), np.arange(options.frames))
    pool = {(cameras[0], frame) for frame in range(pool_size(options.frames))}
    return frozenset(needed_pairs(protocol) | pool)


def _write_annotations(place: _Place, rigs: tuple[Rig, ...], options: SyntheticOptions) -> None:
    """`annots.npy`: translations in millimetres; plain lists in the 21-camera tree, as in real."""
    lenses = [rig.lens for rig in rigs]
    cams: dict[str, list[object]] = {
        "K": [lens.pinhole.K for lens in lenses],
        "D": [lens.distortion[:, None] for lens in lenses],
        "R": [lens.pinhole.R @ ZJU_FROM_STAGE.T for lens in lenses],
        "T": [lens.pinhole.T[:, None] * 1000 for lens in lenses],
    }
    if options.variant == "classic-21":
        cams = {key: [np.asarray(value).tolist() for value in cams[key]] for key in cams}
    pictures = [
        {"ims": [place.picture(camera, frame) for camera in place.cameras]}
        for frame in range(options.frames)
    ]
    _save(place.folder / "annots.npy", {"cams": cams, "ims": pictures})


def _write_fits(folder: Path, performance: Performance, motion: Motion, first: int) -> None:
    """Both fits, EasyMocap's convention: v = R(Rh) x + Th."""
    betas = performance.dressed.actor.betas
    for frame in range(motion.frame_count):
        for prefix, blend in (("", False), ("new_", True)):
            posed = body_model.pose(
                performance.dressed.body, betas, motion.poses[frame], pose_blend=blend
            )
            world = _zju_from_body(motion, frame, posed.rest_joints[0])
            parameters = {
                "poses": motion.poses[frame].reshape(1, 72),
                "Rh": axis_angle_from_matrix(world[:3, :3])[None],
                "Th": world[None, :3, 3],
                "shapes": betas[None],
            }
            vertices = posed.vertices @ world[:3, :3].T + world[:3, 3]
            _save(folder / f"{prefix}params" / f"{frame + first}.npy", parameters)
            _save(folder / f"{prefix}vertices" / f"{frame + first}.npy", vertices.astype("f4"))


def _zju_from_body(motion: Motion, frame: int, pelvis: Float64) -> Float64:
    turned = np.eye(4)
    turned[:3, :3] = ZJU_FROM_STAGE
    stage = world_from_body(motion.global_orient[frame], motion.transl[frame], pelvis)
    moved: Float64 = turned @ stage
    return moved


def _save(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, np.asarray(content))
