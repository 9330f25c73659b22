"""What both trainings need of a method beyond rendering: parts that learn, and states in stages.

    view -> geometry -> category prior -> instance state

Geometry never learns. The category prior is made of the parts that few-shot fitting freezes, so it
is made once there and each step elsewhere. The instance state is made anew whenever weights change.
"""

import copy
from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from typing import Any, Generic, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.states import Field, Located, PoseState

Geometry = TypeVar("Geometry")
Prior = TypeVar("Prior")
State = TypeVar("State")
Same = TypeVar("Same", bound="LearnedMethod[Any, Any, Any]")


class LearnedMethod(nn.Module, ABC, Generic[Geometry, Prior, State]):
    """A method that can be trained; keeps the contract of `states.Method`."""

    prior_frozen: bool = False
    """Whether the category prior stands still: its parts are frozen, or it has none that learn."""
    reads_directions: bool = False
    """Whether colour depends on the side that a point is seen from."""
    canonical_space: bool = True
    """Whether located points lie in one frame for all poses."""

    def __init__(self, network_dtype: torch.dtype) -> None:
        """Nothing but the precision of products inside networks."""
        super().__init__()
        self.network_dtype = network_dtype

    def networks(self, like: Tensor) -> AbstractContextManager[None]:
        """Autocast to the networks' precision on the tensor's device."""
        return torch.autocast(
            like.device.type,
            dtype=self.network_dtype if self.network_dtype != torch.float32 else None,
            enabled=self.network_dtype != torch.float32,
        )

    def in_precision(self: Same, network_dtype: torch.dtype) -> Same:
        """The same method, weights shared, with another precision of products inside networks."""
        same = copy.copy(self)
        same.network_dtype = network_dtype
        return same

    @abstractmethod
    def parts(self) -> dict[str, nn.Module]:
        """The parts that have a learning rate of their own; those switched off are absent."""

    @abstractmethod
    def freeze_category_prior(self) -> None:
        """Stops the category-level parts from learning, running statistics included."""

    @abstractmethod
    def geometry(self, view: View) -> Geometry:
        """What follows from the actor's body at rest; keep it, one per actor."""

    @abstractmethod
    def category_prior(self, supports: tuple[View, ...], geometry: Geometry | None = None) -> Prior:
        """What the category-level parts make of an actor.

        Args:
            supports: the K support views.
            geometry: of their actor, where it was kept.
        """

    @abstractmethod
    def instance_state(self, prior: Prior, window: float) -> State:
        """The whole state from a category prior.

        Args:
            prior: of the same weights.
            window: open bands of the deformation's encoding; <= 0 leaves the deformation out.
        """

    @abstractmethod
    def skinning_residual(self, prior: Prior) -> Float[Tensor, ""]:
        """Size of the learned logits beside the skinning prior; a regulariser pulls it to 0."""

    def actor_state(self, supports: tuple[View, ...], window: float) -> State:
        """What depends on the actor alone; differentiable where its parts train."""
        return self.instance_state(self.category_prior(supports), window)

    @abstractmethod
    def pose_state(
        self,
        actor: State,
        pose: Float[Tensor, "24 3"],
        rest_joints: Float[Tensor, "24 3"],
        frame: int | None = None,
    ) -> PoseState:
        """What depends on the pose alone.

        Args:
            actor: of `instance_state`.
            pose: axis-angle of each joint, radians.
            rest_joints: of the posed body, metres.
            frame: number of the frame that is learned from, for a method that knows frames; None,
                or one that it has not seen, stands for any other frame.
        """

    @abstractmethod
    def locate(
        self, actor: State, pose: PoseState, points: Float[Tensor, "points 3"], threshold: float
    ) -> Located:
        """The points (body frame) whose likelihood reaches the threshold, in canonical space."""

    @abstractmethod
    def field(self, actor: State, pose: PoseState, located: Located) -> Field:
        """Colour and density at located points."""
