import pytest

from actorsnerf_train.labels import METHODS, PARTS, label_from, left_out


@pytest.mark.parametrize(
    ("method", "without", "scratch", "label"),
    [
        ("actorsnerf", (), False, "ActorsNeRF"),
        ("actorsnerf", ("pixel_features", "body_features"), False, None),
        ("actorsnerf", (), True, "ActorsNeRF, from scratch"),
        ("humannerf", (), True, "HumanNeRF"),
        ("neuralbody", ("deformation",), True, "Neural Body"),
        ("actorsnerf-baked", (), False, "actorsnerf-baked"),
    ],
)
def test_labels(method: str, without: tuple[str, ...], scratch: bool, label: str | None) -> None:
    expected = label or "ActorsNeRF, no pixel features, no SMPL features"
    assert label_from(method, without, scratch) == expected


def test_what_is_switched_off_is_left_out() -> None:
    assert left_out({"model": dict.fromkeys(PARTS, False)}) == tuple(PARTS)
    assert left_out({"model": dict.fromkeys(PARTS, True)}) == ()
    assert left_out({"model": {}}) == left_out({}) == ()
    assert set(METHODS) == {"actorsnerf", "humannerf", "neuralbody"}
