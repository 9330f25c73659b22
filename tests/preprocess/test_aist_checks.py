import numpy as np
import pytest

from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.aist_checks import (
    SMPL_OF_COCO,
    keypoint_distances,
    keypoint_findings,
    require_plausible_distance,
    scaling_finding,
    swapped_sides_finding,
)
from actorsnerf_preprocess.silhouettes import project_points
from actorsnerf_preprocess.source import SourceCamera, SourceError


def camera(index: int, distance: float = 5.0) -> SourceCamera:
    K = np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]])
    T = np.array([0.1 * index, 0, distance])
    return SourceCamera(f"c{index + 1:02d}", index, K, np.zeros(5), np.eye(3), T, (640, 480))


def dance(rng: np.random.Generator, frames: int = 30) -> Float64:
    """Joints that move by about 20 cm from frame to frame."""
    steps: Float64 = np.cumsum(rng.normal(0, 0.2, (frames, 1, 3)), axis=0)
    joints: Float64 = steps - steps.mean(0) + rng.normal(0, 0.4, (1, 24, 3))
    return joints


def detected(joints: Float64, view: SourceCamera) -> Float64:
    keypoints = np.full((len(joints), 17, 3), np.nan)
    pixels, _ = project_points(joints.reshape(-1, 3), view)
    pixels = pixels.reshape(len(joints), 24, 2)
    for coco, smpl in SMPL_OF_COCO:
        keypoints[:, coco, :2] = pixels[:, smpl]
        keypoints[:, coco, 2] = 0.9
    return keypoints


def test_a_scaling_of_another_unit_is_reported() -> None:
    assert scaling_finding(93.0) == ()
    (finding,) = scaling_finding(0.93)
    assert finding.severity == "warning" and "is 0.93; 50 to 150 is plausible" in finding.sentence


def test_cameras_of_another_unit_are_refused() -> None:
    bodies = np.zeros((3, 3))
    require_plausible_distance((camera(0), camera(1)), bodies)
    with pytest.raises(SourceError, match="stand 500 m from the dancer, 1 to 15 m is plausible"):
        require_plausible_distance((camera(0, 500.0),), bodies)


def test_swapped_sides_are_told_from_right_ones(rng: np.random.Generator) -> None:
    joints = dance(rng)
    keypoints = np.full((30, 17, 3), np.nan)
    for coco, smpl in SMPL_OF_COCO:
        keypoints[:, coco] = joints[:, smpl] + 0.02
    assert swapped_sides_finding(joints, keypoints) == ()
    crossed = keypoints[:, [*range(5), *(k + (1 if k % 2 else -1) for k in range(5, 17))]]
    (finding,) = swapped_sides_finding(joints, crossed)
    assert "left and right of the body are swapped" in finding.sentence
    assert "20210308_motions" in finding.sentence


def test_sides_cannot_be_told_without_keypoints(rng: np.random.Generator) -> None:
    assert swapped_sides_finding(dance(rng), np.full((30, 17, 3), np.nan)) == ()


def test_the_distance_is_the_median_over_what_was_seen(rng: np.random.Generator) -> None:
    joints, view = dance(rng), camera(0)
    keypoints = detected(joints, view)
    keypoints[:, :, :2] += (3.0, 4.0)
    keypoints[:10] = np.nan
    keypoints[10:12, :, 2] = 0.1
    distance, count = keypoint_distances(view, joints, keypoints)
    assert distance == pytest.approx(5.0) and count == 18 * len(SMPL_OF_COCO)
    assert keypoint_distances(view, joints, np.full((30, 17, 3), np.nan))[1] == 0


def test_a_view_that_is_not_synchronised_stands_out(rng: np.random.Generator) -> None:
    joints = dance(rng)
    cameras = tuple(camera(index) for index in range(3))
    keypoints = np.stack([detected(joints, view) for view in cameras])
    keypoints[..., :2] += rng.normal(0, 2, keypoints[..., :2].shape)
    quiet = keypoint_findings(cameras, joints, keypoints, np.arange(30))
    assert [finding.severity for finding in quiet] == ["note"]
    keypoints[1] = np.roll(keypoints[1], 6, axis=0)
    note, warning = keypoint_findings(cameras, joints, keypoints, np.arange(30))
    assert note.sentence.startswith("median pixels to the projected joints: c01 2.")
    assert warning.entry == "c02" and "its video is not synchronised" in warning.sentence


def test_no_keypoint_at_all_is_said(rng: np.random.Generator) -> None:
    empty = np.full((9, 30, 17, 3), np.nan)
    (finding,) = keypoint_findings((camera(0),), dance(rng), empty, np.arange(30))
    assert finding.sentence == "hold no keypoint of the usable views."
