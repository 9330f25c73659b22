import dataclasses
import multiprocessing
import os
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from actorsnerf_datasets.cameras import camera_from_world
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.protocols import generic_protocol
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.selection import FewshotChoice
from actorsnerf_datasets.torch_dataset import (
    FewshotDataset,
    PretrainingDataset,
    Sample,
    View,
    pad_views,
    view_at,
)
from actorsnerf_datasets.types import Picture, SequenceHeader, Shots
from actorsnerf_datasets.writer import StoredPicture, encode_picture, write_sequence

K, PATCHES, SIDE = 3, 2, 8
CROP_SIZE = (48, 64)


def pictures_of(header: SequenceHeader) -> Iterator[StoredPicture]:
    """Noise with a rectangle of a person, for every camera and frame."""
    rng = np.random.default_rng(3)
    width, height = CROP_SIZE
    alpha = np.zeros((height, width), np.uint8)
    alpha[10:50, 15:30] = 255
    for camera in range(len(header.cameras)):
        for frame in range(len(header.frames)):
            rgb = rng.integers(0, 256, size=(height, width, 3), dtype=np.uint8)
            chunks = encode_picture(Picture(rgb, alpha, (0, 0)))
            yield StoredPicture(camera, frame, (16, 8), *chunks)


def for_pretraining(header: SequenceHeader, actor: str) -> SequenceHeader:
    protocol = generic_protocol("pretraining", [c.name for c in header.cameras], header.frames)
    return dataclasses.replace(header, actor=actor, protocols=(protocol,))


@pytest.fixture
def pretraining_files(header: SequenceHeader, tmp_path: Path) -> tuple[Path, ...]:
    """Two actors; of the second, a third of the frames are not valid."""
    paths = tmp_path / "bert.h5", tmp_path / "cleo.h5"
    write_sequence(paths[0], for_pretraining(header, "bert"), CROP_SIZE, pictures_of(header))
    some = (
        dataclasses.replace(picture, valid=picture.frame_index % 3 != 1)
        for picture in pictures_of(header)
    )
    write_sequence(paths[1], for_pretraining(header, "cleo"), CROP_SIZE, some)
    return paths


@pytest.fixture
def pretraining(pretraining_files: tuple[Path, ...]) -> PretrainingDataset:
    return PretrainingDataset(pretraining_files, 5, K, PATCHES, SIDE, 12)


@pytest.fixture
def held_out_path(header: SequenceHeader, tmp_path: Path) -> Path:
    """A held-out actor with two lists of fewshot-5."""
    (protocol,) = header.protocols
    lists = (
        Shots("fewshot-5", "official", (100, 101, 103, 104, 106), (106, 100, 103)),
        Shots("fewshot-5", "auto", (100, 102, 103, 104, 105), (100, 102, 104)),
        Shots("short-video", "auto", (101, 102), (101, 102, 103)),
    )
    held_out = dataclasses.replace(protocol, shots=lists)
    path = tmp_path / "dora.h5"
    write_sequence(
        path, dataclasses.replace(header, protocols=(held_out,)), CROP_SIZE, pictures_of(header)
    )
    return path


def fewshot(path: Path, choice: FewshotChoice | None = None, seed: int = 5) -> FewshotDataset:
    return FewshotDataset(path, choice or FewshotChoice("fewshot-5"), seed, PATCHES, SIDE, 12)


def assert_same(first: Sample, second: Sample) -> None:
    assert torch.equal(first.patches, second.patches)
    assert len(first.supports) == len(second.supports)
    views = zip((first.target, *first.supports), (second.target, *second.supports), strict=True)
    for a, b in views:
        for field in dataclasses.fields(View):
            x, y = getattr(a, field.name), getattr(b, field.name)
            assert torch.equal(x, y) if isinstance(x, torch.Tensor) else x == y, field.name


def test_a_view_is_what_the_file_holds(
    sequence_path: Path, header: SequenceHeader, picture_of: Callable[[int, int], Picture]
) -> None:
    view = view_at(SequenceFile(sequence_path), "c02", 104)
    drawn, camera, frame = picture_of(1, 4), header.cameras[1], 4
    assert np.allclose(view.image.numpy() * 255, drawn.rgb, atol=1e-4)
    assert np.allclose(view.alpha.numpy() * 255, drawn.alpha, atol=1e-4)
    assert (view.actor, view.camera, view.frame) == ("anna", "c02", 104)
    assert (view.offset, view.full_size) == (drawn.offset, (80, 80))
    assert np.allclose(view.K[:2, 2].numpy() + drawn.offset, camera.K[:2, 2])
    assert view.pose[0].tolist() == [0.0, 0.0, 0.0]
    assert np.allclose(view.pose[1:].numpy(), header.fits.body_pose[frame])
    assert np.allclose(view.rest_joints.numpy(), header.fits.rest_joints[frame])
    assert np.allclose(view.canonical_joints.numpy(), header.shape.rest_joints)
    assert np.array_equal(view.rest_vertices.numpy(), header.shape.rest_vertices)
    assert np.array_equal(view.posed_vertices.numpy(), header.fits.posed_vertices[frame])


def test_the_camera_is_folded_in_float64_before_it_is_cast(
    header: SequenceHeader, tmp_path: Path
) -> None:
    far = np.array([0.0, 0.0, 30000.0])  # metres: float32 alone would lose millimetres
    cameras = tuple(dataclasses.replace(c, T=c.T - c.R @ far) for c in header.cameras)
    moved = header.fits.world_from_body.copy()
    moved[:, :3, 3] += far
    fits = dataclasses.replace(header.fits, world_from_body=moved, transl=header.fits.transl + far)
    path = tmp_path / "far.h5"
    write_sequence(
        path,
        dataclasses.replace(header, cameras=cameras, fits=fits),
        CROP_SIZE,
        pictures_of(header),
    )
    near = camera_from_world(header.cameras[1].R, header.cameras[1].T)
    expected = near @ header.fits.world_from_body[4]
    found = view_at(SequenceFile(path), 1, 104).camera_from_body
    assert np.abs(found.numpy() - expected).max() < 1e-6


def test_no_patch_shows_what_the_picture_does_not(header: SequenceHeader, tmp_path: Path) -> None:
    cut = (dataclasses.replace(one, offset=(-20, 30)) for one in pictures_of(header))
    path = tmp_path / "cut.h5"
    write_sequence(path, for_pretraining(header, "cut"), CROP_SIZE, cut)
    dataset = PretrainingDataset([path], 5, K, PATCHES, SIDE, 12)
    for sample in dataset:
        full = sample.patches + torch.tensor(sample.target.offset)
        assert full.min() >= 0
        assert full.max() < 80  # pixels a side of all pictures


def test_who_writes_into_a_sample_changes_no_other(pretraining: PretrainingDataset) -> None:
    before, drawn = pretraining[3], pretraining[3]
    kept = dataclasses.replace(
        before,
        target=_copied(before.target),
        supports=tuple(_copied(view) for view in before.supports),
    )
    for view in (drawn.target, *drawn.supports):
        for field in dataclasses.fields(View):
            value = getattr(view, field.name)
            if isinstance(value, torch.Tensor):
                value.zero_()
    assert_same(pretraining[3], kept)


def _copied(view: View) -> View:
    tensors = {
        field.name: getattr(view, field.name).clone()
        for field in dataclasses.fields(View)
        if isinstance(getattr(view, field.name), torch.Tensor)
    }
    return dataclasses.replace(view, **tensors)


def test_vertices_project_onto_the_person(sequence_path: Path) -> None:
    view = view_at(SequenceFile(sequence_path), "c03", 107)
    seen = view.posed_vertices @ view.camera_from_body[:3, :3].T + view.camera_from_body[:3, 3]
    homogeneous = seen @ view.K.T
    x, y = (homogeneous[:, :2] / homogeneous[:, 2:]).round().long().T
    inside = (x >= 0) & (x < 48) & (y >= 0) & (y < 64)
    assert inside.float().mean() > 0.9
    assert (view.alpha[y[inside], x[inside]] > 0).all()


@pytest.mark.parametrize(
    ("camera", "frame", "message"),
    [
        ("c09", 104, r"anna\.h5: has no camera 'c09'; it has c01, c02, c03"),
        (7, 104, r"anna\.h5: has no camera at position 7; it has 3\."),
        ("c01", 99, r"anna\.h5: has no frame 99; it has 12 from 100 to 111"),
        ("c03", 111, r"camera c03 has no valid picture .* frame 111: it is not stored: .*all-"),
    ],
)
def test_a_view_that_is_not_there(
    header: SequenceHeader, tmp_path: Path, camera: str | int, frame: int, message: str
) -> None:
    some = (p for p in pictures_of(header) if (p.camera_index, p.frame_index) != (2, 11))
    write_sequence(tmp_path / "anna.h5", header, CROP_SIZE, some)
    with pytest.raises(UserError, match=message):
        view_at(SequenceFile(tmp_path / "anna.h5"), camera, frame)


def test_an_invalid_picture_is_refused(pretraining_files: tuple[Path, ...]) -> None:
    with pytest.raises(UserError, match="no usable fit or mask"):
        view_at(SequenceFile(pretraining_files[1]), 0, 101)


def test_pretraining_supports_are_other_frames_of_the_same_actor(
    pretraining: PretrainingDataset,
) -> None:
    for index in range(60):
        sample = pretraining[index]
        views = (sample.target, *sample.supports)
        assert len({view.frame for view in views}) == K + 1
        assert {view.actor for view in views} == {sample.target.actor}
        assert {view.camera for view in views} == {"c01"}
        assert sample.patches.shape == (PATCHES, SIDE, SIDE, 2)


def test_pretraining_is_uniform_over_valid_pairs(pretraining_files: tuple[Path, ...]) -> None:
    pretraining = PretrainingDataset(pretraining_files, 5, 1, 1, SIDE, 1)
    drawn = [pretraining[index] for index in range(400)]
    pairs = [(sample.target.actor, sample.target.frame) for sample in drawn]
    pool = pretraining.files[0].header.protocols[0].pretraining_frames
    valid = [("bert", n) for n in pool] + [("cleo", n) for n in pool if (n - 100) % 3 != 1]
    assert set(pairs) == set(valid)
    expected = len(pairs) / len(valid)
    counts = np.array([pairs.count(pair) for pair in valid])
    chi_squared = float(((counts - expected) ** 2 / expected).sum())
    assert chi_squared < len(valid) + 4 * np.sqrt(2 * len(valid))
    supports = {(v.actor, v.frame) for sample in drawn for v in sample.supports}
    assert supports == set(valid)


def test_a_sample_is_a_function_of_seed_and_index(
    pretraining: PretrainingDataset, pretraining_files: tuple[Path, ...]
) -> None:
    again = PretrainingDataset(pretraining_files, 5, K, PATCHES, SIDE, 12)
    last = [again[i] for i in range(11, -1, -1)]
    for index in range(12):
        assert_same(pretraining[index], last[11 - index])
    other = PretrainingDataset(pretraining_files, 6, K, PATCHES, SIDE, 12)
    assert any(not torch.equal(other[i].patches, pretraining[i].patches) for i in range(12))


@pytest.mark.parametrize(("workers", "method"), [(1, "fork"), (2, "fork"), (1, "spawn")])
def test_workers_give_the_same_samples(
    pretraining: PretrainingDataset, workers: int, method: str
) -> None:
    alone = [pretraining[index] for index in range(6)]  # opens the file in this process first
    loader = DataLoader(
        pretraining,
        sampler=range(6),
        batch_size=None,
        num_workers=workers,
        multiprocessing_context=multiprocessing.get_context(method),
    )
    for ours, theirs in zip(alone, loader, strict=True):
        assert_same(ours, theirs)


def test_iteration_and_length(pretraining: PretrainingDataset) -> None:
    assert len(pretraining) == len(list(pretraining)) == 12


def test_a_dataset_travels_without_open_files(pretraining: PretrainingDataset) -> None:
    pretraining[0]
    copied = pickle.loads(pickle.dumps(pretraining))
    assert_same(copied[3], pretraining[3])


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="needs /proc to count open files")
def test_files_are_opened_when_needed(pretraining_files: tuple[Path, ...]) -> None:
    sequence = SequenceFile(pretraining_files[0])
    assert view_at(sequence, 0, 100).frame == 100
    sequence.close()
    assert view_at(sequence, 0, 102).frame == 102


def test_a_held_out_actor_is_refused_in_pretraining(
    pretraining_files: tuple[Path, ...], sequence_path: Path
) -> None:
    message = r"anna\.h5: actor anna is held out for testing in protocol generic; .* leak the test"
    with pytest.raises(UserError, match=message):
        PretrainingDataset((*pretraining_files, sequence_path), 0, K, PATCHES, SIDE, 1)


def test_no_files_are_refused() -> None:
    with pytest.raises(UserError, match="needs at least one prepared file"):
        PretrainingDataset((), 0, K, PATCHES, SIDE, 1)


def test_too_few_frames_for_the_supports(pretraining_files: tuple[Path, ...]) -> None:
    with pytest.raises(UserError, match=r"usable pre-training frames at camera c01, but a target "):
        PretrainingDataset(pretraining_files, 0, 20, PATCHES, SIDE, 1)


def test_a_patch_larger_than_the_crop(pretraining_files: tuple[Path, ...]) -> None:
    dataset = PretrainingDataset(pretraining_files[:1], 0, K, PATCHES, 49, 1)
    message = (
        r"bert\.h5: camera c01, frame \d+: a patch of 49x49 pixels does not fit a crop of 48x6"
    )
    with pytest.raises(UserError, match=message):
        dataset[0]


def test_fewshot_targets_and_supports_come_from_the_list(held_out_path: Path) -> None:
    dataset = fewshot(held_out_path)
    assert [view.frame for view in dataset.supports] == [106, 100, 103]
    samples = [dataset[index] for index in range(60)]
    assert {sample.target.frame for sample in samples} == {100, 101, 103, 104, 106}
    assert {sample.target.camera for sample in samples} == {"c01"}
    assert all(sample.supports == () for sample in samples)
    assert_same(samples[7], fewshot(held_out_path)[7])


def test_the_automatic_list_and_fewer_supports_by_name(held_out_path: Path) -> None:
    dataset = fewshot(held_out_path, FewshotChoice("fewshot-5", "auto", "generic", k=2))
    assert [view.frame for view in dataset.supports] == [100, 102]
    assert dataset.shots.list_name == "auto"


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        (
            FewshotChoice("fewshot-99"),
            r"has no setting fewshot-99 for actor anna; it has fewshot-5",
        ),
        (FewshotChoice("short-video", "official"), r"no setting short-video \(official\) for"),
        (FewshotChoice("fewshot-5", protocol="zju"), r"has no protocol 'zju'; it has generic"),
        (FewshotChoice("fewshot-5", k=6), r"fewshot-5 has 5 frames, fewer than the 6 .*\(K > M\)"),
        (FewshotChoice("fewshot-5", k=4), r"list of fewshot-5 names 3 supports, but 4 are asked"),
    ],
)
def test_fewshot_settings_that_are_not_there(
    held_out_path: Path, choice: FewshotChoice, message: str
) -> None:
    with pytest.raises(UserError, match=message):
        fewshot(held_out_path, choice)


def test_a_pretraining_actor_is_refused_in_fewshot(pretraining_files: tuple[Path, ...]) -> None:
    with pytest.raises(UserError, match="actor bert has the role pretraining in protocol generic"):
        fewshot(pretraining_files[0])


def test_fewshot_without_its_pictures(header: SequenceHeader, tmp_path: Path) -> None:
    (protocol,) = header.protocols
    lists = (Shots("fewshot-5", "auto", (100, 101, 102, 103, 104), (100, 101, 102)),)
    some = (p for p in pictures_of(header) if (p.camera_index, p.frame_index) != (0, 3))
    path = tmp_path / "gap.h5"
    gap = dataclasses.replace(header, protocols=(dataclasses.replace(protocol, shots=lists),))
    write_sequence(path, gap, CROP_SIZE, some)
    with pytest.raises(
        UserError, match="no valid picture of 1 of the 5 frames of fewshot-5, first"
    ):
        fewshot(path)


def test_padding_grows_to_the_right_and_below(held_out_path: Path) -> None:
    large = fewshot(held_out_path).supports[0]
    small = dataclasses.replace(large, image=large.image[:50, :40], alpha=large.alpha[:50, :40])
    padded = pad_views([large, small])
    assert torch.equal(padded[0].image, large.image)
    assert padded[1].image.shape == large.image.shape
    assert torch.equal(padded[1].image[:50, :40], small.image)
    assert torch.equal(padded[1].K, small.K)
    assert padded[1].alpha[50:].abs().sum() == padded[1].alpha[:, 40:].abs().sum() == 0
