"""Whether the datasets of a file, or the arrays about to be written, fit the layout together."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from actorsnerf_datasets.layout import ENTRIES, JOINT_COUNT


@dataclass(frozen=True)
class Form:
    """Shape and dtype of one dataset; dtype `str` for strings of any length."""

    shape: tuple[int, ...]
    dtype: str


@dataclass(frozen=True)
class Misfit:
    """One dataset that is not as the layout says."""

    entry: str
    sentence: str


def misfits(forms: Mapping[str, Form]) -> Iterator[Misfit]:
    """Every required dataset that is missing, of another dtype, or of another shape.

    An axis gets its size from the first dataset that has it; later ones must agree.

    >>> next(iter(misfits({}))).sentence
    'is missing'
    """
    sizes = {"J": JOINT_COUNT}
    origins = {"J": "the layout"}
    for entry in ENTRIES:
        form = forms.get(entry.path)
        if form is None:
            yield Misfit(entry.path, "is missing")
            continue
        if form.dtype != entry.dtype:
            yield Misfit(entry.path, f"has dtype {form.dtype}, expected {entry.dtype}")
        if len(form.shape) != len(entry.axes):
            axes = ", ".join(entry.axes)
            yield Misfit(entry.path, f"has shape {form.shape}, expected axes ({axes})")
            continue
        for axis, size in zip(entry.axes, form.shape, strict=True):
            expected = int(axis) if axis.isdigit() else sizes.setdefault(axis, size)
            origin = "the layout" if axis.isdigit() else origins.setdefault(axis, entry.path)
            if size != expected:
                yield Misfit(
                    entry.path,
                    f"has shape {form.shape}, but axis {axis} is {expected} (from {origin})",
                )
