from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from tests.train.tables.configured import tuned, without

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.config import Every, fewshot, neuralbody, of_person
from actorsnerf_train.records import to_json_object
from actorsnerf_train.tables.entry import gather, refuse_unequal

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult


def test_labels_say_method_missing_parts_and_origin(write: "WriteResult", tmp_path: Path) -> None:
    scores = (25.0, 0.9, 50.0)
    write(scores)
    write(scores, method="humannerf", pretrained_from=None)
    write(scores, pretrained_from=None)
    write(scores, configuration=without("deformation"))
    write(scores, configuration=without("body_features"), pretrained_from=None)
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


def test_a_place_that_is_not_there_is_refused(write: "WriteResult", tmp_path: Path) -> None:
    path = write((25.0, 0.9, 50.0))
    with pytest.raises(UserError, match="typo: no such folder or result"):
        gather([path, tmp_path / "typo"])


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
            {"configuration": to_json_object(tuned(scale=9.0)), "actor": "zoe"},
            r"which is ActorsNeRF too \(rates/scale is 2.0 there, 9.0 here\)",
        ),
        (
            {"configuration": to_json_object(replace(tuned(), precision="bfloat16"))},
            r"\(precision is 'float32' there, 'bfloat16' here\)",
        ),
        ({"point": "fast"}, r"\(point is None there, 'fast' here\)"),
        ({"render_options": {"samples": 4}}, r"\(rendering/samples is 8 there, 4 here\)"),
    ],
)
def test_what_cannot_share_a_table_is_refused(
    write: "WriteResult", tmp_path: Path, changes: dict[str, object], said: str
) -> None:
    write((25.0, 0.9, 50.0))
    write((26.0, 0.9, 40.0), seed=1)
    refuse_unequal(gather([tmp_path]))
    write((25.0, 0.9, 50.0), seed=2, **changes)
    with pytest.raises(UserError, match=said):
        refuse_unequal(gather([tmp_path]))


def test_what_chance_steps_and_the_person_change_shares_a_row(
    write: "WriteResult", tmp_path: Path
) -> None:
    config = neuralbody("small")
    write((25.0, 0.9, 50.0), method="neuralbody", configuration=to_json_object(config))
    longer = replace(config.schedule, steps=9)
    other = replace(of_person(config, 7, (1, 2)), seed=3, schedule=longer, every=Every(log=1))
    changes = {"method": "neuralbody", "configuration": to_json_object(other), "seed": 3}
    write((25.0, 0.9, 50.0), **changes)
    refuse_unequal(gather([tmp_path]))


def test_results_recorded_before_a_setting_was_there(write: "WriteResult", tmp_path: Path) -> None:
    """A key that an older version did not write has its default."""
    write((25.0, 0.9, 50.0))
    older = to_json_object(fewshot("small"))
    del older["background"]
    write((25.0, 0.9, 50.0), seed=1, configuration=older)
    refuse_unequal(gather([tmp_path]))


def test_a_result_in_two_places_counts_once(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.9, 50.0))
    write((25.0, 0.9, 50.0), checkpoint="a copy")
    assert len(gather([tmp_path])) == 1
    write((25.5, 0.9, 50.0))  # the same run, evaluated otherwise
    with pytest.raises(UserError, match=r"same row \(ActorsNeRF\).*would count as one more seed"):
        gather([tmp_path])


def test_a_convention_that_was_not_measured(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.9, 50.0))
    (entry,) = gather([tmp_path])
    assert entry.mean("box").psnr == 23.0
    with pytest.raises(UserError, match=r"no figures under the convention strict \(it has paper"):
        entry.mean("strict")
