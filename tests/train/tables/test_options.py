from pathlib import Path
from typing import get_args

from actorsnerf_train.tables.options import (
    ABLATED,
    BASELINES,
    WITHOUT_CATEGORY,
    MethodRow,
    TablesOptions,
)


def test_every_row_is_known_for_what_it_is() -> None:
    rows = set(get_args(MethodRow))
    assert {row for row in rows if row.startswith("no-")} == set(ABLATED)
    assert set(BASELINES) == {"humannerf", "neuralbody"}
    assert rows - set(ABLATED) - set(WITHOUT_CATEGORY) == {"actorsnerf"}


def test_by_default_both_baselines_are_rows() -> None:
    assert TablesOptions(Path("out")).methods == ("actorsnerf", *BASELINES)
