"""What the preparation's tests share: raw trees of a tiny body, to be read and to be damaged."""

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
from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_preprocess.aist_tree_writer import AistMotion, AistTreeWriter
from actorsnerf_preprocess.free_body import write_tiny_body
from actorsnerf_preprocess.renderer import Pinhole
from actorsnerf_preprocess.source import SourceCamera
from actorsnerf_preprocess.stage import ring
from actorsnerf_preprocess.synthetic_zju import ZJU_FROM_STAGE
from actorsnerf_preprocess.zju_fits import RawFit
from actorsnerf_preprocess.zju_layouts import LAYOUTS
from actorsnerf_preprocess.zju_tree import Variant
from actorsnerf_preprocess.zju_tree_writer import AnnotatedTreeWriter

UPRIGHT = np.array([-np.pi / 2, 0.0, 0.0])
"""Turns SMPL's y up into ZJU-MoCap's z down."""
DISTORTION = np.array([-0.25, 0.1, 0.001, -0.0005, -0.02])


@dataclass(frozen=True)
class HandTree:
    """A small tree and the truth that it was made from."""

    root: Path
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
        layout = LAYOUTS[variant]
        # One set of masks, so that a damaged one is missed.
        writer = AnnotatedTreeWriter(root, replace(layout, masks=layout.masks[:1]), cameras)
        model = load_body_model(tiny_body)
        seen = _cameras(writer.cameras, ring(cameras, 3.0, 1.8, 1.05 * size, (size, size)))
        fits = {number: _fit(rng) for number in frames}
        writer.write_cameras(seen, frames)
        writer.write_fits(fits, model)
        vertices = []
        for number, fit in fits.items():
            turn = matrix_from_axis_angle(fit.Rh)
            vertices.append(pose(model, fit.betas, fit.pose).vertices @ turn.T + fit.Th)
            for index, camera in enumerate(seen):
                picture, labels = _picture(camera, vertices[-1], rng)
                writer.write_picture(index, number, picture, labels)
        return HandTree(
            root=root,
            names=writer.cameras,
            size=size,
            model=model,
            frames=tuple(frames),
            K=np.stack([camera.K for camera in seen]),
            R=np.stack([camera.R for camera in seen]),
            T=np.stack([camera.T for camera in seen]),
            world_vertices=np.stack(vertices),
        )

    return write


def _cameras(names: tuple[str, ...], around: tuple[Pinhole, ...]) -> tuple[SourceCamera, ...]:
    """Cameras of the y-up stage in ZJU-MoCap's world."""
    turn = ZJU_FROM_STAGE.T
    return tuple(
        SourceCamera(name, index, each.K, DISTORTION, each.R @ turn, each.T, each.size)
        for index, (name, each) in enumerate(zip(names, around, strict=True))
    )


def _fit(rng: np.random.Generator) -> RawFit:
    poses = rng.normal(0, 0.15, (24, 3))
    poses[0] = 0
    turn = matrix_from_axis_angle(np.array([0, 0, rng.uniform(-1, 1)]))
    upright = turn @ matrix_from_axis_angle(UPRIGHT)
    Rh = np.asarray(cv2.Rodrigues(upright)[0], np.float64).ravel()
    Th = np.array([0.0, 0.0, -0.95]) + rng.normal(0, 0.05, 3)
    return RawFit(poses, Rh, Th, rng.normal(0, 0.3, 10), padded=False)


def _picture(camera: SourceCamera, world: Float64, rng: np.random.Generator) -> tuple[UInt8, UInt8]:
    """Boxes before a cloud, and their labels 7."""
    shape = (*camera.size[::-1], 3)
    image = cv2.GaussianBlur(rng.integers(0, 256, shape).astype(np.uint8), (0, 0), 2)
    labels = np.zeros(shape[:2], np.uint8)
    for hull in _hulls(camera, world):
        cv2.fillConvexPoly(labels, hull, 7)
        cv2.fillConvexPoly(image, hull, rng.integers(0, 256, 3).tolist())
    return image.astype(np.uint8), labels


def _hulls(camera: SourceCamera, world: Float64) -> list[Any]:
    """The outlines of the body's boxes, pixels."""
    rotation = cv2.Rodrigues(camera.R)[0]
    pixels, _ = cv2.projectPoints(world, rotation, camera.T, camera.K, camera.distortion)
    return [cv2.convexHull(np.round(box).astype(np.int32)) for box in pixels.reshape(24, 8, 2)]


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
AIST_DISTORTION = np.array([-0.06, 0.0, 0.0, 0.0, 0.0])


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
        model = load_body_model(body)
        posed = [pose(model, np.zeros(10), each) for each in poses]  # the root about the pelvis
        seen = [
            SourceCamera(f"c{i + 1:02d}", i, each.K, AIST_DISTORTION, each.R, each.T, size)
            for i, each in enumerate(ring(cameras, 4.5, 1.4, 1.5 * size[1], size))
        ]
        tree = HandAist(
            root=home / "aist",
            name=AIST_NAME,
            body=body,
            names=tuple(camera.name for camera in seen),
            size=size,
            scaling=AIST_SCALING,
            centres=np.stack([-camera.R.T @ camera.T for camera in seen]),
            world_vertices=np.stack([one.vertices for one in posed]) + moved[:, None],
            world_joints=np.stack([one.joints for one in posed]) + moved[:, None],
            masks=home / "masks",
        )
        writer = AistTreeWriter(tree.root)
        writer.write_motion(AIST_NAME, AistMotion(poses, moved, AIST_SCALING))
        writer.write_mapping("setting7_1", [AIST_NAME])
        writer.write_cameras("setting7_1", seen, AIST_SCALING)
        writer.write_ignore_list(["gHO_sFM_cAll_d20_mHO5_ch13"])
        for camera in seen:
            _write_aist_video(writer, tree, camera, rng)
        return tree

    return write


def _write_aist_video(
    writer: AistTreeWriter, tree: HandAist, camera: SourceCamera, rng: np.random.Generator
) -> None:
    name = tree.name.replace("cAll", camera.name)
    (tree.masks / name).mkdir(parents=True)
    width, height = tree.size
    stage = rng.integers(60, 160, (height // 4 + 1, width // 4 + 1, 3)).astype(np.uint8)
    stage = np.repeat(np.repeat(stage, 4, axis=0), 4, axis=1)[:height, :width]
    stage = cv2.GaussianBlur(stage, (0, 0), 2).astype(np.uint8)
    video = writer.open_video(name, tree.size)
    for frame, world in enumerate(tree.world_vertices):
        picture, mask = stage.copy(), np.zeros((height, width), np.uint8)
        for hull in _hulls(camera, world):
            cv2.fillConvexPoly(picture, hull, (40, 60, 220))
            cv2.fillConvexPoly(mask, hull, 255)
        video.write(picture)
        cv2.imwrite(str(tree.masks / name / f"{frame:06d}.png"), mask)
    video.release()


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
        video = AistTreeWriter(self.source).open_video(self.video(camera).stem, (width, height))
        for picture in pictures:
            video.write(picture)
        video.release()


@pytest.fixture
def stage(write_aist: WriteAist, tmp_path: Path) -> Stage:
    """A sound tree of 128 x 96 pixels, a male body model, given masks, and room for an output."""
    return Stage(tmp_path, write_aist(tmp_path, size=(128, 96)))
