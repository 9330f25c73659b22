from actorsnerf_datasets.layout import ENTRIES
from actorsnerf_datasets.shapes import Form, misfits

SIZES = {"C": 2, "F": 5, "N": 7, "H": 16, "W": 8, "V": 40, "J": 24, "B": 10, "S": 0}


def _forms() -> dict[str, Form]:
    return {
        entry.path: Form(
            tuple(int(axis) if axis.isdigit() else SIZES[axis] for axis in entry.axes), entry.dtype
        )
        for entry in ENTRIES
    }


def _sentences(forms: dict[str, Form]) -> list[str]:
    return [f"{misfit.entry} {misfit.sentence}" for misfit in misfits(forms)]


def test_what_fits_has_no_misfits() -> None:
    assert _sentences(_forms()) == []


def test_each_misfit_is_named() -> None:
    forms = _forms()
    del forms["pictures/alpha"]
    forms["fits/transl"] = Form((4, 3), "float64")
    forms["fits/betas"] = Form((5, 10), "float32")
    forms["cameras/K"] = Form((2, 9), "float64")
    forms["actor/rest_joints"] = Form((25, 3), "float64")
    assert _sentences(forms) == [
        "cameras/K has shape (2, 9), expected axes (C, 3, 3)",
        "fits/transl has shape (4, 3), but axis F is 5 (from frames/number)",
        "fits/betas has dtype float32, expected float64",
        "actor/rest_joints has shape (25, 3), but axis J is 24 (from the layout)",
        "pictures/alpha is missing",
    ]
