"""The decoded pictures used last, bounded in bytes; each process has its own."""

from collections import OrderedDict
from collections.abc import Callable, Hashable

from actorsnerf_datasets.types import Picture

CACHE_BYTES = 256 * 1024**2
"""Enough for all frames of a few-shot setting at half resolution."""


class PictureCache:
    """Least-recently-used decoded pictures; travels to another process empty."""

    def __init__(self, limit: int = CACHE_BYTES) -> None:
        self._limit = limit
        self._bytes = 0
        self._pictures: OrderedDict[Hashable, Picture] = OrderedDict()

    def __reduce__(self) -> tuple[type["PictureCache"], tuple[int]]:
        return PictureCache, (self._limit,)

    @property
    def held_bytes(self) -> int:
        """Bytes of the pictures held now; at most the limit."""
        return self._bytes

    def get(self, key: Hashable, read: Callable[[], Picture]) -> Picture:
        """The picture of a key, from memory or else from `read`.

        A picture larger than the whole limit is handed through and not kept.
        """
        if key in self._pictures:
            self._pictures.move_to_end(key)
            return self._pictures[key]
        picture = read()
        if _bytes_of(picture) <= self._limit:
            self._pictures[key] = picture
            self._bytes += _bytes_of(picture)
        while self._bytes > self._limit:
            _, oldest = self._pictures.popitem(last=False)
            self._bytes -= _bytes_of(oldest)
        return picture


def _bytes_of(picture: Picture) -> int:
    return picture.rgb.nbytes + picture.alpha.nbytes
