import pickle
from collections.abc import Callable

import numpy as np

from actorsnerf_datasets.picture_cache import PictureCache
from actorsnerf_datasets.types import Float32, Picture

SIZE = 400
"""Bytes of one picture."""


def picture(level: int, side: int = 10) -> Picture:
    return Picture(
        np.full((side, side, 3), level, np.uint8), np.zeros((side, side), np.uint8), (0, 0)
    )


def reader(level: int, read: list[int]) -> Callable[[], Picture]:
    def once() -> Picture:
        read.append(level)
        return picture(level)

    return once


def test_a_kept_picture_is_read_once() -> None:
    read: list[int] = []
    cache = PictureCache(10 * SIZE)
    for _ in range(3):
        assert cache.get("a", reader(1, read)).rgb[0, 0, 0] == 1
    assert read == [1] and cache.held_bytes == SIZE


def test_the_least_recently_used_leaves_first() -> None:
    read: list[int] = []
    cache = PictureCache(2 * SIZE)
    for key in (1, 2, 1, 3):  # 2 has to leave, as 1 was used later
        cache.get(key, reader(key, read))
    assert cache.held_bytes == 2 * SIZE
    cache.get(1, reader(1, read))
    cache.get(2, reader(2, read))
    assert read == [1, 2, 3, 2]


def test_a_picture_larger_than_the_limit_is_not_kept() -> None:
    cache = PictureCache(SIZE)
    cache.get("small", lambda: picture(1))
    assert cache.get("large", lambda: picture(2, side=20)).rgb[0, 0, 0] == 2
    assert cache.held_bytes == SIZE


def test_it_travels_empty() -> None:
    cache = PictureCache(3 * SIZE)
    cache.get("a", lambda: picture(1))
    copied = pickle.loads(pickle.dumps(cache))
    assert copied.held_bytes == 0
    for key in range(5):
        copied.get(key, lambda: picture(0))
    assert copied.held_bytes == 3 * SIZE


def test_vertices_are_kept_beside_pictures() -> None:
    read: list[int] = []

    def vertices() -> Float32:
        read.append(0)
        return np.ones((5, 3), np.float32)

    cache = PictureCache(SIZE + 60)
    cache.get("picture", lambda: picture(1))
    for _ in range(2):
        assert cache.get("vertices", vertices).sum() == 15
    assert (len(read), cache.held_bytes) == (1, SIZE + 60)
    cache.get("another", lambda: picture(2))
    assert cache.held_bytes == SIZE + 60  # the first picture left, not the vertices
    cache.get("vertices", vertices)
    assert len(read) == 1
