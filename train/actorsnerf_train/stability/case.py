"""One hard case: what is measured at three precisions, and whether it stays within its bounds."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.states import RenderOptions

Precision = Literal["float64", "float32", "bfloat16"]
PRECISIONS: tuple[Precision, ...] = ("float64", "float32", "bfloat16")
LEAST_GRADIENT = 1e-3
"""A smaller gradient counts as this large: what it lacks beside it is rounding of other terms."""


@dataclass(frozen=True)
class Subject:
    """A method and an actor at one precision.

    At bfloat16 tensors are float32, the method multiplies in bfloat16, and everything, geometry
    too, runs inside autocast to bfloat16: what must keep its precision has to see to it itself.
    """

    precision: Precision
    method: ActorsNeRF
    supports: tuple[View, ...]
    state: ActorsNeRFState
    options: RenderOptions
    poses: Float[Tensor, "poses 24 3"]
    """The fastest frames of the data, or the wildest invented ones."""

    @property
    def like(self) -> Tensor:
        """A tensor of the subject's dtype and device."""
        return self.supports[0].pose

    def tensor(self, values: Tensor) -> Tensor:
        """The values at the subject's dtype and device, rounded to float32 at every precision."""
        return values.to(torch.float32).to(self.like)

    def precisely(self) -> AbstractContextManager[None]:
        """Autocast where the precision asks for it."""
        return torch.autocast(
            self.like.device.type, torch.bfloat16, enabled=self.precision == "bfloat16"
        )


@dataclass(frozen=True)
class Answer:
    """What a case gives at one precision."""

    values: Tensor
    """Compared with the truth."""
    gradients: tuple[Tensor | None, ...] = ()
    """Of some scalar; they must be finite. None where nothing flows."""
    counted: Bool[Tensor, "..."] | None = None
    """Over leading axes of the values: where a comparison makes sense. The truth's is used."""
    note: str = ""


@dataclass(frozen=True)
class Bounds:
    """The largest allowed absolute error at each precision, in the case's unit."""

    float64: float
    float32: float
    bfloat16: float | None
    """None: only finiteness is judged."""
    gradient: float | None = None
    """Relative L2 error of each gradient tensor at float32; None: only finiteness is judged."""

    def of(self, precision: Precision) -> float | None:
        """The bound at a precision."""
        bounds = {"float64": self.float64, "float32": self.float32, "bfloat16": self.bfloat16}
        return bounds[precision]


@dataclass(frozen=True)
class Case:
    """Something that could break, and how to see whether it does."""

    group: str
    name: str
    measured: str
    """What is compared, in words, with its unit."""
    bounds: Bounds
    answer: Callable[[Subject], Answer]
    truth: Callable[[Subject], Answer] | None = None
    """An independent way to the same values, run in float64; None: the answer in float64 is it."""


@dataclass(frozen=True)
class Result:
    """A case at one precision."""

    precision: Precision
    error: float | None
    """Largest absolute error against the float64 truth; None where this is the truth itself."""
    gradient_error: float | None
    """Largest relative L2 error of a gradient tensor against float64; None without gradients."""
    finite: bool
    """Values and gradients."""
    bound: float | None


@dataclass(frozen=True)
class Row:
    """A judged case."""

    group: str
    name: str
    measured: str
    results: tuple[Result, ...]
    gradient_bound: float | None
    passed: bool
    strain: float
    """Largest error over its bound; above 1 the case fails."""
    note: str


def judged(case: Case, subjects: tuple[Subject, ...]) -> Row:
    """The case at every precision; one that breaks off has failed, and its row says why.

    Args:
        case: what to do.
        subjects: float64 first; it gives the truth.
    """
    try:
        return _judged(case, subjects)
    except (RuntimeError, ValueError) as error:
        note = f"breaks off: {str(error).splitlines()[0]}"
        return Row(case.group, case.name, case.measured, (), None, False, math.inf, note)


def _judged(case: Case, subjects: tuple[Subject, ...]) -> Row:
    reference = _run(case.answer, subjects[0])
    truth = reference if case.truth is None else _run(case.truth, subjects[0])
    results = []
    for subject in subjects:
        exact = subject.precision == "float64"
        answer = reference if exact else _run(case.answer, subject)
        error = None if exact and case.truth is None else largest_error(answer, truth)
        gradient = None if exact else _gradient_error(answer.gradients, reference.gradients)
        bound = case.bounds.of(subject.precision)
        results.append(Result(subject.precision, error, gradient, _finite(answer), bound))
    strains = [_strain(result, case.bounds) for result in results]
    strain = max(strains)
    finite = all(result.finite for result in results) and _finite(truth)
    passed = finite and strain <= 1
    note = truth.note or reference.note
    gradient_bound = case.bounds.gradient
    return Row(
        case.group, case.name, case.measured, tuple(results), gradient_bound, passed, strain, note
    )


def largest_error(answer: Answer, truth: Answer) -> float:
    """The largest absolute difference where the truth says that it counts; NaN counts as inf."""
    difference = (answer.values.double() - truth.values.double()).abs().nan_to_num(nan=math.inf)
    if truth.counted is not None:
        difference = difference[truth.counted]
    return float(difference.max()) if difference.numel() else 0.0


def _run(answer: Callable[[Subject], Answer], subject: Subject) -> Answer:
    with subject.precisely():
        return answer(subject)


def _finite(answer: Answer) -> bool:
    given = [gradient for gradient in answer.gradients if gradient is not None]
    return all(bool(torch.isfinite(tensor).all()) for tensor in (answer.values, *given))


def _gradient_error(
    gradients: tuple[Tensor | None, ...], reference: tuple[Tensor | None, ...]
) -> float | None:
    """None where there are no gradients."""
    errors = []
    for gradient, truth in zip(gradients, reference, strict=True):
        if truth is None and gradient is None:
            continue
        if truth is None or gradient is None:
            return math.inf
        away = float((gradient.double() - truth.double()).norm())
        errors.append(away / max(float(truth.norm()), LEAST_GRADIENT))
    return max(errors) if errors else None


def _strain(result: Result, bounds: Bounds) -> float:
    strain = 0.0
    if result.error is not None and result.bound is not None:
        strain = _share(result.error, result.bound)
    if result.precision == "float32" and bounds.gradient is not None and result.gradient_error:
        strain = max(strain, _share(result.gradient_error, bounds.gradient))
    return strain


def _share(error: float, bound: float) -> float:
    if bound > 0:
        return error / bound
    return math.inf if error > 0 else 0.0


__all__ = [
    "PRECISIONS",
    "Answer",
    "Bounds",
    "Case",
    "Precision",
    "Result",
    "Row",
    "Subject",
    "judged",
    "largest_error",
]
