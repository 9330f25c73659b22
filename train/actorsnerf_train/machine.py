"""Which machine and which program made a number."""

import os
import platform
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import torch


@dataclass(frozen=True)
class Machine:
    """What a time was measured on."""

    device: str
    """Name of the accelerator, or "cpu"."""
    processor: str
    cores: int
    threads: int
    """That torch uses."""
    torch: str
    platform: str


def this_machine(device: torch.device) -> Machine:
    """The machine this runs on; `device` is the one that computes."""
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else device.type
    return Machine(
        device=name,
        processor=_processor(),
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else _all_cores(),
        threads=torch.get_num_threads(),
        torch=torch.__version__,
        platform=f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
    )


def program_commit() -> str | None:
    """The commit of the checkout this runs from, "+" appended if files differ from it.

    None outside a checkout, or where git is missing.
    """
    git = shutil.which("git")
    here = Path(__file__).resolve().parent
    if git is None:
        return None
    head = _git_output(git, here, "rev-parse", "--verify", "HEAD")
    tracked = _git_output(git, here, "ls-files", "--error-unmatch", Path(__file__).name)
    if head is None or tracked is None:  # an installed copy inside somebody else's checkout
        return None
    changed = _git_output(git, here, "status", "--porcelain", "--untracked-files=no")
    return head + ("+" if changed else "")


def _git_output(git: str, folder: Path, *arguments: str) -> str | None:
    done = subprocess.run(
        [git, "-C", str(folder), *arguments], capture_output=True, text=True, check=False
    )
    return done.stdout.strip() if done.returncode == 0 else None


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _all_cores() -> int:
    return os.cpu_count() or 1
