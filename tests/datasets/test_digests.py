import hashlib
from pathlib import Path

import h5py
import numpy as np

from actorsnerf_datasets.digests import digest_of_arrays, digest_of_dataset, digest_of_strings


def test_bytes_in_c_order_little_endian() -> None:
    array = np.arange(6, dtype=np.int32).reshape(2, 3)
    expected = hashlib.sha256(b"".join(n.to_bytes(4, "little") for n in range(6))).hexdigest()
    assert digest_of_arrays([array]) == expected
    assert digest_of_arrays([array[:1], array[1:]]) == expected
    assert digest_of_arrays([array.astype(">i4")]) == expected
    assert digest_of_arrays([np.asfortranarray(array)]) == expected


def test_strings_are_lines() -> None:
    assert digest_of_strings(["a", "ü"]) == hashlib.sha256("a\nü\n".encode()).hexdigest()


def test_a_dataset_has_the_digest_of_its_array(tmp_path: Path) -> None:
    array = np.arange(24, dtype=np.float64).reshape(4, 3, 2)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        whole = file.create_dataset("whole", data=array)
        chunked = file.create_dataset("chunked", data=array, chunks=(3, 3, 2), compression="gzip")
        flags = file.create_dataset("flags", data=array > 3)
        names = file.create_dataset("names", data=["a", "ü"], dtype=h5py.string_dtype())
        assert digest_of_dataset(whole) == digest_of_dataset(chunked) == digest_of_arrays([array])
        assert digest_of_dataset(flags) == digest_of_arrays([(array > 3).astype(np.uint8)])
        assert digest_of_dataset(names) == digest_of_strings(["a", "ü"])
