"""One picture an actor and setting: the truth beside every method, same unseen pose and camera."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.types import UInt8
from actorsnerf_train.pictures import STRIP_GAP, read_png, strip, strip_cell, write_png
from actorsnerf_train.places import spread
from actorsnerf_train.result import StripLayout
from actorsnerf_train.tables.entry import Entry

STRIP = "strip.png"
ROWS = 3
"""Poses and cameras in a figure at most."""
LINE_HEIGHT = 18
LETTER_WIDTH = 7
"""Pixels; a title with more letters than fit goes on in the next line."""


def write_side_by_side(folder: Path, entries: Sequence[Entry]) -> tuple[Path, ...]:
    """The figures written: one for each actor and setting of which pictures are there.

    Args:
        folder: where.
        entries: with a picture strip beside `result.json` or without; of each method's seeds the
            smallest is shown.

    Raises:
        UserError: a strip is not what its `result.json` says.
    """
    groups: dict[tuple[str, str, str], dict[str, Entry]] = {}
    for entry in sorted(entries, key=lambda one: (one.label, one.result.seed)):
        result = entry.result
        if result.strip is not None and (entry.path.parent / STRIP).is_file():
            key = (result.actor, result.setting or "", result.list_name or "")
            groups.setdefault(key, {}).setdefault(entry.label, entry)
    paths = []
    for (actor, setting, list_name), by_label in groups.items():
        sheet = compose(list(by_label.values()))
        if sheet is not None:
            paths.append(folder / f"pictures_{actor}_{setting}_{list_name}.png")
            write_png(paths[-1], sheet)
    return tuple(paths)


def compose(entries: Sequence[Entry]) -> UInt8 | None:
    """Truth and every entry's picture with titles; None where they have no picture in common."""
    views = [set(_views(entry)) for entry in entries]
    common = [view for view in _views(entries[0]) if all(view in some for some in views)]
    if not common:
        return None
    rows = []
    for view in spread(common, ROWS):
        truth = cut_out(entries[0], view, "truth")
        rows.append([truth, *(cut_out(entry, view, "prediction") for entry in entries)])
    titles = ["truth", *(entry.label for entry in entries)]
    sheet = strip(rows)
    return np.concatenate([_heading(titles, strip_cell(rows)[0], sheet.shape[1]), sheet])


def cut_out(entry: Entry, view: tuple[str, int], column: str) -> UInt8:
    """One picture of an entry's strip: of a camera and frame number, by the column's name.

    Raises:
        UserError: the strip is smaller than `result.json` says.
    """
    layout = entry.result.strip
    assert layout is not None
    path = entry.path.parent / STRIP
    sheet = read_png(path)
    line, across = _views(entry).index(view), layout.columns.index(column)
    row = layout.rows[line]
    y, x = line * (layout.cell[1] + layout.gap), across * (layout.cell[0] + layout.gap)
    picture = sheet[y : y + row.height, x : x + row.width]
    if picture.shape[:2] != (row.height, row.width):
        raise UserError(
            f"{path}: is {sheet.shape[1]} x {sheet.shape[0]} pixels, too small for the rows that "
            f"{entry.path.name} names: of another evaluation? Evaluate again."
        )
    return picture


def _views(entry: Entry) -> list[tuple[str, int]]:
    layout = entry.result.strip
    assert isinstance(layout, StripLayout)
    return [(row.camera, row.frame) for row in layout.rows]


def _heading(titles: Sequence[str], cell: int, width: int) -> UInt8:
    """A bar with a title over every column of a strip."""
    wrapped = [textwrap.wrap(title, max(cell // LETTER_WIDTH, 1)) for title in titles]
    bar = np.full((LINE_HEIGHT * max(map(len, wrapped)), width, 3), 255, dtype=np.uint8)
    for column, lines in enumerate(wrapped):
        for number, line in enumerate(lines, start=1):
            place = (column * (cell + STRIP_GAP), LINE_HEIGHT * number - 5)
            cv2.putText(bar, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    return bar
