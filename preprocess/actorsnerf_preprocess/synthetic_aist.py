"""Synthetic actors written as a raw AIST++ tree: annotations in scaled centimetres, and videos.

World as in the real data: y up, the floor at y = 0. Bodies have zero betas and one scaling each.
At the root: `annotations/` (cameras, motions, splits, ignore_list.txt), `videos/`,
`synthetic.json`, `held_out.txt`, and `truth/` with the exact masks, which AIST++ does not have.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from actorsnerf_datasets.types import Float32, Float64, Role, UInt8
from actorsnerf_preprocess.actors import draw_meshes, skin_in_world
from actorsnerf_preprocess.aist_names import CAMERA_NAMES, video_name
from actorsnerf_preprocess.aist_tree_writer import (
    FRAMES_PER_SECOND,
    AistMotion,
    AistTreeWriter,
    write_motion,
)
from actorsnerf_preprocess.backdrops import hall
from actorsnerf_preprocess.imperfections import noisy
from actorsnerf_preprocess.motions import Motion
from actorsnerf_preprocess.renderer import Mesh, MeshRenderer, Pinhole
from actorsnerf_preprocess.shots import Lens, Rig, rig_of, take
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
    require_sensible,
    ring,
    sign_finished,
)

ASPECT = 16 / 9
RADIUS, HEIGHT = 5.0, 1.6
"""Metres; the real cameras stand about 5 m away."""
FOCAL = 1600 / 1080
"""Focal length over picture height; the real calibration starts from 1600 pixels."""
RADIAL = (-0.06, -0.045)
"""k1 of alternating lenses; the real calibration has no other coefficient."""
STRIDE = 4
"""Every fourth frame is prepared, so dancers turn four times more slowly per frame."""
SCALINGS = (88.0, 104.0)
"""Smallest and largest `smpl_scaling`, centimetres per metre of the body."""
SETTING = "setting1"
NOISE = 2.5
"""Standard deviation of each picture's own noise, grey values."""
SHADOW = 0.45
"""How much light the middle of a shadow takes away."""
CENTIMETRES = 100.0
"""Units of the world per metre of the hall."""
IGNORED = ("gBR_sBM_cAll_d99_mBR0_ch01", "gBR_sBM_cAll_d98_mBR0_ch01")


@dataclass(frozen=True)
class _Dancer:
    """One performance and how the data set calls and scales it."""

    performance: Performance
    sequence: str
    scaling: float
    """Centimetres per metre of the body."""


def write_aist_tree(root: Path, options: SyntheticOptions, progress: bool = False) -> None:
    """Writes the tree; a call that was interrupted is gone on with by the next.

    Args:
        root: folder; new, empty, or a tree of the same options, of which only what is missing is
            written.
        options: size of the data set; `full`, `variant` and `ragged_masks` do not apply.
        progress: show a bar.

    Raises:
        SourceError: the folder holds something else, the numbers make no data set, or a video
            cannot be written.
        RendererError: headless GL does not work.
    """
    require_sensible(options, len(CAMERA_NAMES), "an AIST++")
    if not claim(root, "AIST++", options):
        return
    writer = AistTreeWriter(root)
    names = [_sequence(position, role) for position, (_, role) in enumerate(cast(options))]
    rigs = hall_rigs(options)
    recording = Recording(FRAMES_PER_SECOND, STRIDE, shaped=False)
    with MeshRenderer() as renderer:
        for performance in performances(
            options, renderer, recording, lambda position: is_finished(root, names[position])
        ):
            dancer = _named(performance, names[performance.position], options)
            _write_motion(writer, dancer, options)
            _write_videos(writer, dancer, renderer, rigs[: options.cameras], progress)
            keep_facts(root, dancer.sequence, _facts(dancer))
    writer.write_cameras(SETTING, _cameras(rigs), CENTIMETRES)
    writer.write_mapping(SETTING, names)
    writer.write_splits(names[: options.actors], names[options.actors :])
    writer.write_ignore_list(IGNORED)
    sign_finished(root, names[options.actors :])


def hall_rigs(options: SyntheticOptions) -> tuple[Rig, ...]:
    """The nine cameras of the hall, metres; c09 looks from c01's side, a little lower."""
    height = options.size
    size = (round(height * ASPECT / 2) * 2, height)
    focal = options.zoom * FOCAL * height
    around = ring(8, RADIUS, HEIGHT, focal, size)
    # Real cameras follow each other clockwise, seen from above.
    clockwise = [around[-index % 8] for index in range(8)]
    ninth = ring(1, RADIUS - 0.3, HEIGHT - 0.2, focal, size)
    rigs = []
    for index, pinhole in enumerate((*clockwise, *ninth)):
        K = pinhole.K.copy()
        K[0, 0] = K[1, 1]
        K[:2, 2] = size[0] / 2, size[1] / 2
        straight = Pinhole(K, pinhole.R, pinhole.T, size)
        backdrop = hall(straight, np.random.default_rng([options.seed, index, 4]))
        distortion = np.array([RADIAL[index % 2], 0.0, 0.0, 0.0, 0.0])
        rigs.append(rig_of(Lens(straight, distortion), backdrop))
    return tuple(rigs)


def _sequence(position: int, role: Role) -> str:
    """A name of the real form; the real dancers are d01 to d30."""
    genre, first = ("BR", 31) if role == "pretraining" else ("HO", 61)
    return f"g{genre}_sFM_cAll_d{first + position:02d}_m{genre}0_ch{position + 1:02d}"


def _named(performance: Performance, sequence: str, options: SyntheticOptions) -> _Dancer:
    rng = np.random.default_rng([options.seed, performance.position, 5])
    return _Dancer(performance, sequence, float(rng.uniform(*SCALINGS)))


def _write_motion(writer: AistTreeWriter, dancer: _Dancer, options: SyntheticOptions) -> None:
    motion = dancer.performance.motion
    found = motion
    if options.fit_noise:
        found = noisy(motion, np.random.default_rng([options.seed, *dancer.sequence.encode(), 6]))
        truth = writer.root / TRUTH / "motions" / f"{dancer.sequence}.pkl"
        write_motion(truth, _aist_motion(motion, dancer))
    writer.write_motion(dancer.sequence, _aist_motion(found, dancer))


def _aist_motion(motion: Motion, dancer: _Dancer) -> AistMotion:
    poses = motion.poses.copy()
    poses[:, 0] = motion.global_orient
    return AistMotion(poses, motion.transl, dancer.scaling)


def _write_videos(
    writer: AistTreeWriter,
    dancer: _Dancer,
    renderer: MeshRenderer,
    rigs: Sequence[Rig],
    progress: bool,
) -> None:
    """All views of one dancer, frame by frame; on the hall's metres the body is scaled."""
    names = [video_name(dancer.sequence, camera) for camera in CAMERA_NAMES[: len(rigs)]]
    videos = [writer.open_video(name, rigs[0].lens.pinhole.size) for name in names]
    masks = [writer.root / TRUTH / "masks" / name for name in names]
    for place in masks:
        place.mkdir(parents=True, exist_ok=True)
    performance = dancer.performance
    rng = np.random.default_rng(list(dancer.sequence.encode()))
    for frame in tqdm(
        range(performance.motion.frame_count),
        desc=dancer.sequence,
        disable=not progress,
        leave=False,
    ):
        pose = performance.pose(frame)
        size = dancer.scaling / 100
        meshes = [_scaled(mesh, size) for mesh in draw_meshes(performance.dressed, pose)]
        skin = size * skin_in_world(performance.dressed, pose)[0]
        for rig, video, place in zip(rigs, videos, masks, strict=True):
            shaded = replace(rig, backdrop=_shaded(rig, skin))
            shot = take(renderer, meshes, shaded, LIGHTING)
            video.write(_noisy(shot.rgb, rng)[..., ::-1])
            person = np.where(shot.labels > 0, np.uint8(255), np.uint8(0))
            cv2.imwrite(str(place / f"{frame:06d}.png"), person)
    for video in videos:
        video.release()


def _scaled(mesh: Mesh, size: float) -> Mesh:
    return replace(mesh, vertices=(mesh.vertices * np.float32(size)).astype(np.float32))


def _shaded(rig: Rig, skin: Float64) -> UInt8:
    """The empty hall with the soft shadow that the key light throws on the floor."""
    direction = LIGHTING.lights[0].direction
    on_floor = skin - (skin[:, 1] / direction[1])[:, None] * direction
    pinhole = rig.lens.pinhole
    points, _ = cv2.projectPoints(
        on_floor, cv2.Rodrigues(pinhole.R)[0], pinhole.T, pinhole.K, rig.lens.distortion
    )
    width, height = pinhole.size
    columns, rows = np.rint(points[:, 0]).astype(int).T
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    dark: Float32 = np.zeros((height, width), dtype=np.float32)
    dark[rows[inside], columns[inside]] = 1.0
    dark = cv2.dilate(dark, np.ones((3, 7), dtype=np.uint8)).astype(np.float32)
    soft = cv2.GaussianBlur(dark, (0, 0), sigmaX=height / 70, sigmaY=height / 140)
    return (rig.backdrop * (1 - SHADOW * soft[..., None])).astype(np.uint8)


def _noisy(rgb: UInt8, rng: np.random.Generator) -> UInt8:
    noise = rng.standard_normal(rgb.shape, dtype=np.float32) * np.float32(NOISE)
    noisy_picture: NDArray[np.float32] = np.clip(rgb + noise, 0, 255)
    return noisy_picture.astype(np.uint8)


def _cameras(rigs: Sequence[Rig]) -> tuple[SourceCamera, ...]:
    return tuple(
        SourceCamera(
            name=name,
            source_index=index,
            K=rig.lens.pinhole.K,
            distortion=rig.lens.distortion,
            R=rig.lens.pinhole.R,
            T=rig.lens.pinhole.T,
            size=rig.lens.pinhole.size,
        )
        for index, (name, rig) in enumerate(zip(CAMERA_NAMES, rigs, strict=True))
    )


def _facts(dancer: _Dancer) -> dict[str, object]:
    actor = dancer.performance.dressed.actor
    return {
        "role": actor.role,
        "dance": dancer.performance.dance,
        "scaling": dancer.scaling,
        "outfit": asdict(actor.outfit),
    }
