"""Three small invented people in prepared files, and short trainings on them."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from actorsnerf_datasets import body_model, conventions, skeleton
from actorsnerf_datasets.body_model import BodyModel
from actorsnerf_datasets.cameras import camera_from_world, cropped_intrinsics, project
from actorsnerf_datasets.protocols import generic_protocol, with_automatic_lists
from actorsnerf_datasets.torch_dataset import PretrainingDataset
from actorsnerf_datasets.types import (
    ActorShape,
    BodyFits,
    Camera,
    Picture,
    Provenance,
    Role,
    SequenceHeader,
)
from actorsnerf_datasets.writer import StoredPicture, encode_picture, write_sequence
from actorsnerf_train.checkpoint import DataFile, Origin, load_checkpoint
from actorsnerf_train.config import Every, Patches, TrainConfig, fewshot, pretraining
from actorsnerf_train.fewshot import FewshotOptions, run_fewshot
from actorsnerf_train.loop import Training
from actorsnerf_train.losses import Perceptual
from actorsnerf_train.methods import build_method
from actorsnerf_train.options import Changes, Resources
from actorsnerf_train.pretrain import PretrainOptions, run_pretrain
from actorsnerf_train.records import to_json_object
from actorsnerf_train.result import Evaluation
from actorsnerf_train.run_folder import RunFolder
from actorsnerf_train.stability.bench import Bench, make_bench

CROP_SIZE = (48, 64)
FRAMES = 20
CAMERAS = 2
SPHERES_PER_BONE = 12
SPHERE = 0.06
"""Metres."""

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


def _body(rng: np.random.Generator) -> BodyModel:
    """Points along the bone that leads to each joint; each follows the bone's upper joint."""
    upper = [max(parent, 0) for parent in skeleton.PARENTS]
    shares = np.linspace(0, 1, SPHERES_PER_BONE)[None, :, None]
    along = REST_JOINTS[upper][:, None] * (1 - shares) + REST_JOINTS[:, None] * shares
    template = along.reshape(-1, 3) + rng.normal(size=(24 * SPHERES_PER_BONE, 3)) * 0.01
    regressor = np.zeros((24, len(template)))
    regressor[np.arange(24), np.arange(24) * SPHERES_PER_BONE + SPHERES_PER_BONE - 1] = 1
    weights = np.zeros((len(template), 24))
    weights[np.arange(len(template)), np.repeat(upper, SPHERES_PER_BONE)] = 1
    return BodyModel(
        template=template,
        shape_directions=rng.normal(size=(len(template), 3, 10)) * 0.002,
        pose_directions=np.zeros((len(template), 3, 207)),
        joint_regressor=regressor,
        weights=weights,
        faces=np.arange(len(template), dtype=np.int64).reshape(-1, 3),
        digest="0" * 64,
    )


def _camera(index: int) -> Camera:
    angle = 1.1 * index
    forward = np.array([-np.sin(angle), 0.0, -np.cos(angle)])
    down = np.array([0.0, -1.0, 0.0])
    R = np.stack([np.cross(down, forward), down, forward])
    K = np.array([[80.0, 0.0, 39.5], [0.0, 80.0, 39.5], [0.0, 0.0, 1.0]])
    return Camera(
        name=f"camera{index}",
        source_index=index,
        K=K,
        R=R,
        T=-R @ (-3.0 * forward),
        size=(80, 80),
        source_K=K,
        source_distortion=np.zeros(5),
        source_size=(80, 80),
    )


def _fits(body: BodyModel, rng: np.random.Generator) -> BodyFits:
    pose = np.concatenate([np.zeros((FRAMES, 1, 3)), rng.normal(size=(FRAMES, 23, 3)) * 0.2], 1)
    orient = np.stack([np.array([0.0, 0.3 * frame, 0.0]) for frame in range(FRAMES)])
    transl = rng.normal(size=(FRAMES, 3)) * 0.05
    betas = np.tile(rng.normal(size=10), (FRAMES, 1))
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


def _picture(header: SequenceHeader, camera: Camera, frame: int, colours: np.ndarray) -> Picture:
    """Every vertex as a coloured ball, near before far."""
    width, height = CROP_SIZE
    view = camera_from_world(camera.R, camera.T) @ header.fits.world_from_body[frame]
    points = header.fits.posed_vertices[frame].astype(np.float64)
    seen = project(points, camera.K, view).pixels
    centre = np.rint((seen.min(axis=0) + seen.max(axis=0)) / 2)
    offset = (int(centre[0]) - width // 2, int(centre[1]) - height // 2)
    pixels = project(points, cropped_intrinsics(camera.K, offset), view).pixels
    depth = points @ view[2, :3] + view[2, 3]
    y, x = np.mgrid[:height, :width]
    rgb = np.zeros((height, width, 3), np.uint8)
    alpha = np.zeros((height, width), np.uint8)
    for i in np.argsort(-depth):
        inside = np.hypot(x - pixels[i, 0], y - pixels[i, 1]) < SPHERE * camera.K[0, 0] / depth[i]
        rgb[inside], alpha[inside] = colours[i // SPHERES_PER_BONE], 255
    return Picture(rgb, alpha, offset)


def write_person(path: Path, actor: str, role: Role, seed: int) -> Path:
    """The prepared file of an invented person whose bones have colours of their own."""
    rng = np.random.default_rng(seed)
    body = _body(rng)
    cameras = tuple(_camera(index) for index in range(CAMERAS))
    frames = np.arange(FRAMES, dtype=np.int64) * 2
    fits = _fits(body, rng)
    rest_joints, rest_vertices = body_model.rest(body, fits.betas[0])
    protocol = generic_protocol(role, [camera.name for camera in cameras], frames)
    header = SequenceHeader(
        sequence=f"{actor}-walks",
        actor=actor,
        world_up=np.array([0.0, 1.0, 0.0]),
        cameras=cameras,
        frames=frames,
        fits=fits,
        shape=ActorShape(fits.betas[0], rest_joints, rest_vertices.astype(np.float32)),
        protocols=(with_automatic_lists(protocol, frames, fits, cameras[0]),),
        provenance=Provenance(
            dataset="synthetic",
            variant="balls",
            body_model="balls",
            scale=1.0,
            background="dropped",
            mask_source="drawn",
            source_terms="free",
            notes=(),
            source_digests=(("drawn", "0" * 64),),
        ),
    )
    colours = rng.integers(40, 256, size=(24, 3), dtype=np.uint8)
    pictures = (
        (c, f, _picture(header, camera, f, colours))
        for c, camera in enumerate(cameras)
        for f in range(FRAMES)
    )
    stored = (StoredPicture(c, f, p.offset, *encode_picture(p)) for c, f, p in pictures)
    write_sequence(path, header, CROP_SIZE, stored)
    return path


@dataclass(frozen=True)
class People:
    """Prepared files: two people to pre-train on, one held out."""

    folder: Path
    ann: Path
    ben: Path
    eve: Path


@pytest.fixture(scope="session")
def people(tmp_path_factory: pytest.TempPathFactory) -> People:
    folder = tmp_path_factory.mktemp("people")
    return People(
        folder,
        write_person(folder / "ann.h5", "ann", "pretraining", 1),
        write_person(folder / "ben.h5", "ben", "pretraining", 2),
        write_person(folder / "eve.h5", "eve", "held_out", 3),
    )


@pytest.fixture(scope="session")
def known_eve(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another file of the held-out person, as one to pre-train on."""
    return write_person(tmp_path_factory.mktemp("known") / "known.h5", "eve", "pretraining", 4)


@pytest.fixture(scope="session")
def quick() -> Changes:
    """Six steps of little work."""
    return Changes(steps=6, samples=12, patches=1, checkpoint_every=3, picture_every=0)


@pytest.fixture(scope="session")
def category_run(people: People, quick: Changes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished category training; read it, do not write it."""
    run = tmp_path_factory.mktemp("runs") / "category"
    resources = Resources(workers=0, check=False)
    run_pretrain(
        PretrainOptions((people.ann, people.ben), run, "tiny", change=quick, use=resources)
    )
    return run


@pytest.fixture(scope="session")
def neuralbody_run(
    people: People, quick: Changes, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The folder of a finished fitting of Neural Body; read it, do not write it."""
    run = tmp_path_factory.mktemp("runs") / "neuralbody"
    resources = Resources(workers=0, check=False)
    options = FewshotOptions(people.eve, run, "scratch", "fewshot-5", change=quick, use=resources)
    run_fewshot(replace(options, method="neuralbody", preset="tiny"))
    return run


@pytest.fixture(scope="session")
def fewshot_run(
    people: People, quick: Changes, category_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The folder of a finished few-shot fitting; read it, do not write it."""
    run = tmp_path_factory.mktemp("runs") / "fewshot"
    resources = Resources(workers=0, check=False)
    torch.manual_seed(0)  # checkpoints hold the state, which tests compare
    run_fewshot(
        FewshotOptions(people.eve, run, category_run, "fewshot-5", change=quick, use=resources)
    )
    return run


@pytest.fixture(scope="session")
def bfloat16_run(fewshot_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same weights in a folder whose checkpoints say that they were trained in bfloat16."""
    run = tmp_path_factory.mktemp("runs") / "bfloat16"
    shutil.copytree(fewshot_run, run)
    record = load_checkpoint(run).path.with_suffix(".json")
    told = json.loads(record.read_text())
    told["configuration"]["precision"] = "bfloat16"
    record.write_text(json.dumps(told))
    return run


@pytest.fixture
def config() -> TrainConfig:
    """A training of eight steps with little work in each."""
    tiny = pretraining("tiny")
    return replace(
        tiny,
        schedule=replace(tiny.schedule, steps=8),
        render=replace(tiny.render, samples=12),
        patches=Patches(count=1, side=16),
        perceptual="gradient_pyramid",
        every=Every(log=2, checkpoint=4, picture=0, milestone=0),
    )


@pytest.fixture
def make_training(people: People) -> Callable[[Path, TrainConfig], Training]:
    """Makes trainings on ann and ben in folders of one's choice."""
    files = (people.ann, people.ben)
    data = tuple(DataFile(str(path), path.stem, path.stem, "0" * 64) for path in files)

    def make(run: Path, config: TrainConfig) -> Training:
        drawing = (config.seed, config.model.views, config.patches.count, config.patches.side)
        origin = Origin("resnet18", False, None, None, ())
        return Training(
            folder=RunFolder(run, config, data, None, origin),
            method=build_method(config, torch.device("cpu")),
            source=PretrainingDataset(files, *drawing, config.schedule.steps),
            perceptual=Perceptual(None),
            device=torch.device("cpu"),
        )

    return make


@pytest.fixture(scope="session")
def bench() -> Bench:
    """An untrained tiny method on an invented actor, in three precisions."""
    return make_bench(None, None, "tiny", torch.device("cpu"))


@pytest.fixture
def evaluation() -> Evaluation:
    """Invented; without means, per_camera and per_image."""
    return Evaluation(
        method="actorsnerf",
        preset="small",
        actor="eve",
        sequence="eve-walks",
        dataset="synthetic",
        data_sha256="",
        protocol="generic",
        setting="fewshot-5",
        list_name="official",
        shots=5,
        supports=3,
        frames=(30, 32),
        cameras=("c1",),
        limited=False,
        missing=(),
        background=(0.0, 0.0, 0.0),
        encoder="resnet18",
        encoder_pretrained=False,
        pretrained_from="f" * 64,
        seed=0,
        step=500,
        training_seconds=100.0,
        configuration=to_json_object(fewshot("small")),
        checkpoint="runs/eve",
        render_options={"samples": 8},
        lpips_note=None,
        machine={"processor": "abacus"},
        commit=None,
        time="2026-01-02T03:04:05+00:00",
        seconds=2.5,
        render_seconds=0.5,
        means=(),
        per_camera=(),
        per_image=(),
    )
