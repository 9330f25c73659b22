"""What the preparation's tests share: raw trees made by hand from a tiny body."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.body_model import BodyModel, load_body_model, pose
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_preprocess.free_body import write_tiny_body

UPRIGHT = np.array([-np.pi / 2, 0.0, 0.0])
"""Turns SMPL's y up into ZJU-MoCap's z down."""


@dataclass(frozen=True)
class HandTree:
    """A small ZJU-MoCap tree and the truth that it was made from."""

    root: Path
    body_path: Path
    model: BodyModel
    frames: tuple[int, ...]
    K: np.ndarray
    D: np.ndarray
    R: np.ndarray
    T: np.ndarray
    world_vertices: np.ndarray
    """(F, V, 3) metres."""
    names: tuple[str, ...]


WriteTree = Callable[..., HandTree]


@pytest.fixture(scope="session")
def tiny_body(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An SMPL-format body of 24 boxes."""
    return write_tiny_body(tmp_path_factory.mktemp("body") / "tiny_neutral.npz")


@pytest.fixture
def write_zju(tiny_body: Path) -> WriteTree:
    """Writes a classic tree: write_zju(root, frames=range(4), cameras=3, size=160)."""

    def write(
        root: Path,
        frames: range = range(4),
        cameras: int = 3,
        size: int = 160,
        seed: int = 3,
        names: tuple[str, ...] = (),
    ) -> HandTree:
        model = load_body_model(tiny_body)
        rng = np.random.default_rng(seed)
        names = names or tuple(f"Camera_B{index + 1}" for index in range(cameras))
        rig = [_camera(index, len(names), size, rng) for index in range(len(names))]
        K, D, R, T = (np.stack(part) for part in zip(*rig, strict=True))
        tree = HandTree(root, tiny_body, model, tuple(frames), K, D, R, T, np.zeros(0), names)
        vertices = []
        ims = []
        for number in frames:
            world, old_world, fit = _fit(model, rng)
            vertices.append(world)
            stored: tuple[tuple[str, object], ...] = (
                ("new_params", fit),
                ("new_vertices", world.astype(np.float32)),
                ("params", fit),
                ("vertices", old_world.astype(np.float32)),
            )
            for folder, content in stored:
                (root / folder).mkdir(parents=True, exist_ok=True)
                np.save(root / folder / f"{number}.npy", np.asarray(content), allow_pickle=True)
            ims.append(
                {"ims": [_write_picture(tree, c, number, world, rng) for c in range(len(names))]}
            )
        cams = {
            "K": list(K),
            "D": [d[:, None] for d in D],
            "R": list(R),
            "T": [1000 * t[:, None] for t in T],
        }
        np.save(root / "annots.npy", np.array({"cams": cams, "ims": ims}), allow_pickle=True)
        return HandTree(
            root, tiny_body, model, tuple(frames), K, D, R, T, np.stack(vertices), names
        )

    return write


def _camera(
    index: int, count: int, size: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    turn = 2 * np.pi * index / count
    centre = np.array([3.0 * np.sin(turn), -3.0 * np.cos(turn), -1.8])
    forward = np.array([0.0, 0.0, -0.9]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(np.array([0.0, 0.0, 1.0]), forward)
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    focal = 1.05 * size + rng.uniform(-2, 2)
    middle = size / 2 + rng.uniform(-3, 3, 2)
    K = np.array([[focal, 0, middle[0]], [0, focal * 1.003, middle[1]], [0, 0, 1.0]])
    D = np.array([-0.25, 0.1, 0.001, -0.0005, -0.02])
    return K, D, R, -R @ centre


def _fit(
    model: BodyModel, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    poses = rng.normal(0, 0.15, (24, 3))
    poses[0] = 0
    betas = rng.normal(0, 0.3, 10)
    turn = matrix_from_axis_angle(np.array([0, 0, rng.uniform(-1, 1)]))
    rotation = turn @ matrix_from_axis_angle(UPRIGHT)
    Rh = cv2.Rodrigues(rotation)[0].ravel()
    Th = np.array([0.0, 0.0, -0.95]) + rng.normal(0, 0.05, 3)
    world, old = (
        pose(model, betas, poses, blend).vertices @ rotation.T + Th for blend in (True, False)
    )
    fit = {"poses": poses.reshape(1, 72), "Rh": Rh[None], "Th": Th[None], "shapes": betas[None]}
    return world, old, fit


def _write_picture(
    tree: HandTree, camera: int, number: int, world: np.ndarray, rng: np.random.Generator
) -> str:
    size = round(2 * float(tree.K[camera, 0, 2]) / 10) * 10
    name = f"{tree.names[camera]}/{number:06d}.jpg"
    pixels, _ = cv2.projectPoints(
        world, cv2.Rodrigues(tree.R[camera])[0], tree.T[camera], tree.K[camera], tree.D[camera]
    )
    image = cv2.GaussianBlur(rng.integers(0, 256, (size, size, 3)).astype(np.uint8), (0, 0), 2)
    mask = np.zeros((size, size), np.uint8)
    for box in pixels.reshape(24, 8, 2):
        hull = cv2.convexHull(np.round(box).astype(np.int32))
        cv2.fillConvexPoly(mask, hull, 7)
        cv2.fillConvexPoly(image, hull, rng.integers(0, 256, 3).tolist())
    for folder, content in (("", image), ("mask_cihp/", mask)):
        path = tree.root / f"{folder}{name}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path = path.with_suffix(".png") if folder else path
        cv2.imwrite(str(path), content)
    return name
