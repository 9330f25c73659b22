"""How exact prepared files are: projections, picture content, bodies, conventions, made masks."""

import argparse
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from records import Table, record
from scenes import BODY, HOME, SEED, aist_root, fresh, zju_sequence

from actorsnerf_datasets import body_model, conventions
from actorsnerf_datasets.body_model import load_body_model
from actorsnerf_datasets.cameras import project
from actorsnerf_datasets.pickles import load_npy, load_pickle
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_preprocess.aist import find_aist, open_aist
from actorsnerf_preprocess.masks import mask_scores
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import OpenOptions, RawPicture, SourceSequence
from actorsnerf_preprocess.zju import find_zju, open_zju

PUBLISHED_SCALE = 0.5
Row = tuple[str | float | int, ...]


def main() -> None:
    """Measures and records."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=24, help="compared pixel by pixel")
    parser.add_argument("--masks", type=int, default=30, help="made masks compared, per camera")
    parser.add_argument("--bodies", type=int, default=200, help="random bodies")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    zju = open_zju(find_zju(zju_sequence())[0], OpenOptions(body_model=BODY, pairs="all"))
    aist = every_fourth(
        open_aist(find_aist(aist_root())[0], OpenOptions(body_model=BODY, pairs="all"))
    )
    for source in (zju, aist):
        _prepare(source)
    tables = [
        Table(
            "Projected vertices of the prepared file against the raw annotation",
            ("data set", "frames", "cameras", "median, px", "largest, px", "aim, px"),
            (zju_projection(zju), aist_projection(aist)),
            "Stored pixels (half size). The raw side is the annotation alone: the vertices of "
            "`new_vertices` in float32 with K, R and T/1000; SMPL posed by `smpl_poses` about its "
            "pelvis, scaled and moved in centimetres, with the cameras in centimetres.",
        ),
        content(zju, arguments.pictures),
        bodies(arguments.bodies),
        round_trips(arguments.bodies),
        made_masks(aist, arguments.masks),
    ]
    record("exactness", "How exact prepared files are", SEED, tables)


def every_fourth(source: SourceSequence) -> SourceSequence:
    """The sequence at the published rate of AIST++, a fourth of the videos' pictures."""
    wanted = source.wanted & (np.arange(len(source.frames)) % 4 == 0)
    return replace(source, wanted=wanted)


def zju_projection(source: SourceSequence) -> Row:
    """Prepared ZJU-MoCap vertices in crop pixels against annots.npy and new_vertices."""
    root = source.found.path
    cams: Any = load_npy(root / "annots.npy")
    errors = []
    with _prepared(source) as file:
        for camera in range(len(source.cameras)):
            K, R = (np.asarray(cams["cams"][key][camera], np.float64) for key in ("K", "R"))
            T = np.asarray(cams["cams"]["T"][camera], np.float64).ravel() / 1000
            for index, number in enumerate(source.frames.tolist()):
                if file.row[camera, index] < 0:
                    continue
                vertices = np.asarray(load_npy(root / f"new_vertices/{number}.npy"), np.float64)
                raw = _seen(vertices @ R.T + T, K)
                errors.append(_stored(file, camera, index) - _halved(raw))
    return _errors_row("ZJU-MoCap", errors, source)


def aist_projection(source: SourceSequence) -> Row:
    """Prepared AIST++ vertices in crop pixels against motion and cameras in centimetres."""
    root = source.found.path / "annotations"
    motion: Any = load_pickle(root / "motions" / f"{source.found.name}.pkl")
    model = load_body_model(BODY)
    scaling = float(np.ravel(motion["smpl_scaling"])[0])
    entries = _camera_entries(root / "cameras")
    errors = []
    with _prepared(source) as file:
        for index, number in enumerate(source.frames.tolist()):
            angles = np.asarray(motion["smpl_poses"][number], np.float64).reshape(24, 3)
            # The root turns about the pelvis; then the body is scaled, then moved.
            world = scaling * body_model.pose(model, np.zeros(10), angles).vertices
            world = world + motion["smpl_trans"][number]
            for camera, entry in enumerate(entries[: len(source.cameras)]):
                if file.row[camera, index] < 0:
                    continue
                R = cv2.Rodrigues(np.asarray(entry["rotation"], np.float64))[0]
                T = np.asarray(entry["translation"], np.float64)
                raw = _seen(world @ R.T + T, np.asarray(entry["matrix"], np.float64))
                errors.append(_stored(file, camera, index) - _halved(raw))
    return _errors_row("AIST++", errors, source)


def content(source: SourceSequence, count: int) -> Table:
    """Composites of stored crops against the published order at full size, in levels of 255."""
    backgrounds = {"black": 0.0, "white": 255.0, "grey": 128.0}
    exact: dict[str, list[Float64]] = {name: [] for name in backgrounds}
    beyond: dict[str, list[Float64]] = {name: [] for name in backgrounds}
    with _prepared(source) as file:
        for camera in range(len(source.cameras)):
            frames = np.linspace(0, len(source.frames) - 1, count // 2).astype(int).tolist()
            for frame in np.unique(frames).tolist():
                raw = next(source.reader.read_many(camera, [frame]))
                if not isinstance(raw, RawPicture) or file.row[camera, frame] < 0:
                    continue
                premultiplied, share = _resized_parts(raw, source, camera)
                stored = file.full_alpha(camera, frame)
                near = cv2.dilate((stored > 0).astype(np.uint8), np.ones((3, 3))) > 0
                held = (premultiplied >= 0).all(2) & (premultiplied <= 255 * share).all(2)
                held &= (share >= 0).all(2) & (share <= 1).all(2)
                for name, level in backgrounds.items():
                    published = np.clip(premultiplied + level * (1 - share), 0, 255)
                    found = file.full_picture(camera, frame, (level / 255,) * 3) * 255
                    error = np.abs(found - published)
                    exact[name].append(error[near & held].ravel())
                    beyond[name].append(error[near & ~held].ravel())
    rows: list[Row] = []
    for name in backgrounds:
        inside, outside = np.concatenate(exact[name]), np.concatenate(beyond[name])
        rows.append(
            (
                name,
                float(np.median(inside)),
                float(inside.max()),
                f"{len(outside) / (len(inside) + len(outside)):.1%}",
                float(np.median(outside)),
                float(np.quantile(outside, 0.99)),
                float(outside.max()),
            )
        )
    return Table(
        "Picture content on and one pixel around the person against the undistorted source",
        (
            "background",
            "median, levels",
            "largest, levels",
            "beyond 8 bits",
            "median there",
            "99 % there",
            "largest there",
        ),
        tuple(rows),
        "The published order: undistort picture and mask, composite at full size, resize by "
        "Lanczos, clip. 1 level is 1/255. Lanczos overshoots at sharp edges; where that puts the "
        "share beyond 0 to 1, or the straight colour beyond 0 to 255, 8 bits cannot hold it, and "
        "the last four columns are of those pixels. Black is the published background.",
    )


def bodies(count: int) -> Table:
    """Our skinning against smplx on random shapes, poses and translations, metres."""
    try:
        oracle = _smplx()
    except ImportError:
        return Table("SMPL parity", ("oracle",), (("smplx is not installed",),))
    import torch

    rng = np.random.default_rng(SEED)
    model = load_body_model(BODY)
    vertices, joints = [], []
    for _ in range(count):
        betas, angles = rng.normal(size=10), rng.normal(size=(24, 3))
        transl = 3 * rng.normal(size=3)
        expected = oracle(
            betas=torch.tensor(betas[None]),
            body_pose=torch.tensor(angles[None, 1:].reshape(1, 69)),
            global_orient=torch.tensor(angles[None, 0]),
            transl=torch.tensor(transl[None]),
        )
        posed = body_model.pose(model, betas, angles)
        wanted = expected.vertices[0].detach().numpy()
        vertices.append(np.abs(posed.vertices + transl - wanted).max())
        wanted = expected.joints[0, :24].detach().numpy()
        joints.append(np.abs(posed.joints + transl - wanted).max())
    rows = tuple(
        (name, count, float(np.median(errors)), float(np.max(errors)), 1e-6)
        for name, errors in (("vertices", vertices), ("joints", joints))
    )
    columns = ("what", "bodies", "median, m", "largest, m", "aim, m")
    return Table("SMPL parity: our skinning against smplx, the free body", columns, rows)


def round_trips(count: int) -> Table:
    """Conventions there and back, and each against a body posed by the other, metres."""
    rng = np.random.default_rng(SEED + 1)
    model = load_body_model(BODY)
    errors: dict[str, list[float]] = {
        "ZJU-MoCap: Rh, Th to standard and back": [],
        "ZJU-MoCap: vertices, standard against R(Rh) x + Th": [],
        "AIST++: centimetres to metres and back": [],
        "AIST++: vertices, standard against scaled centimetres": [],
    }
    for _ in range(count):
        betas, angles = rng.normal(size=10), rng.normal(0, 0.5, size=(24, 3))
        body_pose = np.concatenate([np.zeros((1, 3)), angles[1:]])
        posed = body_model.pose(model, betas, body_pose)
        pelvis = posed.rest_joints[0]
        Rh, Th = rng.normal(size=3), 3 * rng.normal(size=3)
        orient, transl = conventions.standard_from_easymocap(Rh, Th, pelvis)
        back = conventions.easymocap_from_standard(orient, transl, pelvis)
        zju = posed.vertices @ matrix_from_axis_angle(Rh).T + Th
        world = _moved(posed.vertices, conventions.world_from_body(orient, transl, pelvis))
        scaling, moved = float(rng.uniform(80, 110)), 300 * rng.normal(size=3)
        metres = conventions.metres_from_aist(moved, scaling)
        turned = body_model.pose(model, betas, np.concatenate([Rh[None], angles[1:]]))
        centimetres = scaling * turned.vertices + moved
        matrix = conventions.world_from_body(Rh, metres, pelvis)
        in_metres = _moved(posed.vertices, matrix)
        found = (
            max(_apart(back[0], Rh), _apart(back[1], Th)),
            _apart(zju, world),
            _apart(conventions.aist_from_metres(metres, scaling), moved) / scaling,
            _apart(centimetres / scaling, in_metres),
        )
        for listed, error in zip(errors.values(), found, strict=True):
            listed.append(error)
    rows = tuple(
        (name, float(np.median(listed)), float(np.max(listed)), 1e-6)
        for name, listed in errors.items()
    )
    return Table("Conventions", ("what", "median, m", "largest, m", "aim, m"), rows)


def made_masks(source: SourceSequence, count: int) -> Table:
    """Made masks of synthetic AIST++ video against the truth."""
    root = source.found.path
    rows: list[Row] = []
    for camera, found in enumerate(source.cameras):
        name = source.found.name.replace("cAll", found.name)
        frames = np.unique(np.linspace(0, len(source.frames) - 1, count).astype(int)).tolist()
        scores = []
        for frame, raw in zip(frames, source.reader.read_many(camera, frames), strict=True):
            number = int(source.frames[frame])
            path = root / "truth" / "masks" / name / f"{number:06d}.png"
            truth = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
            if isinstance(raw, RawPicture) and raw.mask is not None:
                scores.append(mask_scores(raw.mask, truth))
        overlap, boundary = np.array(scores).T
        rows.append(
            (
                found.name,
                len(scores),
                float(np.median(overlap)),
                float(overlap.min()),
                float(np.median(boundary)),
                float(boundary.min()),
            )
        )
    columns = ("camera", "pictures", "IoU", "worst IoU", "boundary F, 2 px", "worst boundary F")
    width, height = source.cameras[0].size
    remark = (
        "Video with a textured stage, soft shadows, sensor noise and lossy coding; the person "
        "wears clothes and hair that the fitted body lacks. Aim: IoU at least 0.95."
    )
    return Table(f"Made masks, {width} x {height}", columns, tuple(rows), remark)


def _prepare(source: SourceSequence) -> None:
    """Prepares the sequence with the code as it is, whatever lies there."""
    options = PrepareOptions(contact_sheet=False)
    fresh(_folder(source), lambda folder: prepare_sequence(source, folder, options))


def _prepared(source: SourceSequence) -> SequenceFile:
    return SequenceFile(_folder(source) / f"{source.found.name}.h5")


def _folder(source: SourceSequence) -> Path:
    return HOME / "exactness" / source.found.dataset / source.found.name


def _stored(file: SequenceFile, camera: int, frame: int) -> Float64:
    """Projected stored vertices in pixels of the full stored picture."""
    vertices = file.posed_vertices(frame).astype(np.float64)
    found = project(vertices, file.crop_K(camera, frame), file.camera_from_body(camera, frame))
    return found.pixels + file.offsets[file.row[camera, frame]]


def _seen(points: Float64, K: Float64) -> Float64:
    homogeneous = points @ K.T
    pixels: Float64 = homogeneous[:, :2] / homogeneous[:, 2:]
    return pixels


def _halved(pixels: Float64) -> Float64:
    return (pixels + 0.5) * PUBLISHED_SCALE - 0.5


def _errors_row(name: str, errors: list[Float64], source: SourceSequence) -> Row:
    distances = np.linalg.norm(np.concatenate(errors), axis=1)
    frames, cameras = int(source.wanted.any(axis=0).sum()), len(source.cameras)
    return name, frames, cameras, float(np.median(distances)), float(distances.max()), 0.01


def _resized_parts(raw: RawPicture, source: SourceSequence, camera: int) -> tuple[Float64, Float64]:
    """Premultiplied colour (H, W, 3), levels, and share (H, W, 1), resized, unclipped."""
    known = source.cameras[camera]
    mask: UInt8 = np.asarray(raw.mask, np.uint8)
    image = cv2.undistort(raw.image, known.K, known.distortion).astype(np.float64)
    share = cv2.undistort(mask, known.K, known.distortion).astype(np.float64) / 255
    half = {"dsize": None, "fx": PUBLISHED_SCALE, "fy": PUBLISHED_SCALE}
    lanczos = {**half, "interpolation": cv2.INTER_LANCZOS4}
    premultiplied = cv2.resize(image * share[..., None], **lanczos)
    return np.asarray(premultiplied), np.asarray(cv2.resize(share, **lanczos))[..., None]


def _smplx() -> Callable[..., Any]:
    """The oracle, on the free body."""
    import pickle

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of smplx and of what it imports
        import smplx
        import torch

        with np.load(BODY) as arrays:
            names = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights")
            entries = {name: np.asarray(arrays[name], np.float64) for name in names}
            entries |= {name: np.asarray(arrays[name]) for name in ("kintree_table", "f")}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "body.pkl"
            path.write_bytes(pickle.dumps(entries))
            ids = dict.fromkeys(smplx.vertex_ids.vertex_ids["smplh"], 0)
            return smplx.SMPL(str(path), vertex_ids=ids, dtype=torch.float64)


def _camera_entries(folder: Path) -> list[dict[str, Any]]:
    import json

    (path,) = folder.glob("*.json")
    content: list[dict[str, Any]] = json.loads(path.read_text())
    return content


def _moved(points: Float64, matrix: Float64) -> Float64:
    moved: Float64 = points @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


def _apart(a: Float64, b: Float64) -> float:
    return float(np.abs(a - b).max())


if __name__ == "__main__":
    main()
