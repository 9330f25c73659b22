import cv2
import numpy as np
import pytest

from actorsnerf_datasets.cameras import project, project_distorted
from actorsnerf_datasets.types import Float64, Picture, UInt8
from actorsnerf_preprocess.pictures import (
    Crop,
    PictureOptions,
    lens_of,
    stored_camera,
    stored_picture,
    stored_size,
    undistorted,
)
from actorsnerf_preprocess.source import RawPicture, SourceCamera

DISTORTION = np.array([-0.25, 0.1, 0.001, -0.0005, -0.02])
STATED_ERROR = 1.5
"""Levels of 255, away from overshoot of the filter."""


def camera(distortion: Float64 = DISTORTION, size: tuple[int, int] = (240, 200)) -> SourceCamera:
    K = np.array([[230.0, 0, 118.3], [0, 232.0, 101.7], [0, 0, 1]])
    return SourceCamera("c", 0, K, distortion, np.eye(3), np.zeros(3), size)


def smooth_person(rng: np.random.Generator, size: tuple[int, int] = (240, 200)) -> RawPicture:
    """A textured picture; the mask has a sharp border, as masks have."""
    noise = rng.integers(0, 256, (size[1], size[0], 3)).astype(np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 2)
    mask = np.zeros((size[1], size[0]), np.uint8)
    cv2.ellipse(mask, (size[0] // 2, size[1] // 2), (40, 80), 10, 0, 360, 255, -1)
    return RawPicture(np.asarray(image, np.uint8), mask)


def official(raw: RawPicture, source: SourceCamera, scale: float, background: float) -> Float64:
    """The published order: undistort, alpha / 255, composite, resize (Lanczos)."""
    assert raw.mask is not None
    image = cv2.undistort(raw.image, source.K, source.distortion).astype(np.float64)
    alpha = cv2.undistort(raw.mask, source.K, source.distortion).astype(np.float64)[..., None] / 255
    composite: Float64 = alpha * image + (1.0 - alpha) * background
    if scale == 1.0:
        return composite
    resized = cv2.resize(composite, None, fx=scale, fy=scale, interpolation=cv2.INTER_LANCZOS4)
    return np.asarray(resized, np.float64)


def overshoot(raw: RawPicture, source: SourceCamera, scale: float) -> UInt8:
    """1 where alpha or colour / alpha leaves the range that 8 bits hold."""
    assert raw.mask is not None
    alpha: Float64 = cv2.undistort(raw.mask, source.K, source.distortion).astype(np.float64) / 255
    image = cv2.undistort(raw.image, source.K, source.distortion).astype(np.float64)
    if scale == 1.0:
        return np.zeros(alpha.shape, np.uint8)
    coverage, colour = (
        cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_LANCZOS4)
        for part in (alpha, image * alpha[..., None])
    )
    straight = colour / np.maximum(np.round(255 * coverage), 1)[..., None] * 255
    outside = (coverage < -0.001) | (coverage > 1.001)
    outside |= ((straight < 0) | (straight > 255)).any(-1)
    return np.asarray(outside, np.uint8)


def pasted(picture: Picture, size: tuple[int, int], background: float) -> Float64:
    """The composite of a stored crop in the full picture."""
    share = picture.alpha[..., None] / 255.0
    crop = picture.rgb * share + background * (1.0 - share)
    full = np.full((size[1], size[0], 3), background)
    x, y = picture.offset
    rows = slice(max(y, 0), min(y + crop.shape[0], size[1]))
    columns = slice(max(x, 0), min(x + crop.shape[1], size[0]))
    full[rows, columns] = crop[rows.start - y : rows.stop - y, columns.start - x : columns.stop - x]
    return full


@pytest.mark.parametrize("scale", [1.0, 0.5, 0.25, 0.4])
@pytest.mark.parametrize("background", [0.0, 255.0])
def test_composites_are_those_of_the_published_order(
    scale: float, background: float, rng: np.random.Generator
) -> None:
    source, raw = camera(), smooth_person(rng)
    size = stored_size(source.size, scale)
    options = PictureOptions(scale, published_background="white" if background else "black")
    crop = Crop(size[0] // 8, -4, 3 * size[0] // 4, size[1] + 9)
    picture = stored_picture(raw, lens_of(source), crop, options)
    expected = np.clip(official(raw, source, scale, background), 0, 255)
    error = np.abs(pasted(picture, size, background) - expected).max(axis=-1)
    assert error[overshoot(raw, source, scale) == 0].max() <= STATED_ERROR
    assert error.max() < 4.0
    assert np.sqrt((error**2).mean()) < 0.5


@pytest.mark.parametrize("background", [0.0, 128.0, 255.0])
def test_composites_on_any_background_are_exact_where_the_filter_does_not_overshoot(
    background: float, rng: np.random.Generator
) -> None:
    source, raw = camera(), smooth_person(rng)
    picture = stored_picture(raw, lens_of(source), Crop(0, 0, 120, 100), PictureOptions())
    expected = np.clip(official(raw, source, 0.5, background), 0, 255)
    error = np.abs(pasted(picture, (120, 100), background) - expected).max(axis=-1)
    assert error[overshoot(raw, source, 0.5) == 0].max() <= STATED_ERROR


def test_inside_the_margin_the_content_is_the_undistorted_source(rng: np.random.Generator) -> None:
    source, raw = camera(), smooth_person(rng)
    options = PictureOptions(keep_background=True)
    crop = Crop(17, 5, 80, 88)
    picture = stored_picture(raw, lens_of(source), crop, options)
    full = cv2.undistort(raw.image, source.K, source.distortion).astype(np.float32)
    expected = cv2.resize(full, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_LANCZOS4)
    inside = (picture.alpha == 0) | (picture.alpha == 255)
    window = expected[5:93, 17:97]
    deep = cv2.erode((picture.alpha == 255).astype(np.uint8), np.ones((9, 9))) > 0
    far = picture.alpha == 0
    assert inside.any() and deep.any() and far.any()
    error = np.abs(picture.rgb - np.clip(window, 0, 255)).max(axis=-1)
    assert error[deep | far].max() <= 0.51


def test_windows_are_those_of_the_whole_undistorted_picture(rng: np.random.Generator) -> None:
    source, raw = camera(), smooth_person(rng)
    whole = cv2.undistort(raw.image, source.K, source.distortion)
    window = undistorted(lens_of(source), raw.image, Crop(31, 17, 90, 101))
    assert np.array_equal(window, whole[17:118, 31:121])


def test_without_distortion_nothing_is_resampled(rng: np.random.Generator) -> None:
    source, raw = camera(np.zeros(5)), smooth_person(rng)
    picture = stored_picture(
        raw, lens_of(source), Crop(0, 0, 240, 200), PictureOptions(1.0, keep_background=True)
    )
    assert np.array_equal(picture.rgb, raw.image)
    assert raw.mask is not None and np.array_equal(picture.alpha, raw.mask)


def test_a_crop_of_the_picture_does_not_depend_on_where_it_is_cut(
    rng: np.random.Generator,
) -> None:
    source, raw = camera(), smooth_person(rng)
    lens, options = lens_of(source), PictureOptions(keep_background=True)
    whole = stored_picture(raw, lens, Crop(0, 0, 120, 100), options)
    part = stored_picture(raw, lens, Crop(33, 21, 40, 48), options)
    assert np.array_equal(part.rgb, whole.rgb[21:69, 33:73])
    assert np.array_equal(part.alpha, whole.alpha[21:69, 33:73])


def test_the_background_beyond_the_rim_is_dropped(rng: np.random.Generator) -> None:
    source, raw = camera(), smooth_person(rng)
    picture = stored_picture(raw, lens_of(source), Crop(0, 0, 120, 100), PictureOptions(rim=3))
    person = (picture.alpha > 0).astype(np.uint8)
    near = cv2.dilate(person, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))) > 0
    assert not picture.rgb[~near].any()
    assert picture.rgb[near & (person == 0)].any()


def test_what_lies_beyond_the_picture_is_transparent_black(rng: np.random.Generator) -> None:
    raw = RawPicture(np.full((200, 240, 3), 200, np.uint8), np.full((200, 240), 255, np.uint8))
    picture = stored_picture(
        raw, lens_of(camera(np.zeros(5))), Crop(-10, 90, 40, 32), PictureOptions()
    )
    assert picture.offset == (-10, 90)
    assert not picture.alpha[:, :10].any() and not picture.alpha[10:].any()
    assert (picture.alpha[:10, 10:] == 255).all() and (picture.rgb[:10, 10:] == 200).all()


def test_the_stored_camera_projects_where_the_undistorted_resized_picture_shows_it() -> None:
    source = camera()
    stored = stored_camera(source, 0.5)
    points = np.array([[0.1, -0.2, 2.0], [-0.4, 0.3, 2.5]])
    pixels = project(points, source.K, np.eye(4)).pixels
    assert np.allclose(project(points, stored.K, np.eye(4)).pixels, (pixels + 0.5) * 0.5 - 0.5)
    assert stored.size == (120, 100)
    assert np.array_equal(stored.source_distortion, DISTORTION)


def test_a_dot_in_the_raw_picture_is_found_where_the_stored_camera_projects_it() -> None:
    source = camera()
    point = np.array([[0.35, 0.25, 2.0]])
    raw_pixel = project_distorted(point, source.K, np.eye(4), source.distortion).pixels[0]
    columns, rows = np.meshgrid(np.arange(240), np.arange(200))
    spot = np.exp(-((columns - raw_pixel[0]) ** 2 + (rows - raw_pixel[1]) ** 2) / 18.0)
    image = np.repeat((255 * spot)[..., None], 3, axis=-1).astype(np.uint8)
    raw = RawPicture(image, np.full((200, 240), 255, np.uint8))
    picture = stored_picture(raw, lens_of(source), Crop(0, 0, 120, 100), PictureOptions())
    weights = picture.rgb[..., 0].astype(np.float64)
    weights[weights < 20] = 0
    found = [(weights * axis).sum() / weights.sum() for axis in np.mgrid[:100, :120][::-1]]
    expected = project(point, stored_camera(source, 0.5).K, np.eye(4)).pixels[0]
    assert np.allclose(found, expected, atol=0.1)


@pytest.mark.parametrize("place", [(0, 0), (120, 100), (239, 199), (30, 190), (300, 300)])
@pytest.mark.parametrize(("rim", "scale"), [(0, 0.5), (4, 0.5), (3, 0.25), (2, 1.0), (4, 0.4)])
def test_only_the_person_is_computed_and_nothing_of_it_is_lost(
    place: tuple[int, int], rim: int, scale: float, rng: np.random.Generator
) -> None:
    """Its slow twin keeps the background, and so computes everything."""
    source, mask = camera(), np.zeros((200, 240), np.uint8)
    cv2.circle(mask, place, 13, 255, -1)
    raw = RawPicture(rng.integers(1, 256, (200, 240, 3), dtype=np.uint8), mask)
    crop = Crop(3, -5, stored_size(source.size, scale)[0], 90)
    lens = lens_of(source)
    found = stored_picture(raw, lens, crop, PictureOptions(scale, rim=rim))
    whole = stored_picture(raw, lens, crop, PictureOptions(scale, keep_background=True))
    person = whole.alpha > 0
    assert np.array_equal(found.alpha, whole.alpha)
    assert np.array_equal(found.rgb[person], whole.rgb[person])
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * rim + 1, 2 * rim + 1))
    near = cv2.dilate(person.astype(np.uint8), disc) > 0
    assert not found.rgb[~near].any()
    beside = near & (whole.rgb > 40).any(axis=-1)
    assert found.rgb[beside].any(axis=-1).all()
