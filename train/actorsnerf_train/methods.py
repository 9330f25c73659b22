"""Each method as the trainings see it: its parts, and the actor states that a step needs.

A class is chosen by name here and nowhere else in this package.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import ActorGeometry, ActorsNeRFState, CategoryPrior
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_train.config import PartName, TrainConfig
from actorsnerf_train.schedule import open_bands

DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}


@dataclass(frozen=True)
class KnownActor:
    """What a training keeps of an actor between steps: whatever takes no gradient."""

    geometry: ActorGeometry
    prior: CategoryPrior | None
    """Where encoder and skinning are frozen: support maps and skinning volume, made once."""


def build_method(config: TrainConfig, device: torch.device) -> ActorsNeRF:
    """The method with random weights from the configuration's seed."""
    match config.method:
        case "actorsnerf":
            state = torch.get_rng_state()
            torch.manual_seed(config.seed)
            method = ActorsNeRF(config.model, DTYPES[config.precision])
            torch.set_rng_state(state)
            return method.to(device)


def parts_of(method: ActorsNeRF) -> dict[PartName, nn.Module]:
    """The parts that have a learning rate of their own; those switched off are absent."""
    parts: dict[PartName, nn.Module | None] = {
        "encoder": method.encoder,
        "skinning": method.skinning,
        "deformation": method.deformation,
        "sparse": method.sparse,
        "radiance": method.radiance,
    }
    return {name: part for name, part in parts.items() if part is not None}


def window_at(config: TrainConfig, step: int) -> float:
    """Open bands of the deformation's encoding at a step; 0 leaves the deformation out."""
    return open_bands(config.schedule, step, config.model.deformation_net.octaves)


def know_actor(method: ActorsNeRF, supports: tuple[View, ...]) -> KnownActor:
    """What can be kept of the actor that the support views show."""
    with torch.no_grad():
        geometry = method.geometry(supports[0])
        prior = method.category_prior(supports, geometry) if method.prior_frozen else None
    return KnownActor(geometry, prior)


def step_state(
    method: ActorsNeRF, supports: tuple[View, ...], known: KnownActor, window: float
) -> tuple[ActorsNeRFState, Float[Tensor, ""]]:
    """The actor's state with gradients where parts train, and the skinning volume's residual.

    The residual is the mean over voxels of the sum over channels of the absolute logits that the
    decoder adds to the prior (released code; the paper says L1 between weights and prior).
    """
    prior = known.prior or method.category_prior(supports, known.geometry)
    residual = prior.body.residual.abs().sum(dim=0).mean()
    return method.instance_state(prior, window), residual
