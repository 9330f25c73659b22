"""What the preparation's tests share: raw ZJU-MoCap trees, by hand from a tiny body and drawn."""

import json
import os
import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.body_model import BodyModel, load_body_model, pose
from actorsnerf_datasets.pickles import load_npy
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.free_body import write_tiny_body
from actorsnerf_preprocess.synthetic import SyntheticOptions, write_zju_tree
from actorsnerf_preprocess.zju_tree import Variant

UPRIGHT = np.array([-np.pi / 2, 0.0, 0.0])
"""Turns SMPL's y up into ZJU-MoCap's z down."""
DISTORTION = np.array([-0.25, 0.1, 0.001, -0.0005, -0.02])
OLD_AND_NEW = ("new_params", "new_vertices", "params", "vertices")
FIT_FOLDERS = {"refined": ("smpl_params", "smpl_vertices"), "easymocap": ("params", "vertices")}


@dataclass(frozen=True)
class HandTree:
    """A small tree and the truth that it was made from."""

    root: Path
    variant: Variant
    names: tuple[str, ...]
    size: int
    model: BodyModel
    frames: tuple[int, ...]
    K: Float64
    R: Float64
    T: Float64
    """Metres."""
    world_vertices: Float64
    """(F, V, 3) metres, with pose blend shapes."""


WriteTree = Callable[..., HandTree]


@pytest.fixture(scope="session")
def tiny_body(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An SMPL-format body of 24 boxes."""
    return write_tiny_body(tmp_path_factory.mktemp("body") / "tiny_neutral.npz")


@pytest.fixture(scope="session")
def synthetic_zju(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A raw ZJU-MoCap tree of two synthetic actors, drawn: 3 cameras, 12 frames, 128 pixels."""
    root = tmp_path_factory.mktemp("synthetic") / "zju"
    options = SyntheticOptions(
        actors=1, held_out=1, frames=12, cameras=3, size=128, texture=256, full=False
    )
    write_zju_tree(root, options)
    return root


@pytest.fixture
def write_zju(tiny_body: Path) -> WriteTree:
    """Writes a tree into a folder; by default 3 cameras, frames 0 to 3, 160 x 160 pixels."""

    def write(
        root: Path,
        variant: Variant = "classic-23",
        frames: range = range(4),
        cameras: int = 3,
        size: int = 160,
    ) -> HandTree:
        rng = np.random.default_rng(3)
        names = tuple(_camera_name(variant, index) for index in range(cameras))
        K, R, T = (
            np.stack(part)
            for part in zip(*(_camera(i, cameras, size, rng) for i in range(cameras)), strict=True)
        )
        model = load_body_model(tiny_body)
        tree = HandTree(root, variant, names, size, model, tuple(frames), K, R, T, np.zeros(0))
        vertices, ims = [], []
        for number in frames:
            world = _write_fit(tree, number, rng)
            vertices.append(world)
            ims.append(
                {"ims": [_write_picture(tree, c, number, world, rng) for c in range(cameras)]}
            )
        lens = DISTORTION[:, None]
        cams = {
            "K": [k.tolist() for k in K] if "21" in variant else list(K),
            "D": [lens.tolist() if "21" in variant else lens for _ in names],
            "R": [r.tolist() for r in R] if "21" in variant else list(R),
            "T": [
                (1000 * t[:, None]).tolist() if "21" in variant else 1000 * t[:, None] for t in T
            ],
        }
        _save(root / "annots.npy", {"cams": cams, "ims": ims})
        return replace(tree, world_vertices=np.stack(vertices))

    return write


def _save(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, np.asarray(content), allow_pickle=True)


def _camera_name(variant: Variant, index: int) -> str:
    match variant:
        case "classic-23":
            return f"Camera_B{index + 1}"
        case "classic-21" | "renamed-21":
            return f"Camera ({index + 1})"
        case _:
            return f"{index:02d}"


def _listed_name(variant: Variant, camera: str, number: int) -> str:
    match variant:
        case "classic-23":
            return f"{camera}/{number:06d}.jpg"
        case "classic-21" | "renamed-21":
            stamp = f"2019-08-23_16-08-{number % 60:02d}.59{camera[-2]}"
            return f"{camera}/CoreView_313_{camera.replace(' ', '_')}_{number:04d}_{stamp}.jpg"
        case "refined":
            return f"images/{camera}/{number:06d}.jpg"
        case _:
            return f"images/{camera}/{number:05d}.jpg"


def _camera(
    index: int, count: int, size: int, rng: np.random.Generator
) -> tuple[Float64, Float64, Float64]:
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
    return K, R, -R @ centre


def _write_fit(tree: HandTree, number: int, rng: np.random.Generator) -> Float64:
    """Writes the fits of a frame; returns its vertices in the world."""
    poses = rng.normal(0, 0.15, (24, 3))
    poses[0] = 0
    betas = rng.normal(0, 0.3, 10)
    turn = matrix_from_axis_angle(np.array([0, 0, rng.uniform(-1, 1)]))
    rotation = turn @ matrix_from_axis_angle(UPRIGHT)
    Rh = cv2.Rodrigues(rotation)[0].ravel()
    Th = np.array([0.0, 0.0, -0.95]) + rng.normal(0, 0.05, 3)
    world, old = (
        pose(tree.model, betas, poses, blend).vertices @ rotation.T + Th for blend in (True, False)
    )
    listed = poses.ravel()[3:] if tree.variant == "easymocap" else poses.ravel()
    fit = {"poses": listed[None], "Rh": Rh[None], "Th": Th[None], "shapes": betas[None]}
    folders = FIT_FOLDERS.get(tree.variant, OLD_AND_NEW)
    contents = (fit, world.astype(np.float32), fit, old.astype(np.float32))
    for folder, content in zip(folders, contents, strict=False):
        _save(tree.root / folder / f"{number}.npy", content)
    return world


def _write_picture(
    tree: HandTree, camera: int, number: int, world: Float64, rng: np.random.Generator
) -> str:
    """Writes a picture and its mask (labels 7); returns the name that annots.npy lists."""
    listed = _listed_name(tree.variant, tree.names[camera], number)
    name = listed
    if tree.variant == "renamed-21":
        name = f"{tree.names[camera]}/{number:04d}.jpg"
    pixels, _ = cv2.projectPoints(
        world, cv2.Rodrigues(tree.R[camera])[0], tree.T[camera], tree.K[camera], DISTORTION
    )
    shape = (tree.size, tree.size, 3)
    image = cv2.GaussianBlur(rng.integers(0, 256, shape).astype(np.uint8), (0, 0), 2)
    mask = np.zeros(shape[:2], np.uint8)
    for box in pixels.reshape(24, 8, 2):
        hull = cv2.convexHull(np.round(box).astype(np.int32))
        cv2.fillConvexPoly(mask, hull, 7)
        cv2.fillConvexPoly(image, hull, rng.integers(0, 256, 3).tolist())
    inner = name.removeprefix("images/") if tree.variant == "refined" else name
    folder = "mask" if tree.variant == "refined" else "mask_cihp"
    for path, content in (
        (tree.root / name, image),
        ((tree.root / folder / inner).with_suffix(".png"), mask),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), content)
    return listed


class Hostile:
    """Its pickle makes a folder when it is loaded without care."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str]]:
        return os.mkdir, (str(self.marker),)


@dataclass(frozen=True)
class Site:
    """A folder with a sound raw tree, to be damaged."""

    home: Path

    @property
    def out(self) -> Path:
        return self.home / "out"

    @property
    def marker(self) -> Path:
        """What a hostile pickle would make."""
        return self.home / "executed"

    def hostile(self, path: Path) -> None:
        """Puts a pickle there that makes `marker` when it is executed."""
        path.write_bytes(pickle.dumps(Hostile(self.marker)))

    @staticmethod
    def cut(path: Path) -> None:
        """Leaves the first half of a file."""
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2])


@dataclass(frozen=True)
class Scene(Site):
    """A sound ZJU-MoCap tree of 4 frames and 3 cameras in a folder of its own, to be damaged."""

    @property
    def source(self) -> Path:
        return self.home / "raw"

    @property
    def tree(self) -> Path:
        return self.source / "CoreView_377"

    @property
    def body(self) -> Path:
        return self.home / "tiny_neutral.npz"

    def picture(self, camera: int, frame: int) -> Path:
        return self.tree / f"Camera_B{camera + 1}" / f"{frame:06d}.jpg"

    def mask(self, camera: int, frame: int) -> Path:
        return self.tree / "mask_cihp" / f"Camera_B{camera + 1}" / f"{frame:06d}.png"

    def masks(self) -> list[Path]:
        return sorted((self.tree / "mask_cihp").rglob("*.png"))

    def fit(self, frame: int) -> Path:
        return self.tree / "new_params" / f"{frame}.npy"

    def vertices(self, frame: int) -> Path:
        return self.tree / "new_vertices" / f"{frame}.npy"

    def edit_annotations(self, change: Callable[[dict[str, Any]], object]) -> None:
        self._edit(self.tree / "annots.npy", change)

    def edit_camera(self, key: str, change: Callable[[Float64, int], Float64]) -> None:
        """Changes one entry of every camera: (array, index) to array."""

        def every(content: dict[str, Any]) -> None:
            values = [np.asarray(value) for value in content["cams"][key]]
            content["cams"][key] = [change(value, index) for index, value in enumerate(values)]

        self.edit_annotations(every)

    def edit_fit(self, frame: int, change: Callable[[dict[str, Any]], object]) -> None:
        self._edit(self.fit(frame), change)

    def edit_body(self, change: Callable[[dict[str, Any]], object]) -> None:
        with np.load(self.body) as arrays:
            content = dict(arrays)
        change(content)
        np.savez(self.body, **content)

    @staticmethod
    def fill(path: Path, level: int, size: tuple[int, int] = (160, 160)) -> None:
        """Puts a picture of one grey there, width and height as given."""
        cv2.imwrite(str(path), np.full(size[::-1], level, np.uint8))

    @staticmethod
    def in_place_of_a_file(path: Path) -> None:
        """Puts a folder there: what cannot be read, even by the superuser."""
        path.unlink()
        path.mkdir()

    @staticmethod
    def _edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
        content = load_npy(path)
        assert isinstance(content, dict)
        change(content)
        np.save(path, np.asarray(content))


@pytest.fixture
def scene(tmp_path: Path, write_zju: WriteTree, tiny_body: Path) -> Scene:
    """A sound tree, a body model and room for an output folder."""
    made = Scene(tmp_path)
    write_zju(made.tree)
    made.body.write_bytes(tiny_body.read_bytes())
    return made


AIST_NAME = "gBR_sFM_cAll_d31_mBR0_ch01"
AIST_SCALING = 93.0
AIST_DISTORTION = [-0.06, 0.0, 0.0, 0.0, 0.0]


@dataclass(frozen=True)
class HandAist:
    """A small AIST++ tree and the truth that it was made from."""

    root: Path
    name: str
    body: Path
    names: tuple[str, ...]
    size: tuple[int, int]
    scaling: float
    centres: Float64
    """(C, 3) where the cameras stand, metres of the body."""
    world_vertices: Float64
    """(F, V, 3) metres of the body."""
    world_joints: Float64
    """(F, 24, 3)."""
    masks: Path
    """One folder per video, outside the tree."""


WriteAist = Callable[..., HandAist]


@pytest.fixture
def write_aist(tiny_body: Path) -> WriteAist:
    """Writes annotations and videos; by default 3 views and 8 frames of 192 x 108 pixels."""

    def write(
        home: Path, cameras: int = 3, frames: int = 8, size: tuple[int, int] = (192, 108)
    ) -> HandAist:
        rng = np.random.default_rng(5)
        body = home / "tiny_male.npz"
        home.mkdir(parents=True, exist_ok=True)
        body.write_bytes(tiny_body.read_bytes())
        poses = np.cumsum(rng.normal(0, 0.03, (frames, 24, 3)), axis=0)
        poses[:, 0, 0] += 1.2
        turn = np.linspace(0, 2 * np.pi, frames, endpoint=False)
        moved = np.stack([0.9 * np.sin(turn), 1.1 + 0 * turn, 0.9 * np.cos(turn)], axis=1)
        posed = [
            pose(load_body_model(body), np.zeros(10), np.vstack([np.zeros((1, 3)), each[1:]]))
            for each in poses
        ]
        turned = matrix_from_axis_angle(poses[:, 0])
        vertices, joints = (
            np.stack(
                [
                    (points - one.rest_joints[0]) @ R.T + one.rest_joints[0] + shift
                    for points, one, R, shift in zip(clouds, posed, turned, moved, strict=True)
                ]
            )
            for clouds in ([one.vertices for one in posed], [one.joints for one in posed])
        )
        entries = [_aist_camera(index, cameras, size) for index in range(cameras)]
        names = tuple(str(entry["name"]) for entry in entries)
        centres = np.stack([entry.pop("centre") for entry in entries])
        tree = HandAist(
            home / "aist",
            AIST_NAME,
            body,
            names,
            size,
            AIST_SCALING,
            centres,
            vertices,
            joints,
            masks=home / "masks",
        )
        _write_aist_annotations(tree, poses, moved, entries)
        for entry in entries:
            _write_aist_video(tree, entry, rng)
        return tree

    return write


def _aist_camera(index: int, count: int, size: tuple[int, int]) -> dict[str, Any]:
    turn = 2 * np.pi * index / count
    centre = np.array([4.5 * np.sin(turn), 1.4, 4.5 * np.cos(turn)])
    forward = np.array([0.0, 0.9, 0.0]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    focal = 1.5 * size[1]
    return {
        "name": f"c{index + 1:02d}",
        "size": list(size),
        "matrix": [[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]],
        "rotation": cv2.Rodrigues(R)[0].ravel().tolist(),
        "translation": (-R @ centre * AIST_SCALING).tolist(),
        "distortions": AIST_DISTORTION,
        "centre": centre,
    }


def _write_aist_annotations(
    tree: HandAist, poses: Float64, moved: Float64, entries: list[dict[str, Any]]
) -> None:
    annotations = tree.root / "annotations"
    for folder in ("cameras", "motions"):
        (annotations / folder).mkdir(parents=True)
    motion = {
        "smpl_poses": poses.reshape(len(poses), 72),
        "smpl_scaling": np.array([tree.scaling]),
        "smpl_trans": tree.scaling * moved,
        "smpl_loss": 1.0,
    }
    (annotations / "motions" / f"{tree.name}.pkl").write_bytes(pickle.dumps(motion))
    (annotations / "cameras" / "mapping.txt").write_text(f"{tree.name} setting7_1\n")
    (annotations / "cameras" / "setting7_1.json").write_text(json.dumps(entries))
    (annotations / "ignore_list.txt").write_text("gHO_sFM_cAll_d20_mHO5_ch13 \n\n")


def _write_aist_video(tree: HandAist, entry: dict[str, Any], rng: np.random.Generator) -> None:
    name = tree.name.replace("cAll", entry["name"])
    for folder in (tree.root / "videos", tree.masks / name):
        folder.mkdir(parents=True, exist_ok=True)
    width, height = tree.size
    stage = rng.integers(60, 160, (height // 4 + 1, width // 4 + 1, 3)).astype(np.uint8)
    stage = np.repeat(np.repeat(stage, 4, axis=0), 4, axis=1)[:height, :width]
    stage = cv2.GaussianBlur(stage, (0, 0), 2).astype(np.uint8)
    writer = cv2.VideoWriter(
        str(tree.root / "videos" / f"{name}.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 60.0, tree.size
    )
    for frame, world in enumerate(tree.world_vertices):
        pixels, _ = cv2.projectPoints(
            world,
            np.array(entry["rotation"]),
            np.array(entry["translation"]) / tree.scaling,
            np.array(entry["matrix"]),
            np.array(entry["distortions"]),
        )
        picture, mask = stage.copy(), np.zeros((height, width), np.uint8)
        for box in pixels.reshape(24, 8, 2):
            hull = cv2.convexHull(np.round(box).astype(np.int32))
            cv2.fillConvexPoly(picture, hull, (40, 60, 220))
            cv2.fillConvexPoly(mask, hull, 255)
        writer.write(picture)
        cv2.imwrite(str(tree.masks / name / f"{frame:06d}.png"), mask)
    writer.release()


@pytest.fixture
def aist(write_aist: WriteAist, tmp_path: Path) -> HandAist:
    """A sound AIST++ tree in a folder of its own."""
    return write_aist(tmp_path)


@dataclass(frozen=True)
class Stage(Site):
    """A sound AIST++ tree of 8 frames and 3 cameras in a folder of its own, to be damaged."""

    tree: HandAist

    @property
    def source(self) -> Path:
        return self.tree.root

    @property
    def body(self) -> Path:
        return next(self.home.glob("tiny_*.npz"), self.tree.body)

    @property
    def motion(self) -> Path:
        return self.source / "annotations" / "motions" / f"{self.tree.name}.pkl"

    @property
    def mapping(self) -> Path:
        return self.source / "annotations" / "cameras" / "mapping.txt"

    @property
    def setting(self) -> Path:
        return self.mapping.with_name("setting7_1.json")

    @property
    def ignore_list(self) -> Path:
        return self.source / "annotations" / "ignore_list.txt"

    def video(self, camera: str) -> Path:
        return self.source / "videos" / f"{self.tree.name.replace('cAll', camera)}.mp4"

    def mask(self, camera: str, frame: int) -> Path:
        return self.tree.masks / self.tree.name.replace("cAll", camera) / f"{frame:06d}.png"

    def edit_motion(self, change: Callable[[dict[str, Any]], object]) -> None:
        content = pickle.loads(self.motion.read_bytes())
        change(content)
        self.motion.write_bytes(pickle.dumps(content))

    def edit_camera(self, change: Callable[[dict[str, Any]], object]) -> None:
        """Changes the second camera."""
        content = json.loads(self.setting.read_text())
        change(content[1])
        self.setting.write_text(json.dumps(content))

    def write_video(self, camera: str, pictures: list[Any]) -> None:
        """Puts a video of the given pictures in place of a camera's."""
        height, width = pictures[0].shape[:2]
        code = cv2.VideoWriter.fourcc(*"mp4v")
        writer = cv2.VideoWriter(str(self.video(camera)), code, 60.0, (width, height))
        for picture in pictures:
            writer.write(picture)
        writer.release()


@pytest.fixture
def stage(write_aist: WriteAist, tmp_path: Path) -> Stage:
    """A sound tree of 128 x 96 pixels, a male body model, given masks, and room for an output."""
    return Stage(tmp_path, write_aist(tmp_path, size=(128, 96)))
