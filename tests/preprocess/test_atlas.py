import numpy as np

from actorsnerf_preprocess.atlas import cut_seams, texel_values
from actorsnerf_preprocess.free_body import Atlas

# Two triangles of a square; the diagonal is a seam in the texture.
FACES = np.array([[0, 1, 2], [0, 2, 3]])
SEAMED = Atlas(
    np.array([[0, 0], [0.5, 0], [0.5, 1], [0.5, 0.2], [1, 1], [1, 0]], dtype=np.float32),
    np.array([[0, 1, 2], [3, 4, 5]]),
)
WHOLE = Atlas(
    np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32), np.array([[0, 1, 2], [0, 2, 3]])
)


def test_vertices_repeat_along_seams_only() -> None:
    mesh = cut_seams(FACES, SEAMED)
    assert len(mesh.uv) == 6
    np.testing.assert_array_equal(mesh.source[mesh.faces], FACES)
    np.testing.assert_array_equal(mesh.uv[mesh.faces], SEAMED.uv[SEAMED.faces])
    assert len(cut_seams(FACES, WHOLE).uv) == 4


def test_texels_hold_what_vertices_interpolate_to() -> None:
    """With texture coordinates as values each texel says where it is itself."""
    size = 16
    found = texel_values(WHOLE.uv.astype(np.float64), FACES, WHOLE, size)
    centres = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(centres, 1 - centres)  # v = 1 is the top row
    assert np.abs(found - np.stack([u, v], axis=-1)).max() <= 0.5 / size + 1e-6


def test_texels_off_the_mesh_take_the_nearest_value() -> None:
    corner = Atlas(
        np.array([[0, 0], [0.25, 0], [0, 0.25]], dtype=np.float32), np.array([[0, 1, 2]])
    )
    found = texel_values(np.array([[7.0], [7.0], [7.0]]), np.array([[0, 1, 2]]), corner, 8)
    np.testing.assert_array_equal(found, 7.0)
