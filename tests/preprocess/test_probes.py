from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.cameras import camera_from_world, project
from actorsnerf_preprocess.pictures import Crop, lens_of, stored_camera
from actorsnerf_preprocess.probes import area_jumps, crop_size, placed_crop, probe_picture
from actorsnerf_preprocess.source import OpenOptions, SourceSequence
from actorsnerf_preprocess.zju import find_zju, open_zju

WriteTree = Callable[..., Any]


@pytest.fixture
def source(tmp_path: Path, write_zju: WriteTree, tiny_body: Path) -> SourceSequence:
    write_zju(tmp_path / "CoreView_377", frames=range(2), cameras=2)
    return open_zju(find_zju(tmp_path)[0], OpenOptions(body_model=tiny_body, pairs="all"))


def rewrite_mask(source: SourceSequence, change: Callable[[Any], Any]) -> None:
    path = source.reader.files(0, 1)[1]
    cv2.imwrite(str(path), change(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))


def probe(source: SourceSequence, camera: int = 0, frame: int = 1) -> Any:
    seen = source.cameras[camera]
    return probe_picture(source, lens_of(seen), stored_camera(seen, 0.5), (camera, frame))


def test_the_box_holds_the_projected_body_and_the_undistorted_mask(source: SourceSequence) -> None:
    found, seen = probe(source), source.cameras[0]
    stored = stored_camera(seen, 0.5)
    matrix = camera_from_world(seen.R, seen.T) @ source.fits.world_from_body[1]
    pixels = project(source.fits.posed_vertices[1].astype(np.float64), stored.K, matrix).pixels
    mask = np.asarray(cv2.imread(str(source.reader.files(0, 1)[1]), cv2.IMREAD_UNCHANGED))
    full = cv2.undistort((mask > 0).astype(np.uint8) * 255, seen.K, seen.distortion)
    rows, columns = np.nonzero(full > 127)
    right, bottom = found.box.x + found.box.width - 1, found.box.y + found.box.height - 1
    assert found.box.x <= pixels[:, 0].min() and right >= pixels[:, 0].max()
    assert found.box.y <= pixels[:, 1].min() and bottom >= pixels[:, 1].max()
    assert found.box.x <= (columns.min() + 1) / 2 and right >= (columns.max() - 2) / 2
    # ... and it is tight: within 3 stored pixels of the two.
    assert found.box.x >= min(pixels[:, 0].min(), columns.min() / 2) - 3
    assert bottom <= max(pixels[:, 1].max(), rows.max() / 2) + 3
    assert found.inside > 0.95
    assert not found.stray
    assert len(found.digest) == 64


def test_a_far_blob_is_reported_and_does_not_widen_the_box(source: SourceSequence) -> None:
    before = probe(source).box

    def blob(mask: Any) -> Any:
        mask[:8, :8] = 9
        return mask

    rewrite_mask(source, blob)
    after = probe(source)
    assert after.stray
    assert after.box == before


def test_a_skirt_widens_the_box(source: SourceSequence) -> None:
    before = probe(source).box

    def skirt(mask: Any) -> Any:
        mask[80:100, 24:130] = 9
        return mask

    rewrite_mask(source, skirt)
    after = probe(source)
    assert not after.stray
    assert after.box.width > before.width + 5


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (np.zeros_like, "empty mask"),
        (np.ones_like, "full mask"),
        (lambda mask: np.roll(mask, 60, axis=1), "mask elsewhere"),
    ],
)
def test_implausible_masks_are_named(
    source: SourceSequence, change: Callable[[Any], Any], reason: str
) -> None:
    rewrite_mask(source, change)
    found = probe(source)
    assert (found.box, found.reason) == (None, reason)


def test_a_body_outside_the_picture_is_named(source: SourceSequence) -> None:
    matrices = source.fits.world_from_body.copy()
    matrices[1, 2, 3] += 50.0
    moved = replace(source, fits=replace(source.fits, world_from_body=matrices))
    assert probe(moved).reason == "body outside the picture"


def test_missing_and_truncated_files_are_named(source: SourceSequence) -> None:
    image, mask = source.reader.files(0, 1)
    content = mask.read_bytes()
    mask.write_bytes(content[: len(content) // 2])
    assert (probe(source).reason, probe(source).where) == ("truncated", str(mask))
    image.unlink()
    assert (probe(source).reason, probe(source).where) == ("missing", str(image))


def test_a_mask_that_jumps_in_area_is_named(source: SourceSequence) -> None:
    usual = probe(source)
    row = [replace(usual, frame=frame, area=0.1 + 0.001 * frame) for frame in range(20)]
    assert area_jumps(row) == ()
    row[7] = replace(row[7], area=0.04)
    row[13] = replace(row[13], area=0.2)
    assert [jump.frame for jump in area_jumps(row)] == [7, 13]
    other = [replace(one, camera=1, area=0.5) for one in row]
    assert [jump.camera for jump in area_jumps(row + other)] == [0, 0]


def test_crop_sizes_are_multiples_of_eight_with_a_margin() -> None:
    assert crop_size([Crop(0, 0, 1, 1)]) == (32, 32)
    assert crop_size([Crop(0, 0, 36, 37)]) == (40, 48)


def test_crops_are_centred_on_their_box() -> None:
    assert placed_crop(Crop(10, 20, 30, 40), (40, 48)) == Crop(5, 16, 40, 48)
