from actorsnerf_train.report.contestants import chosen_points
from actorsnerf_train.report.points import POINTS


def test_points_can_be_chosen() -> None:
    assert chosen_points(()) == POINTS
    assert [point.name for point in chosen_points(("fast",))] == [
        "reference",
        "complete",
        "exact",
        "fast",
    ]
