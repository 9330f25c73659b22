import json
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_preprocess.aist_tree_writer import AistMotion, AistTreeWriter
from actorsnerf_preprocess.source import SourceCamera, SourceError

TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def test_cameras_are_rotation_vectors_and_scaled_translations(tmp_path: Path) -> None:
    K = np.array([[160.0, 0, 8], [0, 160, 6], [0, 0, 1]])
    lens = np.array([-0.06, 0, 0, 0, 0])
    camera = SourceCamera("c02", 1, K, lens, TURN, np.array([0.5, -1, 3]), (16, 12))
    AistTreeWriter(tmp_path).write_cameras("setting3", [camera], 93.0)
    path = tmp_path / "annotations" / "cameras" / "setting3.json"
    (entry,) = json.loads(path.read_text())
    assert (entry["name"], entry["size"], entry["matrix"]) == ("c02", [16, 12], K.tolist())
    assert entry["distortions"] == [-0.06, 0, 0, 0, 0]
    assert entry["translation"] == [46.5, -93.0, 279.0]
    np.testing.assert_allclose(entry["rotation"], [0, 0, np.pi / 2], atol=1e-12)


def test_motions_are_in_scaled_centimetres(tmp_path: Path) -> None:
    poses = np.arange(2 * 72, dtype=np.float64).reshape(2, 24, 3)
    motion = AistMotion(poses, np.array([[0.0, 1, 2], [3, 4, 5]]), 90.0)
    AistTreeWriter(tmp_path).write_motion("dance", motion)
    path = tmp_path / "annotations" / "motions" / "dance.pkl"
    content = pickle.loads(path.read_bytes())
    assert set(content) == {"smpl_poses", "smpl_scaling", "smpl_trans", "smpl_loss"}
    np.testing.assert_array_equal(content["smpl_poses"], poses.reshape(2, 72))
    assert content["smpl_scaling"].tolist() == [90.0]
    np.testing.assert_allclose(content["smpl_trans"], [[0, 90, 180], [270, 360, 450]])


def test_lists_have_the_oddities_of_the_real_ones(tmp_path: Path) -> None:
    writer = AistTreeWriter(tmp_path)
    writer.write_mapping("setting1", ["a", "b"])
    writer.write_ignore_list(["a", "b"])
    writer.write_splits(["a"], ["b", "c"])
    annotations = tmp_path / "annotations"
    assert (annotations / "cameras" / "mapping.txt").read_text() == "a setting1\nb setting1\n"
    assert (annotations / "ignore_list.txt").read_text() == "a \nb\n\n"
    assert (annotations / "splits" / "pose_train.txt").read_text() == "a"
    assert (annotations / "splits" / "crossmodal_test.txt").read_text() == "b\nc"


def test_videos_have_sixty_pictures_a_second(tmp_path: Path) -> None:
    video = AistTreeWriter(tmp_path).open_video("dance", (32, 16))
    for _ in range(3):
        video.write(np.full((16, 32, 3), 90, np.uint8))
    video.release()
    capture = cv2.VideoCapture(str(tmp_path / "videos" / "dance.mp4"))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(60)
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 3
    capture.release()


def test_a_video_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "videos" / "dance.mp4").mkdir(parents=True)
    with pytest.raises(SourceError, match=r"dance\.mp4: cannot be written as a video"):
        AistTreeWriter(tmp_path).open_video("dance", (32, 16))
