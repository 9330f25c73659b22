"""Each method as the trainings see it: its parts, and the actor states that a step needs.

A class is chosen by name here and nowhere else in this package.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actorsnerf import ActorsNeRF, ActorsNeRFConfig
from actorsnerf_model.humannerf import HumanNeRF, HumanNeRFConfig
from actorsnerf_model.learned_method import LearnedMethod
from actorsnerf_model.neuralbody import NeuralBody, NeuralBodyConfig
from actorsnerf_model.published_order import PublishedOrder
from actorsnerf_train.config import TrainConfig
from actorsnerf_train.schedule import open_bands

DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
AnyMethod: TypeAlias = LearnedMethod[Any, Any, Any]
"""Its states are its own business."""


@dataclass(frozen=True)
class KnownActor:
    """What a training keeps of an actor between steps: whatever takes no gradient."""

    geometry: Any
    """Of the method."""
    prior: Any | None
    """Where the category prior is frozen: support maps and skinning volume, made once."""


def build_method(config: TrainConfig, device: torch.device) -> AnyMethod:
    """The method with random weights from the configuration's seed."""
    state = torch.get_rng_state()
    torch.manual_seed(config.seed)
    dtype = DTYPES[config.precision]
    method: AnyMethod
    match config.model:
        case ActorsNeRFConfig():
            method = ActorsNeRF(config.model, dtype)
        case HumanNeRFConfig():
            method = HumanNeRF(config.model, dtype)
        case NeuralBodyConfig():
            method = NeuralBody(config.model, dtype)
    torch.set_rng_state(state)
    return method.to(device)


def as_published(method: AnyMethod) -> PublishedOrder | AnyMethod:
    """The method with its field in the published order of operations.

    The baselines are themselves: of their products only a frame's and a pose's share are moved.
    """
    return PublishedOrder(method) if isinstance(method, ActorsNeRF) else method


def actorsnerf(method: AnyMethod) -> ActorsNeRF:
    """The method, which must be ActorsNeRF."""
    assert isinstance(method, ActorsNeRF), type(method)
    return method


def octaves_of(config: TrainConfig) -> int:
    """Octaves of the deformation's encoding; 0 where the method has none."""
    match config.model:
        case ActorsNeRFConfig():
            return config.model.deformation_net.octaves
        case HumanNeRFConfig():
            return 0 if config.model.motion is None else config.model.motion.octaves
        case NeuralBodyConfig():
            return 0


def trunk_of(config: TrainConfig) -> str | None:
    """The name of the encoder's trunk; None where the method looks at no support picture."""
    model = config.model
    if isinstance(model, ActorsNeRFConfig) and (model.pixel_features or model.body_features):
        return model.encoder.trunk
    return None


def window_at(config: TrainConfig, step: int) -> float:
    """Open bands of the deformation's encoding at a step; 0 leaves the deformation out."""
    return open_bands(config.schedule, step, octaves_of(config))


def know_actor(method: AnyMethod, supports: tuple[View, ...]) -> KnownActor:
    """What can be kept of the actor that the support views show."""
    with torch.no_grad():
        geometry = method.geometry(supports[0])
        prior = method.category_prior(supports, geometry) if method.prior_frozen else None
    return KnownActor(geometry, prior)


def prior_of(method: AnyMethod, supports: tuple[View, ...], known: KnownActor) -> Any:
    """The actor's category prior: the kept one, or one with gradients."""
    return known.prior or method.category_prior(supports, known.geometry)


def step_state(
    method: AnyMethod, supports: tuple[View, ...], known: KnownActor, window: float
) -> tuple[Any, Float[Tensor, ""]]:
    """The actor's state with gradients where parts train, and the skinning volume's residual.

    The residual is the mean over voxels of the sum over channels of the absolute logits that the
    decoder adds to the prior (released code; the paper says L1 between weights and prior).
    """
    prior = prior_of(method, supports, known)
    return method.instance_state(prior, window), method.skinning_residual(prior)
