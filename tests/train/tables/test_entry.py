from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.tables.entry import gather, refuse_unequal

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult


def test_labels_say_method_missing_parts_and_origin(write: "WriteResult", tmp_path: Path) -> None:
    scores = (25.0, 0.9, 50.0)
    write(scores)
    write(scores, method="humannerf", pretrained_from=None)
    write(scores, pretrained_from=None)
    write(scores, configuration={"model": {"deformation": False, "pixel_features": True}})
    write(scores, configuration={"model": {"body_features": False}}, pretrained_from=None)
    labels = [entry.label for entry in gather([tmp_path])]
    assert labels == [
        "ActorsNeRF",
        "HumanNeRF",
        "ActorsNeRF, from scratch",
        "ActorsNeRF, no deformation",
        "ActorsNeRF, no SMPL features, from scratch",
    ]


def test_a_result_is_counted_once_and_category_results_are_left_out(
    write: "WriteResult", tmp_path: Path
) -> None:
    path = write((25.0, 0.9, 50.0))
    write((25.0, 0.9, 50.0), setting=None)
    assert [entry.path for entry in gather([tmp_path, path, path.parent])] == [path]


def test_nothing_to_gather(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no result of a few-shot training"):
        gather([tmp_path])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"data_sha256": "1" * 64}, "actor eve was measured on another data_sha256"),
        ({"frames": (30,)}, "actor eve was measured on another frames"),
        ({"cameras": ("c1", "c2")}, "actor eve was measured on another cameras"),
        ({"background": (1.0, 1.0, 1.0)}, "actor eve was measured on another background"),
        ({"dataset": "aist++", "actor": "d16"}, "its dataset is aist"),
        ({"preset": "tiny", "actor": "zoe"}, "its preset is tiny"),
        (
            {"configuration": {"model": {"deformation": True}, "rates": {}}, "actor": "zoe"},
            r"its rates are not those of .*, which is ActorsNeRF too",
        ),
    ],
)
def test_what_cannot_share_a_table_is_refused(
    write: "WriteResult", tmp_path: Path, changes: dict[str, object], said: str
) -> None:
    write((25.0, 0.9, 50.0))
    write((26.0, 0.9, 40.0), seed=1)
    refuse_unequal(gather([tmp_path]))
    write((25.0, 0.9, 50.0), **changes)
    with pytest.raises(UserError, match=said):
        refuse_unequal(gather([tmp_path]))


def test_a_convention_that_was_not_measured(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.9, 50.0))
    (entry,) = gather([tmp_path])
    assert entry.mean("box").psnr == 23.0
    with pytest.raises(UserError, match=r"no figures under the convention strict \(it has paper"):
        entry.mean("strict")
