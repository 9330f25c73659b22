from dataclasses import replace
from pathlib import Path
from typing import Protocol

import pytest
import torch
from torch import Tensor

from actorsnerf_datasets.torch_dataset import PretrainingDataset, Sample
from actorsnerf_train.batches import (
    Share,
    at_pixels,
    camera_of,
    jitter_generator,
    on_background,
    random_background,
    sample_stream,
)


class People(Protocol):
    ann: Path
    ben: Path


CPU = torch.device("cpu")


@pytest.fixture
def source(people: People) -> PretrainingDataset:
    return PretrainingDataset((people.ann, people.ben), 0, 3, 1, 16, 10)


def test_processes_share_what_one_would_see() -> None:
    alone = Share(accumulation=6).indices(2, 5)
    shared = [Share(rank, 3, accumulation=2).indices(2, 5) for rank in range(3)]
    assert sorted(index for part in shared for index in part) == list(alone)
    # and step by step
    assert sorted(i for part in shared for i in part[:2]) == list(alone[:6])


def test_resuming_is_beginning_at_a_later_step() -> None:
    share = Share(1, 2, 2)
    assert [*share.indices(0, 4), *share.indices(4, 9)] == list(share.indices(0, 9))


def same(a: Sample, b: Sample) -> bool:
    return (
        torch.equal(a.patches, b.patches)
        and torch.equal(a.target.image, b.target.image)
        and (a.target.actor, a.target.frame) == (b.target.actor, b.target.frame)
        and [v.frame for v in a.supports] == [v.frame for v in b.supports]
    )


@pytest.mark.parametrize("workers", [0, 2])
def test_stream_is_the_source_in_order_for_any_number_of_workers(
    source: PretrainingDataset, workers: int
) -> None:
    indices = [7, 3, 8, 0]
    state = torch.get_rng_state()
    found = list(sample_stream(source, indices, workers))
    assert torch.equal(torch.get_rng_state(), state)
    for index, sample in zip(indices, found, strict=True):
        assert same(sample, source[index])


def test_target_colours_by_hand(source: PretrainingDataset) -> None:
    view = source[0].target
    grey = replace(
        view, image=torch.full((2, 2, 3), 0.5), alpha=torch.tensor([[0, 1], [0.5, 0.25]])
    )
    ground = on_background(grey, (1.0, 0.0, 0.5))
    expected = torch.tensor(
        [[[1, 0, 0.5], [0.5, 0.5, 0.5]], [[0.75, 0.25, 0.5], [0.875, 0.125, 0.5]]]
    )
    torch.testing.assert_close(ground, expected)


def test_pixels_are_x_y() -> None:
    picture = torch.arange(12.0).reshape(3, 4, 1)
    pixels = torch.tensor([[[3, 0], [1, 2]]])
    assert at_pixels(picture, pixels).tolist() == [[[3.0], [9.0]]]
    assert at_pixels(picture[..., 0], pixels).tolist() == [[3.0, 9.0]]


def test_camera_has_the_size_of_the_crop(source: PretrainingDataset) -> None:
    view = source[0].target
    camera = camera_of(view)
    assert camera.size == (view.alpha.shape[1], view.alpha.shape[0])
    assert camera.K is view.K


def test_jitter_depends_on_seed_and_index_alone() -> None:
    def draw(seed: int, index: int) -> Tensor:
        return torch.rand(4, generator=jitter_generator(seed, index, CPU))

    assert torch.equal(draw(1, 5), draw(1, 5))
    assert not torch.equal(draw(1, 5), draw(1, 6))
    assert not torch.equal(draw(1, 5), draw(2, 5))


def test_random_backgrounds_differ_by_sample_and_seed_and_fill_the_cube() -> None:
    drawn = {random_background(seed, index) for seed in range(3) for index in range(100)}
    assert len(drawn) == 300
    channels = torch.tensor(sorted(drawn))
    assert 0 <= channels.min() < 0.02
    assert 0.98 < channels.max() <= 1
    torch.testing.assert_close(channels.mean(0), torch.full((3,), 0.5), atol=0.06, rtol=0)
