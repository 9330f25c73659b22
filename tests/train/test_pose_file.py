import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from actorsnerf_train.pose_file import PoseFileError, load_poses

T = 4


@pytest.fixture
def poses(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=(T, 72)) * 0.3


def aist(path: Path, **entries: object) -> Path:
    path.write_bytes(pickle.dumps(entries))
    return path


def amass(path: Path, **entries: object) -> Path:
    np.savez(path, **entries)  # type: ignore[arg-type]  # the stub knows its own keywords only
    return path


def test_aist_comes_in_metres(tmp_path: Path, poses: np.ndarray) -> None:
    trans = np.arange(T * 3.0).reshape(T, 3) * 10
    file = aist(
        tmp_path / "gBR.pkl",
        smpl_poses=poses,
        smpl_scaling=np.array([95.0]),
        smpl_trans=trans,
        smpl_loss=0.1,
    )
    found = load_poses(file)
    assert np.array_equal(found.global_orient, poses[:, :3])
    assert np.array_equal(found.body_pose, poses[:, 3:].reshape(T, 23, 3))
    assert np.allclose(found.transl, trans / 95.0)
    assert found.up.tolist() == [0, 1, 0] and found.fps == 60.0


def test_amass_of_smpl(tmp_path: Path, poses: np.ndarray) -> None:
    trans = np.ones((T, 3))
    found = load_poses(
        amass(tmp_path / "a.npz", poses=poses, trans=trans, mocap_framerate=120.0, gender="male")
    )
    assert np.array_equal(found.body_pose, poses[:, 3:].reshape(T, 23, 3))
    assert np.array_equal(found.transl, trans)
    assert found.up.tolist() == [0, 0, 1] and found.fps == 120.0


@pytest.mark.parametrize("numbers", [156, 165])
def test_amass_with_fingers_keeps_the_22_shared_joints(
    tmp_path: Path, rng: np.random.Generator, numbers: int
) -> None:
    wide = rng.normal(size=(T, numbers)) * 0.3
    found = load_poses(amass(tmp_path / "a.npz", poses=wide, trans=np.zeros((T, 3))))
    assert np.array_equal(found.body_pose[:, :21].reshape(T, 63), wide[:, 3:66])
    assert not found.body_pose[:, 21:].any()
    assert found.fps is None


def test_an_object_entry_beside_the_poses_is_never_read(tmp_path: Path, poses: np.ndarray) -> None:
    labels = np.array([{"a": 1}, None], dtype=object)
    file = amass(tmp_path / "a.npz", poses=poses, trans=np.zeros((T, 3)), labels=labels)
    assert len(load_poses(file).transl) == T


REFUSED: dict[str, tuple[dict[str, np.ndarray], str]] = {
    "easymocap": ({"Rh": np.zeros((T, 3)), "Th": np.zeros((T, 3))}, "EasyMocap's convention"),
    "no root": ({"poses": np.zeros((T, 69))}, "69 numbers a frame: the root rotation is missing"),
    "matrices": ({"poses": np.zeros((T, 24, 3, 3))}, r"\(4, 24, 3, 3\): rotation matrices, expect"),
    "flat matrices": ({"poses": np.zeros((T, 216))}, "rotation matrices, expected axis-angle"),
    "quaternions": ({"poses": np.zeros((T, 24, 4))}, "quaternions, expected axis-angle"),
    "other joints": ({"poses": np.zeros((T, 51))}, r"51 numbers a frame, expected 72 \(SMPL\)"),
    "degrees": ({"poses": np.full((T, 72), 45.0)}, "rotation by 77.9, .* are these degrees"),
    "nan": ({"poses": np.full((T, 72), np.nan)}, "not finite in 4 frames, first at position 0"),
    "one frame": ({"poses": np.zeros(72)}, r"poses has shape \(72,\), expected \(frames, 72\)"),
    "no frame": ({"poses": np.zeros((0, 72))}, r"poses has shape \(0, 72\)"),
    "text": ({"poses": np.array(["a"] * T)}, "poses is not an array of numbers"),
    "no poses": (
        {"joints": np.zeros((T, 24, 3))},
        "has no poses, only joints, trans; expected AIS",
    ),
    "millimetres": (
        {"poses": np.zeros((T, 72)), "trans": np.full((T, 3), 900.0)},
        "trans puts the body 900 m from the origin: is it in another unit",
    ),
    "infinite": (
        {"poses": np.zeros((T, 72)), "trans": np.full((T, 3), np.inf)},
        "trans is not fin",
    ),
    "other length": (
        {"poses": np.zeros((T, 72)), "trans": np.zeros((T + 1, 3))},
        r"trans has shape \(5, 3\), expected \(4, 3\)",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_other_conventions_are_refused(tmp_path: Path, name: str) -> None:
    entries, message = REFUSED[name]
    file = amass(tmp_path / "a.npz", **({"trans": np.zeros((T, 3))} | entries))
    with pytest.raises(PoseFileError, match=message) as caught:
        load_poses(file)
    assert str(file) in str(caught.value) and "\n" not in str(caught.value)


def test_aist_without_scaling_is_refused(tmp_path: Path, poses: np.ndarray) -> None:
    file = aist(tmp_path / "a.pkl", smpl_poses=poses, smpl_trans=np.zeros((T, 3)))
    with pytest.raises(PoseFileError, match="has no smpl_scaling, only smpl_poses, smpl_trans"):
        load_poses(file)
    for scaling in (np.zeros(1), np.ones(2), np.array([np.nan])):
        file = aist(
            tmp_path / "a.pkl",
            smpl_poses=poses,
            smpl_trans=np.zeros((T, 3)),
            smpl_scaling=scaling,
        )
        with pytest.raises(PoseFileError, match=r"smpl_scaling is .* expected one positive number"):
            load_poses(file)


def test_unscaled_metres_in_an_aist_file_are_refused(tmp_path: Path, poses: np.ndarray) -> None:
    file = aist(
        tmp_path / "a.pkl",
        smpl_poses=poses,
        smpl_trans=np.full((T, 3), 200.0),
        smpl_scaling=np.ones(1),
    )
    with pytest.raises(PoseFileError, match="smpl_trans puts the body 200 m from the origin"):
        load_poses(file)


def test_a_pickle_that_is_no_table(tmp_path: Path) -> None:
    file = tmp_path / "a.pkl"
    file.write_bytes(pickle.dumps([1, 2]))
    with pytest.raises(PoseFileError, match=r"a\.pkl: holds a list, not a table"):
        load_poses(file)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04damaged", b"no archive"])
def test_a_damaged_archive(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "a.npz"
    file.write_bytes(content)
    with pytest.raises(PoseFileError, match=r"a\.npz: cannot be read as npz"):
        load_poses(file)


def test_poses_as_objects_are_not_unpickled(tmp_path: Path) -> None:
    file = amass(tmp_path / "a.npz", poses=np.array([{}], dtype=object), trans=np.zeros((1, 3)))
    with pytest.raises(PoseFileError, match=r"a\.npz: cannot be read as npz \(Object arrays"):
        load_poses(file)


@pytest.mark.parametrize(
    ("name", "message"), [("none.npz", "no such pose file"), ("a.bvh", "is a .bvh; expected AIST")]
)
def test_what_is_no_pose_file(tmp_path: Path, name: str, message: str) -> None:
    if name != "none.npz":
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(PoseFileError, match=re.escape(message)):
        load_poses(tmp_path / name)
