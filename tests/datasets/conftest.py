"""A small body and a small sequence that pass every check."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from actorsnerf_datasets import body_model, conventions, skeleton
from actorsnerf_datasets.body_model import BodyModel
from actorsnerf_datasets.cameras import camera_from_world, cropped_intrinsics, project
from actorsnerf_datasets.protocols import generic_protocol, with_automatic_lists
from actorsnerf_datasets.types import (
    ActorShape,
    BodyFits,
    Camera,
    Picture,
    Provenance,
    SequenceHeader,
)
from actorsnerf_datasets.writer import StoredPicture, encode_picture, write_sequence

CROP_SIZE = (48, 64)
VERTICES_PER_BONE = 10

REST_JOINTS = np.array(
    [
        *([0.0, -0.2, 0.0], [0.1, -0.3, 0.0], [-0.1, -0.3, 0.0], [0.0, -0.1, 0.0]),
        *([0.1, -0.7, 0.0], [-0.1, -0.7, 0.0], [0.0, 0.05, 0.0], [0.1, -1.1, 0.0]),
        *([-0.1, -1.1, 0.0], [0.0, 0.15, 0.0], [0.1, -1.15, 0.1], [-0.1, -1.15, 0.1]),
        *([0.0, 0.35, 0.0], [0.1, 0.3, 0.0], [-0.1, 0.3, 0.0], [0.0, 0.5, 0.0]),
        *([0.2, 0.3, 0.0], [-0.2, 0.3, 0.0], [0.45, 0.3, 0.0], [-0.45, 0.3, 0.0]),
        *([0.7, 0.3, 0.0], [-0.7, 0.3, 0.0], [0.8, 0.3, 0.0], [-0.8, 0.3, 0.0]),
    ]
)
"""A person of 1.7 m with stretched arms."""


@pytest.fixture(scope="session")
def body() -> BodyModel:
    """A person made of ten points around each bone, with shape and pose blend shapes."""
    rng = np.random.default_rng(7)
    count = VERTICES_PER_BONE
    bones = np.repeat(np.arange(24), count)
    template = REST_JOINTS[bones] + rng.normal(size=(len(bones), 3)) * 0.03
    regressor = np.zeros((24, len(bones)))
    regressor[bones, np.arange(len(bones))] = 1 / count
    weights = rng.random((len(bones), 24)) * 0.01
    weights[np.arange(len(bones)), bones] = 1.0
    return BodyModel(
        template=template,
        shape_directions=rng.normal(size=(len(bones), 3, 10)) * 0.003,
        pose_directions=rng.normal(size=(len(bones), 3, 207)) * 0.001,
        joint_regressor=regressor,
        weights=weights / weights.sum(axis=1, keepdims=True),
        faces=np.arange(len(bones), dtype=np.int64).reshape(-1, 3),
        digest="0" * 64,
    )


@pytest.fixture
def body_file(body: BodyModel, tmp_path: Path) -> Path:
    """The same body as a file."""
    parents = np.array([skeleton.PARENTS, range(24)], dtype=np.int64)
    path = tmp_path / "body.npz"
    np.savez(
        path,
        v_template=body.template,
        shapedirs=body.shape_directions,
        posedirs=body.pose_directions,
        J_regressor=body.joint_regressor,
        weights=body.weights,
        kintree_table=parents,
        f=body.faces,
    )
    return path


def _camera(index: int, angle: float) -> Camera:
    forward = np.array([-np.sin(angle), 0.0, -np.cos(angle)])
    down = np.array([0.0, -1.0, 0.0])
    R = np.stack([np.cross(down, forward), down, forward])
    K = np.array([[60.0, 0.0, 39.5], [0.0, 60.0, 39.5], [0.0, 0.0, 1.0]])
    return Camera(
        name=f"c{index + 1:02d}",
        source_index=index,
        K=K,
        R=R,
        T=-R @ (-3.0 * forward),
        size=(80, 80),
        source_K=np.array([[120.0, 0.0, 79.5], [0.0, 120.0, 79.5], [0.0, 0.0, 1.0]]),
        source_distortion=np.zeros(5),
        source_size=(160, 160),
    )


def _fits(body: BodyModel, count: int) -> BodyFits:
    rng = np.random.default_rng(11)
    pose = np.concatenate([np.zeros((count, 1, 3)), rng.normal(size=(count, 23, 3)) * 0.2], axis=1)
    orient = np.stack([np.array([0.0, 0.3 * frame, 0.0]) for frame in range(count)])
    transl = rng.normal(size=(count, 3)) * 0.05
    betas = np.tile(rng.normal(size=10), (count, 1))
    posed = [body_model.pose(body, *pair) for pair in zip(betas, pose, strict=True)]
    rest_joints = np.stack([one.rest_joints for one in posed])
    return BodyFits(
        global_orient=orient,
        transl=transl,
        body_pose=pose[:, 1:],
        betas=betas,
        world_from_body=conventions.world_from_body(orient, transl, rest_joints[:, 0]),
        rest_joints=rest_joints,
        posed_joints=np.stack([one.joints for one in posed]),
        posed_vertices=np.stack([one.vertices for one in posed]).astype(np.float32),
    )


@pytest.fixture(scope="session")
def header(body: BodyModel) -> SequenceHeader:
    """Three cameras, twelve frames, a held-out actor of the generic protocol."""
    cameras = tuple(_camera(index, angle) for index, angle in enumerate((0.0, 1.5, 3.5)))
    frames = np.arange(100, 112, dtype=np.int64)
    fits = _fits(body, len(frames))
    rest_joints, rest_vertices = body_model.rest(body, fits.betas[0])
    protocol = generic_protocol("held_out", [camera.name for camera in cameras], frames)
    return SequenceHeader(
        sequence="dance-01",
        actor="anna",
        world_up=np.array([0.0, 1.0, 0.0]),
        cameras=cameras,
        frames=frames,
        fits=fits,
        shape=ActorShape(fits.betas[0], rest_joints, rest_vertices.astype(np.float32)),
        protocols=(with_automatic_lists(protocol, frames, fits, cameras[0]),),
        provenance=Provenance(
            dataset="synthetic",
            variant="test",
            body_model="points",
            scale=0.5,
            background="dropped",
            mask_source="drawn",
            source_terms="free",
            notes=("a decision", "another: über"),
            source_digests=(("a/b.jpg", "0" * 64),),
        ),
    )


_DISC = [(x, y) for x in range(-3, 4) for y in range(-3, 4) if x * x + y * y < 9]


@pytest.fixture(scope="session")
def picture_of(header: SequenceHeader) -> Callable[[int, int], Picture]:
    """Draws the crop of a camera and a frame: discs where the vertices project."""

    def draw(camera_index: int, frame_index: int) -> Picture:
        camera, width, height = header.cameras[camera_index], *CROP_SIZE
        camera_from_body = camera_from_world(camera.R, camera.T)
        camera_from_body = camera_from_body @ header.fits.world_from_body[frame_index]
        points = header.fits.posed_vertices[frame_index].astype(np.float64)
        pixels = project(points, camera.K, camera_from_body).pixels
        centre = np.rint((pixels.min(axis=0) + pixels.max(axis=0)) / 2)
        offset = (int(centre[0]) - width // 2, int(centre[1]) - height // 2)
        pixels = project(points, cropped_intrinsics(camera.K, offset), camera_from_body).pixels
        near = np.zeros((height, width), np.bool_)
        for x, y in _DISC:
            column, row = np.rint(pixels + np.array((x, y))).astype(int).T
            near[row.clip(0, height - 1), column.clip(0, width - 1)] = True
        rng = np.random.default_rng(camera_index * 1000 + frame_index)
        rgb = rng.integers(0, 256, size=(height, width, 3), dtype=np.uint8)
        return Picture(rgb, (near * 255).astype(np.uint8), offset)

    return draw


@pytest.fixture(scope="session")
def stored_pictures(
    header: SequenceHeader, picture_of: Callable[[int, int], Picture]
) -> Callable[[], Iterator[StoredPicture]]:
    """All (camera, frame) pairs but the last frame of the last camera."""

    def pictures() -> Iterator[StoredPicture]:
        for camera in range(len(header.cameras)):
            for frame in range(len(header.frames) - (camera == 2)):
                picture = picture_of(camera, frame)
                rgb, alpha = encode_picture(picture)
                yield StoredPicture(camera, frame, picture.offset, rgb, alpha)

    return pictures


@pytest.fixture(scope="session")
def _sequence_once(
    header: SequenceHeader,
    stored_pictures: Callable[[], Iterator[StoredPicture]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    path = tmp_path_factory.mktemp("sequence") / "anna.h5"
    write_sequence(path, header, CROP_SIZE, stored_pictures())
    return path


@pytest.fixture
def sequence_path(_sequence_once: Path, tmp_path: Path) -> Path:
    """A prepared sequence that is right in every respect; a copy that a test may damage."""
    return Path(shutil.copy(_sequence_once, tmp_path / "anna.h5"))
