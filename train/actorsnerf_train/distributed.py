"""Several processes on one training: started by torchrun, gradients averaged over all of them."""

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from actorsnerf_datasets.errors import UserError


@dataclass(frozen=True)
class Team:
    """This process among all that train together."""

    rank: int = 0
    processes: int = 1

    @property
    def leads(self) -> bool:
        """Whether this process writes files and prints."""
        return self.rank == 0

    def wait(self) -> None:
        """Go on when every process has come here."""
        if self.processes > 1:
            distributed.barrier()


@contextmanager
def team(device: torch.device) -> Iterator[Team]:
    """The team that torchrun started this process in; alone without torchrun.

    Raises:
        UserError: torchrun's variables are incomplete.
    """
    processes = int(os.environ.get("WORLD_SIZE", "1"))
    if processes == 1:
        yield Team()
        return
    missing = [name for name in ("RANK", "MASTER_ADDR", "MASTER_PORT") if name not in os.environ]
    if missing:
        raise UserError(
            f"WORLD_SIZE is {processes} but {', '.join(missing)} is not set: start with "
            "torchrun --nproc-per-node N -m actorsnerf_train …, or unset WORLD_SIZE."
        )
    if device.type == "cuda":
        torch.cuda.set_device(device)  # else each process would also wake the first GPU
    distributed.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield Team(distributed.get_rank(), processes)
    finally:
        distributed.destroy_process_group()


def refuse_company() -> None:
    """Nothing, if this process is alone: several would do the same work and write the same files.

    Raises:
        UserError: torchrun has started several.
    """
    processes = os.environ.get("WORLD_SIZE", "1")
    if processes != "1":
        raise UserError(
            f"WORLD_SIZE is {processes}, but only pretrain and fewshot share their work out: start "
            "this command without torchrun, or unset WORLD_SIZE."
        )


def local_device(name: str) -> torch.device:
    """The device of this process; "cuda" under torchrun is the process's own GPU.

    Raises:
        UserError: there is no such device.
    """
    local = os.environ.get("LOCAL_RANK", "0")
    try:
        device = torch.device(f"cuda:{local}" if name == "cuda" else name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"--device {name}: cannot be used here ({reason}); try cpu.") from None
    return device


def shared(objective: nn.Module, team: Team) -> nn.Module:
    """The objective with gradients averaged over the team; itself where the team is one.

    Parts may be unused in a step (the deformation before its kick-in), so torch looks for them.
    Buffers are not exchanged: the leader's are those that are saved, and the others' differ only in
    running statistics, which no training step reads.
    """
    if team.processes == 1:
        return objective
    return DistributedDataParallel(objective, find_unused_parameters=True, broadcast_buffers=False)


def gathering(objective: nn.Module, last: bool) -> AbstractContextManager[None]:
    """The context of one of a step's passes: gradients are exchanged with the last one only."""
    if last or not isinstance(objective, DistributedDataParallel):
        return nullcontext()
    return objective.no_sync()
