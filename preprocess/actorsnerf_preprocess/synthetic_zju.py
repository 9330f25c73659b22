"""Synthetic actors written as a raw ZJU-MoCap tree, in any of the forms in circulation.

World as in the real data: z down, floor at z = 0. How an actor's folder looks is its variant's
affair: `zju_layouts` for trees with an `annots.npy`, `zju_converted_writer` for those prepared by
HumanNeRF and ActorsNeRF. At the root: `synthetic.json`, `held_out.txt`, and `truth/` with what real
data could not know. The same seed gives the same pictures in every variant.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from actorsnerf_datasets.body_model import rest
from actorsnerf_datasets.conventions import world_from_body
from actorsnerf_datasets.protocols import generic_protocol, needed_pairs
from actorsnerf_datasets.rotations import axis_angle_from_matrix
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.actors import FramePose, actor_name, draw_meshes, skin_in_world
from actorsnerf_preprocess.backdrops import studio
from actorsnerf_preprocess.imperfections import noisy, ragged
from actorsnerf_preprocess.motions import Motion
from actorsnerf_preprocess.renderer import MeshRenderer
from actorsnerf_preprocess.shots import Lens, Rig, Shot, rig_of, take
from actorsnerf_preprocess.source import SourceCamera
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
    require_sensible,
    ring,
    sign_finished,
)
from actorsnerf_preprocess.surface_share import seen_vertices, vertex_areas
from actorsnerf_preprocess.zju_converted_writer import (
    ACTORSNERF,
    HUMANNERF,
    ConvertedLayout,
    ConvertedTreeWriter,
)
from actorsnerf_preprocess.zju_fits import RawFit
from actorsnerf_preprocess.zju_layouts import LAYOUTS, Layout, TreeVariant
from actorsnerf_preprocess.zju_tree_writer import AnnotatedTreeWriter, TreeWriter, write_image

ZJU_FROM_STAGE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns y up into z down."""
RADIUS, HEIGHT = 3.0, 1.3
"""Metres; the real stage's cameras are 2.9 to 3.2 m from its axis."""
FOCAL = 1.05
"""Focal length over picture side (real: 1027 to 1111 pixels for 1024)."""
DISTORTIONS = np.array([[-0.27, 0.10, 3e-4, -2e-4, -0.02], [-0.24, 0.07, -2e-4, 3e-4, -0.01]])
"""Alternating lenses, of the real ones' size."""
FRAMES_PER_SECOND = 15.0
VARIANTS: dict[TreeVariant, Layout | ConvertedLayout] = {
    **LAYOUTS,
    "converted-humannerf": HUMANNERF,
    "converted-actorsnerf": ACTORSNERF,
}
"""What each variant's folders look like."""


@dataclass(frozen=True)
class _Place:
    """One actor's folder, what is kept beside it, and the cameras that look."""

    writer: TreeWriter
    truth: Path
    rigs: tuple[Rig, ...]


def write_zju_tree(root: Path, options: SyntheticOptions, progress: bool = False) -> None:
    """Writes the tree; a call that was interrupted is gone on with by the next.

    Args:
        root: folder; new, empty, or a tree of the same options, of which only what is missing is
            written.
        options: size of the data set.
        progress: show a bar.

    Raises:
        SourceError: the folder holds something else, or the numbers make no data set.
        RendererError: headless GL does not work.
    """
    layout = VARIANTS[options.variant]
    require_sensible(options, len(layout.cameras), f"a {options.variant}")
    if not claim(root, "ZJU-MoCap", options):
        return
    names = [layout.folder.format(actor=actor_name(*each)) for each in cast(options)]
    rigs = studio_rigs(options)[: len(layout.cameras)]
    recording = Recording(FRAMES_PER_SECOND)
    with MeshRenderer() as renderer:
        for performance in performances(
            options, renderer, recording, lambda position: is_finished(root, names[position])
        ):
            name = names[performance.position]
            place = _Place(_writer(root / name, layout, len(rigs)), root / TRUTH / name, rigs)
            place.truth.mkdir(parents=True, exist_ok=True)
            facts = _write_actor(place, performance, renderer, options, progress)
            keep_facts(root, name, facts)
    sign_finished(root, names[options.actors :])


def studio_rigs(options: SyntheticOptions) -> tuple[Rig, ...]:
    """The stage's cameras, in the y-up world, each before its dark curtain."""
    size = (options.size, options.size)
    cameras = ring(options.cameras, RADIUS, HEIGHT, options.zoom * FOCAL * options.size, size)
    return tuple(
        rig_of(
            Lens(camera, DISTORTIONS[index % len(DISTORTIONS)]),
            studio(camera, np.random.default_rng([options.seed, index, 2])),
        )
        for index, camera in enumerate(cameras)
    )


def _writer(folder: Path, layout: Layout | ConvertedLayout, cameras: int) -> TreeWriter:
    if isinstance(layout, Layout):
        return AnnotatedTreeWriter(folder, layout, cameras)
    return ConvertedTreeWriter(folder, layout, cameras)


def _write_actor(
    place: _Place,
    performance: Performance,
    renderer: MeshRenderer,
    options: SyntheticOptions,
    progress: bool,
) -> dict[str, object]:
    """Writes one actor's folder; returns what truth/ says of it."""
    writer = place.writer
    numbers = range(writer.first, writer.first + options.frames)
    writer.write_cameras(_cameras(place), numbers)
    seed = [options.seed, *performance.name.encode(), 3]
    motion = performance.motion
    found = noisy(motion, np.random.default_rng(seed)) if options.fit_noise else motion
    fits = {number: _fit(performance, found, frame) for frame, number in enumerate(numbers)}
    writer.write_fits(fits, performance.dressed.body)
    if options.fit_noise:
        np.savez_compressed(
            place.truth / "motion.npz",
            poses=motion.poses,
            global_orient=motion.global_orient,
            transl=motion.transl,
        )
    pairs = _pairs(performance, writer.cameras, options)
    seen = []
    for frame in tqdm(
        range(options.frames), desc=performance.name, disable=not progress, leave=False
    ):
        pose = performance.pose(frame)
        meshes = draw_meshes(performance.dressed, pose)
        for camera, rig in enumerate(place.rigs):
            if (camera, frame) in pairs:
                shot = take(renderer, meshes, rig, LIGHTING)
                # A generator per picture, so that a mask does not depend on which others there are.
                rng = np.random.default_rng([*seed, camera, frame])
                pair = (camera, writer.first + frame)
                _write_shot(place, pair, shot, rng if options.ragged_masks else None)
                if camera == 0 and frame < pool_size(options.frames):
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
            "share_of_surface_seen_in_the_first_third": float(areas[seen[:clip].any(axis=0)].sum()),
            "share_of_surface_seen_in_all": float(areas[seen.any(axis=0)].sum()),
        },
    }


def _write_shot(
    place: _Place, pair: tuple[int, int], shot: Shot, rng: np.random.Generator | None
) -> None:
    """A picture and its masks; with a generator the masks are ragged and the true one is kept."""
    labels = shot.labels
    if rng is not None:
        name = place.writer.picture_name(*pair)
        write_image((place.truth / "mask" / name).with_suffix(".png"), labels)
        labels = ragged(labels, rng)
    place.writer.write_picture(*pair, shot.rgb, labels)


def _pairs(
    performance: Performance, cameras: tuple[str, ...], options: SyntheticOptions
) -> frozenset[tuple[int, int]]:
    """(camera, frame position) pairs that are drawn: of the first camera, the whole pool too."""
    every = range(len(cameras))
    if options.full:
        return frozenset((camera, frame) for camera in every for frame in range(options.frames))
    protocol = generic_protocol(performance.role, list(cameras), np.arange(options.frames))
    needed = {(cameras.index(camera), frame) for camera, frame in needed_pairs(protocol)}
    return frozenset(needed | {(0, frame) for frame in range(pool_size(options.frames))})


def _cameras(place: _Place) -> tuple[SourceCamera, ...]:
    """The rigs in ZJU-MoCap's world."""
    return tuple(
        SourceCamera(
            name=name,
            source_index=index,
            K=rig.lens.pinhole.K,
            distortion=rig.lens.distortion,
            R=rig.lens.pinhole.R @ ZJU_FROM_STAGE.T,
            T=rig.lens.pinhole.T,
            size=rig.lens.pinhole.size,
        )
        for index, (name, rig) in enumerate(zip(place.writer.cameras, place.rigs, strict=True))
    )


def _fit(performance: Performance, motion: Motion, frame: int) -> RawFit:
    """EasyMocap's convention: v = R(Rh) x + Th."""
    betas = performance.dressed.actor.betas
    pelvis = rest(performance.dressed.body, betas)[0][0]
    world = _zju_from_body(motion, frame, pelvis)
    Rh = axis_angle_from_matrix(world[:3, :3])
    return RawFit(motion.poses[frame].reshape(24, 3), Rh, world[:3, 3], betas, padded=False)


def _zju_from_body(motion: Motion, frame: int, pelvis: Float64) -> Float64:
    turned = np.eye(4)
    turned[:3, :3] = ZJU_FROM_STAGE
    stage = world_from_body(motion.global_orient[frame], motion.transl[frame], pelvis)
    moved: Float64 = turned @ stage
    return moved
