"""The decoded pictures and vertices used last, bounded in bytes; each process has its own."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import TypeVar, cast

from actorsnerf_datasets.types import Float32, Picture

Item = TypeVar("Item", Picture, Float32)

CACHE_BYTES = 256 * 1024**2
"""Enough for all frames of a few-shot setting at half resolution."""


class PictureCache:
    """Least-recently-used decoded pictures and vertices; travels to another process empty."""

    def __init__(self, limit: int = CACHE_BYTES) -> None:
        self._limit = limit
        self._bytes = 0
        self._items: OrderedDict[Hashable, Picture | Float32] = OrderedDict()

    def __reduce__(self) -> tuple[type["PictureCache"], tuple[int]]:
        return PictureCache, (self._limit,)

    @property
    def held_bytes(self) -> int:
        """Bytes of what is held now; at most the limit."""
        return self._bytes

    def get(self, key: Hashable, read: Callable[[], Item]) -> Item:
        """The picture or the vertices of a key, from memory or else from `read`.

        What is larger than the whole limit is handed through and not kept.
        """
        if key in self._items:
            self._items.move_to_end(key)
            return cast(Item, self._items[key])  # a key always stands for one kind
        item = read()
        if _bytes_of(item) <= self._limit:
            self._items[key] = item
            self._bytes += _bytes_of(item)
        while self._bytes > self._limit:
            _, oldest = self._items.popitem(last=False)
            self._bytes -= _bytes_of(oldest)
        return item


def _bytes_of(item: Picture | Float32) -> int:
    return item.rgb.nbytes + item.alpha.nbytes if isinstance(item, Picture) else item.nbytes
