import os
import pickle
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_datasets.body_model import BodyModel, lbs, load_body_model, pose, rest
from actorsnerf_datasets.errors import BodyModelError
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.skeleton import PARENTS
from actorsnerf_datasets.types import Float64

VERTICES = 40

GOLDEN_VERTICES = [
    [0.35978558389151133, 0.3173265080001673, 0.27475606339287256],
    [0.6046666717135483, -0.17088127806603717, 0.5832284888765159],
    [-0.12217532901711409, -0.08786094115929685, 0.09585776220735372],
]
GOLDEN_JOINTS = [
    [0.006389959442655836, 0.024604106393261976, 0.04050151427396439],
    [0.007984432552428783, 0.04922678951604281, 0.061840600797542916],
    [-0.09304180835013726, 0.08483988573694863, 0.011451582955254256],
]
GOLDEN_WITHOUT_BLEND = [0.6131687422269362, -0.16987907861592458, 0.5873668743825724]


def _wave(shape: tuple[int, ...], step: float) -> Float64:
    """Numbers without pattern that are the same with every release of numpy."""
    wave: Float64 = np.sin(np.arange(1, np.prod(shape) + 1) * step).reshape(shape)
    return wave


def _golden_entries(shape_count: int = 10) -> dict[str, object]:
    weights = _wave((VERTICES, 24), 1.7) ** 8 + 1e-3
    regressor = _wave((24, VERTICES), 2.3) ** 4
    return {
        "v_template": _wave((VERTICES, 3), 0.37),
        "shapedirs": _wave((VERTICES, 3, shape_count), 0.73) * 0.05,
        "posedirs": _wave((VERTICES, 3, 207), 0.91) * 0.01,
        "J_regressor": regressor / regressor.sum(axis=1, keepdims=True),
        "weights": weights / weights.sum(axis=1, keepdims=True),
        "kintree_table": np.array([[2**32 - 1, *PARENTS[1:]], range(24)], dtype=np.uint32),
        "f": np.arange(VERTICES - 1).reshape(-1, 3).astype(np.uint32),
    }


@pytest.fixture
def golden_file(tmp_path: Path) -> Path:
    """A body of 40 vertices in the format of SMPL's own pickle."""
    path = tmp_path / "body.pkl"
    path.write_bytes(pickle.dumps(_golden_entries(), 2))
    return path


def test_golden_numbers(golden_file: Path) -> None:
    """Recorded when the code agreed with smplx 0.1.28 to 4e-8 m."""
    betas, angles = _wave((10,), 0.5), _wave((24, 3), 1.1) * 0.8
    posed = pose(load_body_model(golden_file), betas, angles)
    np.testing.assert_allclose(posed.vertices[[0, 17, 39]], GOLDEN_VERTICES, atol=1e-12)
    np.testing.assert_allclose(posed.joints[[0, 15, 22]], GOLDEN_JOINTS, atol=1e-12)
    plain = pose(load_body_model(golden_file), betas, angles, pose_blend=False)
    np.testing.assert_allclose(plain.vertices[17], GOLDEN_WITHOUT_BLEND, atol=1e-12)


def test_within_a_micrometre_of_smplx(golden_file: Path, rng: np.random.Generator) -> None:
    smplx = pytest.importorskip("smplx", reason="the oracle extra is not installed")
    torch = pytest.importorskip("torch", reason="smplx needs it")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of smplx and of what it imports
        ids = dict.fromkeys(smplx.vertex_ids.vertex_ids["smplh"], 0)
        oracle = smplx.SMPL(str(golden_file), vertex_ids=ids, dtype=torch.float64)
    model = load_body_model(golden_file)
    for _ in range(10):
        betas, angles = rng.normal(size=10), rng.normal(size=(24, 3))
        transl = rng.normal(size=3) * 3
        expected = oracle(
            betas=torch.tensor(betas[None]),
            body_pose=torch.tensor(angles[None, 1:].reshape(1, 69)),
            global_orient=torch.tensor(angles[None, 0]),
            transl=torch.tensor(transl[None]),
        )
        posed = pose(model, betas, angles)
        vertices = expected.vertices[0].detach().numpy()
        joints = expected.joints[0, :24].detach().numpy()
        np.testing.assert_allclose(posed.vertices + transl, vertices, rtol=0, atol=1e-6)
        np.testing.assert_allclose(posed.joints + transl, joints, rtol=0, atol=1e-6)


def test_pickle_and_npz_give_the_same_body(golden_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "body.npz"
    arrays: dict[str, Any] = {name: np.asarray(e) for name, e in _golden_entries().items()}
    np.savez(path, **arrays)
    angles = _wave((24, 3), 1.3)
    one, other = (pose(load_body_model(p), np.zeros(10), angles) for p in (golden_file, path))
    np.testing.assert_array_equal(one.vertices, other.vertices)
    assert load_body_model(path).digest != load_body_model(golden_file).digest


def test_of_300_shape_directions_the_first_ten_are_used(tmp_path: Path) -> None:
    path = tmp_path / "body.pkl"
    entries = _golden_entries(300)
    path.write_bytes(pickle.dumps(entries, 2))
    model = load_body_model(path)
    np.testing.assert_array_equal(
        model.shape_directions, np.asarray(entries["shapedirs"])[..., :10]
    )


def test_zero_pose_is_the_rest(body: BodyModel, rng: np.random.Generator) -> None:
    betas = rng.normal(size=10)
    joints, vertices = rest(body, betas)
    posed = pose(body, betas, np.zeros((24, 3)))
    np.testing.assert_allclose(posed.vertices, vertices, atol=1e-14)
    np.testing.assert_allclose(posed.joints, joints, atol=1e-14)


def test_one_bone_moves_its_vertices_rigidly(rng: np.random.Generator) -> None:
    vertices, transforms = rng.normal(size=(24, 3)), np.tile(np.eye(4), (24, 1, 1))
    transforms[:, :3, :3] = matrix_from_axis_angle(rng.normal(size=(24, 3)))
    transforms[:, :3, 3] = rng.normal(size=(24, 3))
    expected = [t[:3, :3] @ v + t[:3, 3] for t, v in zip(transforms, vertices, strict=True)]
    np.testing.assert_allclose(lbs(vertices, np.eye(24), transforms), expected, atol=1e-14)


def test_fewer_betas_are_filled_and_more_are_refused(body: BodyModel) -> None:
    few, filled = np.array([1.0, -1.0]), np.array([1.0, -1.0, *([0.0] * 14)])
    np.testing.assert_array_equal(rest(body, few)[1], rest(body, filled)[1])
    with pytest.raises(BodyModelError, match="16 shape coefficients, but the body model has 10"):
        rest(body, np.ones(16))


def test_a_missing_model_says_where_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(BodyModelError, match=r"no such body-model file: register at https://smpl"):
        load_body_model(tmp_path / "SMPL_NEUTRAL.pkl")


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("shapedirs", None, "has no entry 'shapedirs'; an SMPL-format file has v_template"),
        ("weights", np.zeros((39, 24)), r"entry 'weights' is float64 \(39, 24\), expected numbers"),
        ("posedirs", np.zeros((40, 3, 459)), r"expected numbers \(40, 3, 207\): is this an SMPL"),
        ("J_regressor", np.array("none"), "entry 'J_regressor' is <U4"),
        ("kintree_table", np.zeros((2, 24), int), "its joint tree is not SMPL's"),
    ],
)
def test_each_bad_entry_is_named(tmp_path: Path, key: str, value: object, sentence: str) -> None:
    entries = _golden_entries()
    entries[key] = value
    if value is None:
        del entries[key]
    path = tmp_path / "body.pkl"
    path.write_bytes(pickle.dumps(entries, 2))
    with pytest.raises(BodyModelError, match=sentence):
        load_body_model(path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "list.pkl"
    path.write_bytes(pickle.dumps([1, 2]))
    with pytest.raises(BodyModelError, match="holds a list, expected SMPL's dictionary"):
        load_body_model(path)
    path = tmp_path / "half.npz"
    path.write_bytes(b"PK\x03\x04" + os.urandom(50))
    with pytest.raises(BodyModelError, match=r"half.npz: not a readable .npz"):
        load_body_model(path)
    np.savez(path, v_template=np.array([{"a": 1}], dtype=object))
    with pytest.raises(BodyModelError, match=r"half.npz: not a readable .npz"):
        load_body_model(path)
