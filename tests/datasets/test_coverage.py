import dataclasses
from itertools import combinations

import numpy as np
import pytest

from actorsnerf_datasets.coverage import choose_frames, view_directions, visibility
from actorsnerf_datasets.types import BodyFits, Float64, SequenceHeader


def _value(seen: Float64, frames: tuple[int, ...] | list[int]) -> float:
    return float(np.sqrt(seen[list(frames)].sum(axis=0)).sum())


def test_directions_by_hand(header: SequenceHeader) -> None:
    """A body at rest at the origin, three metres in front of the first camera, and turned."""
    fits, count = header.fits, 4
    turn = np.arange(count) * np.pi / 2
    world_from_body = np.tile(np.eye(4), (count, 1, 1))
    world_from_body[:, 0, 0] = world_from_body[:, 2, 2] = np.cos(turn)
    world_from_body[:, 0, 2], world_from_body[:, 2, 0] = np.sin(turn), -np.sin(turn)
    zeros = np.zeros((count, 24, 3))
    rest = BodyFits(
        global_orient=zeros[:, 0],
        transl=zeros[:, 0],
        body_pose=zeros[:, 1:],
        betas=fits.betas[:count],
        world_from_body=world_from_body,
        rest_joints=zeros,
        posed_joints=zeros,
        posed_vertices=fits.posed_vertices[:count],
    )
    directions = view_directions(rest, header.cameras[0])
    expected = [[0, 0, 1], [-1, 0, 0], [0, 0, -1], [1, 0, 0]]
    np.testing.assert_allclose(directions[:, 5], expected, atol=1e-12)
    bent = np.zeros((count, 23, 3))
    bent[:, 15] = [0.0, np.pi / 2, 0.0]  # the left shoulder turns its arm's front to the left
    directions = view_directions(dataclasses.replace(rest, body_pose=bent), header.cameras[0])
    np.testing.assert_allclose(directions[0, 18], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(directions[0, 0], [0, 0, 1], atol=1e-12)


def test_visibility_is_the_cosine_in_front_and_zero_behind(rng: np.random.Generator) -> None:
    directions = rng.normal(size=(5, 24, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    seen = visibility(directions)
    assert seen.min() == 0.0
    assert seen.max() <= 1.0 + 1e-12
    # Evenly spread sides: the mean of the clipped cosine over a sphere is 1/4.
    np.testing.assert_allclose(seen.mean(axis=-1), 0.25, atol=0.01)


def test_the_greedy_choice_is_within_its_bound(rng: np.random.Generator) -> None:
    for _ in range(10):
        seen = rng.random((9, 1, 6)) ** 4
        best = max(_value(seen[:, 0], frames) for frames in combinations(range(9), 3))
        assert _value(seen[:, 0], choose_frames(seen, 3)) >= (1 - 1 / np.e) * best


def test_other_sides_come_before_more_of_the_same() -> None:
    angle = np.radians([0, 1, 2, 90, 180, 181, 270])
    directions = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)
    chosen = choose_frames(visibility(directions[:, None]), 4)
    assert [round(float(np.degrees(angle[frame])) / 90) % 4 for frame in chosen[:2]] in (
        [0, 2],
        [1, 3],
        [3, 1],
        [2, 0],
    )
    assert {round(float(np.degrees(angle[frame])) / 90) % 4 for frame in chosen} == {0, 1, 2, 3}


def test_ties_go_to_the_earliest_and_lists_are_nested(rng: np.random.Generator) -> None:
    same = np.ones((4, 1, 3))
    assert choose_frames(same, 2) == [0, 1]
    seen = rng.random((30, 4, 8))
    assert choose_frames(seen, 20)[:7] == choose_frames(seen, 7)
    assert sorted(choose_frames(seen, 99)) == list(range(30))
    assert choose_frames(seen[:0], 3) == []


@pytest.mark.parametrize("noise", [1e-14, -1e-14])
def test_rounding_does_not_decide(noise: float) -> None:
    seen = np.ones((3, 2, 5))
    seen[2] += noise
    assert choose_frames(seen, 1) == [0]
