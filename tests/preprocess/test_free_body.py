import hashlib
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from actorsnerf_datasets.body_model import BodyModel, load_body_model, pose, rest
from actorsnerf_preprocess.free_body import (
    free_body,
    free_body_atlas,
    free_body_path,
    free_wardrobe,
    write_tiny_body,
)

FOLDER = free_body_path().parent


@pytest.fixture(scope="module")
def body() -> BodyModel:
    return free_body()


def test_weights_and_regressor_are_averages(body: BodyModel) -> None:
    for rows in (body.weights, body.joint_regressor):
        assert rows.min() >= 0
        np.testing.assert_allclose(rows.sum(axis=1), 1.0, atol=1e-6)
    assert body.weights.shape == (13524, 24)
    assert (body.weights > 0).sum(axis=1).max() <= 4
    assert (body.weights > 0).any(axis=0).all()


def test_every_part_of_the_surface_is_closed_and_looks_outwards(body: BodyModel) -> None:
    faces = body.faces
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    # In a closed surface each directed edge has its opposite exactly once.
    forth = {(int(a), int(b)) for a, b in edges}
    assert len(forth) == len(edges)
    assert {(b, a) for a, b in forth} == forth
    graph = coo_matrix((np.ones(len(edges)), tuple(edges.T)), shape=(len(body.template),) * 2)
    parts, label = connected_components(graph, directed=False)
    assert parts == 3  # the body and two eyes
    for part in range(parts):
        a, b, c = np.moveaxis(body.template[faces[label[faces[:, 0]] == part]], 1, 0)
        assert np.einsum("fi,fi->", a, np.cross(b, c)) > 0


def test_it_is_a_person_in_t_pose(body: BodyModel) -> None:
    joints, vertices = rest(body, np.zeros(10))
    height = np.ptp(vertices[:, 1])
    assert 1.5 < height < 1.9
    assert joints[15, 1] > joints[12, 1] > joints[0, 1] > joints[4, 1] > joints[7, 1]
    # Arms along x: the person's left is +x, and a wrist is as high as its shoulder.
    assert joints[20, 0] > joints[16, 0] > 0 > joints[17, 0] > joints[21, 0]
    np.testing.assert_allclose(joints[20, 1], joints[16, 1], atol=0.05)
    # Toes lie in front of the ankles, towards +z.
    assert joints[10, 2] > joints[7, 2] + 0.05


def test_the_rest_pelvis_is_off_the_origin(body: BodyModel) -> None:
    """Otherwise a lost pelvis term of a convention would not show."""
    joints, _ = rest(body, np.zeros(10))
    assert np.linalg.norm(joints[0]) > 0.1


def test_shapes_and_pose_blend_shapes_are_there_and_moderate(body: BodyModel) -> None:
    for direction in np.moveaxis(body.shape_directions, 2, 0):
        assert 0.001 < np.abs(direction).max() < 0.2
    bent = np.zeros((24, 3))
    bent[18, 1] = -1.2
    with_blend = pose(body, np.zeros(10), bent).vertices
    without = pose(body, np.zeros(10), bent, pose_blend=False).vertices
    moved = np.linalg.norm(with_blend - without, axis=1)
    assert 0.001 < moved.max() < 0.05
    assert (moved[body.weights[:, [4, 5, 7, 8]].sum(axis=1) > 0.9] < 1e-6).all()


def test_texture_coordinates_match_the_faces(body: BodyModel) -> None:
    atlas = free_body_atlas()
    assert atlas.faces.shape == body.faces.shape
    assert atlas.uv.min() >= 0
    assert atlas.uv.max() <= 1
    assert atlas.faces.max() == len(atlas.uv) - 1


def test_the_wardrobe_follows_the_body(body: BodyModel) -> None:
    wardrobe = free_wardrobe()
    assert set(wardrobe) == {"suit", "skirt", "hair"}
    for garment in wardrobe.values():
        np.testing.assert_allclose(garment.weights.sum(axis=1), 1.0, atol=1e-6)
        assert garment.faces.max() < len(garment.template)
        low, high = body.template.min(axis=0) - 0.15, body.template.max(axis=0) + 0.15
        assert (garment.template > low).all()
        assert (garment.template < high).all()
        assert garment.shape_directions.shape == (len(garment.template), 3, 10)
        # One unit of any shape moves clothes about as far as the skin.
        most = np.abs(body.shape_directions).max()
        assert np.abs(garment.shape_directions).max() < 2 * most


def test_the_notice_says_where_the_data_come_from() -> None:
    notice = (FOLDER / "cc0_body.md").read_text()
    for words in ("CC0 1.0", "MakeHuman", "nothing of SMPL", "3dobjs/base.obj", "SHA-256"):
        assert words in notice
    rows = [line for line in notice.splitlines() if line.startswith("| `")]
    assert len(rows) > 20
    for row in rows:
        digest = row.split("`")[3]
        assert len(digest) == len(hashlib.sha256().hexdigest())
        int(digest, 16)


def test_no_packaged_file_is_called_smpl() -> None:
    assert sorted(path.name for path in FOLDER.iterdir()) == [
        "cc0_body.md",
        "cc0_body.npz",
        "cc0_wardrobe.npz",
    ]


def test_the_tiny_body_has_the_free_bodys_joints(body: BodyModel, tmp_path: Path) -> None:
    tiny = load_body_model(write_tiny_body(tmp_path / "tiny.npz"))
    assert tiny.template.shape == (192, 3)
    betas = np.linspace(-1, 1, 10)
    np.testing.assert_allclose(rest(tiny, betas)[0], rest(body, betas)[0], atol=1e-4)
    np.testing.assert_allclose(tiny.weights.sum(axis=1), 1.0)
