"""The released ActorsNeRF layout, written and read: what our loader is compared with.

Per camera a folder of whole PNG pictures and PNG masks, distorted as the source has them, beside
pickles of cameras and poses. Its loader decodes, undistorts, blends and resizes at every access.
"""

import pickle
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from actorsnerf_datasets import body_box
from actorsnerf_datasets.patches import PatchScene, draw_patches
from actorsnerf_datasets.pickles import load_npy, load_pickle
from actorsnerf_datasets.types import Float32, UInt8
from actorsnerf_preprocess.source import RawPicture, SourceSequence


def write_released(root: Path, source: SourceSequence) -> None:
    """Writes the tree of the first camera."""
    for name in ("0/images", "0/masks", "new_vertices"):
        (root / name).mkdir(parents=True, exist_ok=True)
    camera = source.cameras[0]
    extrinsics = np.eye(4)
    extrinsics[:3, :3], extrinsics[:3, 3] = camera.R, camera.T
    cameras, poses = {}, {}
    fits = source.fits
    raws = source.reader.read_many(0, range(len(source.frames)))
    for index, (number, raw) in enumerate(zip(source.frames.tolist(), raws, strict=True)):
        assert isinstance(raw, RawPicture) and raw.mask is not None
        name = f"frame_{number:06d}"
        cv2.imwrite(str(root / f"0/images/{name}.png"), raw.image[..., ::-1])
        cv2.imwrite(str(root / f"0/masks/{name}.png"), cv2.merge([raw.mask] * 3))
        cameras[name] = {
            "intrinsics": camera.K.astype(np.float32),
            "extrinsics": extrinsics,
            "distortions": camera.distortion.astype(np.float32),
        }
        matrix = fits.world_from_body[index]
        poses[name] = {
            "Rh": cv2.Rodrigues(matrix[:3, :3])[0].ravel(),
            "Th": matrix[:3, 3],
            "poses": np.concatenate([np.zeros(3), fits.body_pose[index].ravel()]),
            "joints": fits.posed_joints[index],
            "tpose_joints": fits.rest_joints[index],
        }
        world = fits.posed_vertices[index] @ matrix[:3, :3].T + matrix[:3, 3]
        np.save(root / f"new_vertices/{number}.npy", world.astype(np.float32))
    joints = {"joints": source.shape.rest_joints}
    for name, content in (
        ("cameras", cameras),
        ("mesh_infos", poses),
        ("canonical_joints", joints),
    ):
        (root / f"0/{name}.pkl").write_bytes(pickle.dumps(content))


@dataclass(frozen=True)
class ReleasedView:
    """What the released loader gives for one picture."""

    image: Float32
    alpha: Float32
    vertices: Float32


class ReleasedLoader:
    """Samples of the released layout: a target, K supports, and patches of the target."""

    def __init__(self, root: Path, undistort_supports: bool) -> None:
        self._root = root
        self._undistort_supports = undistort_supports
        self._cameras = _read(root / "0/cameras.pkl")
        self._poses = _read(root / "0/mesh_infos.pkl")
        self._names = list(self._cameras)

    def sample(self, rng: np.random.Generator, k: int, patches: int, side: int) -> int:
        """Loads one sample; returns how many rays it has."""
        target, *supports = rng.choice(len(self._names), size=k + 1, replace=False).tolist()
        view = self._view(self._names[target], undistort=True)
        for support in supports:
            self._view(self._names[support], self._undistort_supports)
        return self._patches(self._names[target], view, rng, (patches, side))

    def _view(self, name: str, undistort: bool) -> ReleasedView:
        camera = self._cameras[name]
        image = cv2.cvtColor(_png(self._root / f"0/images/{name}.png"), cv2.COLOR_BGR2RGB)
        mask = _png(self._root / f"0/masks/{name}.png")
        if undistort:
            image = cv2.undistort(image, camera["intrinsics"], camera["distortions"])
            mask = cv2.undistort(mask, camera["intrinsics"], camera["distortions"])
        share = mask.astype(np.float32) / 255
        blended = share * image
        half = {"dsize": None, "fx": 0.5, "fy": 0.5}
        blended = cv2.resize(blended, **half, interpolation=cv2.INTER_LANCZOS4)
        share = cv2.resize(share, **half, interpolation=cv2.INTER_LINEAR)
        vertices = load_npy(self._root / f"new_vertices/{int(name[-6:])}.npy")
        return ReleasedView(blended / 255, share[..., 0], np.asarray(vertices, np.float32))

    def _patches(
        self, name: str, view: ReleasedView, rng: np.random.Generator, form: tuple[int, int]
    ) -> int:
        camera, pose = self._cameras[name], self._poses[name]
        world_from_body = np.eye(4)
        world_from_body[:3, :3] = cv2.Rodrigues(pose["Rh"])[0]
        world_from_body[:3, 3] = pose["Th"]
        K = camera["intrinsics"].astype(np.float64)
        K[:2] *= 0.5
        alpha: UInt8 = (view.alpha * 255).astype(np.uint8)
        box = body_box.body_box(pose["joints"])
        size = (alpha.shape[1], alpha.shape[0])
        scene = PatchScene(alpha, K, camera["extrinsics"] @ world_from_body, box, (0, 0), size)
        drawn = draw_patches(rng, scene, *form)
        return int(np.prod(drawn.shape[:3]))


def _read(path: Path) -> OrderedDict[str, dict[str, np.ndarray]]:
    content = load_pickle(path)
    assert isinstance(content, dict)
    return OrderedDict(content)


def _png(path: Path) -> UInt8:
    return np.asarray(cv2.imread(str(path)), np.uint8)
