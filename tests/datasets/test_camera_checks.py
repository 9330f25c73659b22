import dataclasses

import numpy as np
import pytest

from actorsnerf_datasets.camera_checks import camera_findings
from actorsnerf_datasets.types import Camera, SequenceHeader

FLIP = np.diag([1.0, 1.0, -1.0])


def _sentences(header: SequenceHeader, camera: Camera) -> list[str]:
    changed = dataclasses.replace(header, cameras=(header.cameras[0], camera))
    return [f"{f.severity}: {f.entry}: {f.sentence}" for f in camera_findings(changed)]


def test_good_cameras_have_no_findings(header: SequenceHeader) -> None:
    assert list(camera_findings(header)) == []


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"T": np.array([np.nan, 0, 3])}, "error: cameras/T: camera c02 has NaN or infinity"),
        (
            {"R": np.eye(3) * 1.001},
            "error: cameras/R: camera c02: R deviates from orthonormal by 0.",
        ),
        ({"R": FLIP}, "error: cameras/R: camera c02: R is left-handed (determinant -1)"),
        ({"K": np.eye(3) - 2 * np.eye(3)}, "error: cameras/K: camera c02: no intrinsics"),
        ({"T": np.array([0.0, 0.0, 3000.0])}, "error: cameras/T: camera c02 is 3000 m from the"),
        ({"T": np.array([0.0, 0.0, 0.003])}, "m from the person, expected 1 to 20: are the units"),
        (
            {"size": (80, 39)},
            "warning: cameras/K: camera c02: the optical axis meets (40, 40), out",
        ),
        (
            {"source_size": (100, 160)},
            "warning: cameras/size: camera c02: (80, 80), but the source",
        ),
    ],
)
def test_each_fault_is_named(
    header: SequenceHeader, changes: dict[str, object], sentence: str
) -> None:
    camera = dataclasses.replace(header.cameras[1], **changes)  # type: ignore[arg-type]
    assert any(sentence in found for found in _sentences(header, camera))


def test_a_forgotten_half_pixel_is_noticed(header: SequenceHeader) -> None:
    camera = header.cameras[1]
    halved = camera.source_K * [[0.5], [0.5], [1.0]]
    found = _sentences(header, dataclasses.replace(camera, K=halved))
    assert found == ["warning: cameras/K: camera c02: K is 0.25 px off the source's K at scale 0.5"]
