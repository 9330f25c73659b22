import collections
import io
import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from actorsnerf_datasets.pickles import PickleError, load_npy, load_pickle

FITS = {
    "poses": np.arange(72.0).reshape(1, 72),
    "names": ["a", ("b", 3)],
    "scaling": np.float32(93.5),
    "nested": {"more": np.array([{"x": np.arange(3)}, None], dtype=object)},
    "ordered": collections.OrderedDict(a=1),
    "bytes": b"\x00\xff",
    "flag": True,
}


def _same(found: object) -> None:
    assert isinstance(found, dict)
    assert list(found) == list(FITS)
    np.testing.assert_array_equal(found["poses"], FITS["poses"])
    np.testing.assert_array_equal(found["nested"]["more"][0]["x"], [0, 1, 2])
    assert found["nested"]["more"][1] is None
    assert found["scaling"] == np.float32(93.5)
    assert found["names"] == ["a", ("b", 3)]
    assert (found["ordered"], found["bytes"], found["flag"]) == ({"a": 1}, b"\x00\xff", True)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_plain_data_comes_back_at_every_protocol(tmp_path: Path, protocol: int) -> None:
    path = tmp_path / "fit.pkl"
    path.write_bytes(pickle.dumps(FITS, protocol))
    _same(load_pickle(path))


def test_a_saved_dictionary_comes_back_as_one(tmp_path: Path) -> None:
    path = tmp_path / "annots.npy"
    np.save(path, np.array(FITS, dtype=object))
    _same(load_npy(path))


def test_arrays_of_numbers_and_of_objects(tmp_path: Path) -> None:
    path = tmp_path / "array.npy"
    np.save(path, np.eye(3, dtype=np.float32))
    np.testing.assert_array_equal(load_npy(path), np.eye(3))
    np.save(path, np.array(["a", {"b": 1}], dtype=object))
    found = load_npy(path)
    assert isinstance(found, np.ndarray)
    assert found.tolist() == ["a", {"b": 1}]


def test_a_bare_pickle_named_npy_is_read(tmp_path: Path) -> None:
    path = tmp_path / "fit.npy"
    path.write_bytes(pickle.dumps(FITS))
    _same(load_npy(path))


def test_old_and_new_numpy_paths(tmp_path: Path) -> None:
    content = pickle.dumps(np.arange(4), 2)
    old = content.replace(b"numpy._core.multiarray", b"numpy.core.multiarray")
    assert old != content
    path = tmp_path / "old.pkl"
    path.write_bytes(old)
    np.testing.assert_array_equal(load_pickle(path), np.arange(4))


def _object_pickle(module: str, name: str, state: object) -> bytes:
    """What protocol 2 writes for an object of a Python 2 class."""
    body = pickle.dumps(state, 2)[2:-1]
    return b"\x80\x02c" + f"{module}\n{name}\n".encode() + b")\x81" + body + b"b."


def test_chumpy_arrays_and_selections(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    path.write_bytes(_object_pickle("chumpy.ch", "Ch", {"x": np.arange(6.0), "_itr": None}))
    np.testing.assert_array_equal(load_pickle(path), np.arange(6.0))
    state = {"a": np.arange(10.0), "idxs": np.array([1, 3, 5, 7]), "preferred_shape": (2, 2)}
    path.write_bytes(_object_pickle("chumpy.reordering", "Select", state))
    np.testing.assert_array_equal(load_pickle(path), [[1, 3], [5, 7]])


@pytest.mark.parametrize("kind", ["csc", "csr"])
@pytest.mark.parametrize("protocol", [0, 2, 5])
def test_sparse_matrices_come_out_dense(tmp_path: Path, kind: str, protocol: int) -> None:
    sparse = pytest.importorskip("scipy.sparse", reason="writes the matrices")
    dense = np.array([[0.0, 2.0, 0.0, 1.0], [0.0, 0.0, 3.0, 0.0]])
    path = tmp_path / "regressor.pkl"
    path.write_bytes(pickle.dumps(getattr(sparse, f"{kind}_matrix")(dense), protocol))
    np.testing.assert_array_equal(load_pickle(path), dense)


class _Hostile:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.target),)

    def __init__(self, target: Path) -> None:
        self.target = target


def test_code_is_refused_and_not_run(tmp_path: Path) -> None:
    path, target = tmp_path / "evil.pkl", tmp_path / "made"
    path.write_bytes(pickle.dumps(_Hostile(target)))
    with pytest.raises(PickleError, match=rf"evil.pkl: refused, .* names {os.mkdir.__module__}"):
        load_pickle(path)
    np.save(tmp_path / "evil.npy", np.array(_Hostile(target), dtype=object))
    with pytest.raises(PickleError, match=r"evil.npy: refused"):
        load_npy(tmp_path / "evil.npy")
    assert not target.exists()


@pytest.mark.parametrize(
    "name",
    ["builtins eval", "builtins getattr", "os system", "numpy.core.numeric load", "chumpy.ch x"],
)
def test_names_off_the_list_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "evil.pkl"
    path.write_bytes(b"c" + name.replace(" ", "\n").encode() + b"\n.")
    with pytest.raises(PickleError, match=name.replace(" ", ".")):
        load_pickle(path)


def test_a_pickle_cannot_change_our_classes(tmp_path: Path) -> None:
    """BUILD with (None, slots) would set attributes of the class itself."""
    path = tmp_path / "evil.pkl"
    slots = pickle.dumps((None, {"__setstate__": None}), 2)[2:-1]
    path.write_bytes(b"\x80\x02cchumpy.ch\nCh\n" + slots + b"b.")
    with pytest.raises(PickleError, match="not a readable pickle"):
        load_pickle(path)


def test_other_codecs_and_other_classes_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "evil.pkl"
    path.write_bytes(b"c_codecs\nencode\n(Vabc\nVrot13\ntR.")
    with pytest.raises(PickleError, match="the codec 'rot13'"):
        load_pickle(path)
    path.write_bytes(b"ccopy_reg\n_reconstructor\n(c__builtin__\nlist\nc__builtin__\nlist\n]tR.")
    with pytest.raises(PickleError, match="makes an object of"):
        load_pickle(path)


def test_a_sparse_bomb_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.pkl"
    state = {"_shape": (10**9, 10**9), "data": np.zeros(1), "indices": np.zeros(1), "indptr": [0]}
    path.write_bytes(_object_pickle("scipy.sparse.csc", "csc_matrix", state))
    with pytest.raises(PickleError, match="a sparse matrix of 1000000000 x 1000000000"):
        load_pickle(path)


def test_damage_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "fit.npy"
    with pytest.raises(PickleError, match=r"fit.npy: cannot be read \(No such file"):
        load_npy(path)
    stream = io.BytesIO()
    np.save(stream, np.arange(100.0))
    for content in (b"", stream.getvalue()[:-9], stream.getvalue()[:20], pickle.dumps(FITS)[:-30]):
        path.write_bytes(content)
        with pytest.raises(PickleError, match="is the download complete"):
            load_npy(path)
