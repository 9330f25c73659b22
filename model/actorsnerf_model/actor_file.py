"""Support views as plain tensors and back: a few-shot checkpoint renders with no data file.

The K views carry all that an actor's state is made of: pictures, cameras, poses, rest joints and
vertices. Pictures are stored as bytes where that loses nothing.
"""

import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View

NUMBERS = (
    "image",
    "alpha",
    "K",
    "camera_from_body",
    "pose",
    "rest_joints",
    "rest_vertices",
    "posed_vertices",
    "canonical_joints",
)
"""The fields of a view that are tensors."""
PICTURES = ("image", "alpha")
NAMES = ("actor", "camera")
"""The fields that are text; stored as UTF-8."""
PLACE = "place"
"""Frame, offset x, y, and full size x, y."""


def support_tensors(supports: tuple[View, ...]) -> dict[str, Tensor]:
    """The views under the names `<number>.<field>`, on the CPU, ready for safetensors."""
    tensors = {}
    for number, view in enumerate(supports):
        for name in NUMBERS:
            values = getattr(view, name).detach().cpu()
            small = _as_bytes(values) if name in PICTURES else None
            tensors[f"{number}.{name}"] = values.clone() if small is None else small
        for name in NAMES:
            text = bytearray(getattr(view, name).encode())
            tensors[f"{number}.{name}"] = torch.tensor(list(text), dtype=torch.uint8)
        place = [view.frame, *view.offset, *view.full_size]
        tensors[f"{number}.{PLACE}"] = torch.tensor(place)
    return tensors


def supports_from_tensors(tensors: dict[str, Tensor], device: torch.device) -> tuple[View, ...]:
    """The views that `support_tensors` stored.

    Args:
        tensors: its result; other names are ignored.
        device: where the views go.

    Raises:
        UserError: a view or one of its fields is missing.
    """
    count = 0
    while f"{count}.{PLACE}" in tensors:
        count += 1
    if count == 0:
        raise UserError(
            f"no support views among the {len(tensors)} stored tensors (expected an entry "
            f"0.{PLACE}): is this a few-shot checkpoint?"
        )
    return tuple(_view(tensors, number, device) for number in range(count))


def _view(tensors: dict[str, Tensor], number: int, device: torch.device) -> View:
    wanted = (*NUMBERS, *NAMES, PLACE)
    missing = [name for name in wanted if f"{number}.{name}" not in tensors]
    if missing:
        raise UserError(
            f"support view {number} is stored without {', '.join(missing)}: "
            "the checkpoint is damaged or of another version; train it again"
        )
    read = {name: tensors[f"{number}.{name}"] for name in wanted}
    actor, camera = (bytes(read[name].tolist()).decode() for name in NAMES)
    frame, x, y, width, height = read[PLACE].tolist()
    return View(
        image=_loaded(read["image"]).to(device),
        alpha=_loaded(read["alpha"]).to(device),
        K=read["K"].to(device),
        camera_from_body=read["camera_from_body"].to(device),
        pose=read["pose"].to(device),
        rest_joints=read["rest_joints"].to(device),
        rest_vertices=read["rest_vertices"].to(device),
        posed_vertices=read["posed_vertices"].to(device),
        canonical_joints=read["canonical_joints"].to(device),
        actor=actor,
        camera=camera,
        frame=frame,
        offset=(x, y),
        full_size=(width, height),
    )


def _as_bytes(values: Float[Tensor, "*shape"]) -> UInt8[Tensor, "*shape"] | None:
    """The values times 255 where that loses nothing, else None."""
    levels = (values * 255).round()
    exact = (levels >= 0) & (levels <= 255) & (levels / 255 == values)
    return levels.to(torch.uint8) if bool(exact.all()) else None


def _loaded(stored: Tensor) -> Tensor:
    return stored.float() / 255 if stored.dtype == torch.uint8 else stored
