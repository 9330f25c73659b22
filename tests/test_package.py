"""The repository keeps its own promises: mirrored tests, short functions, honest commands."""

import ast
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PARTS = ("datasets", "preprocess", "model", "train")
LONGEST_FUNCTION = 55
LONGEST_MODULE = 420
# Modules whose whole content is names, constants or a command line that other tests run.
NO_TEST_OF_THEIR_OWN = {"__init__", "errors", "layout", "types", "states"}


def modules() -> list[Path]:
    """Every module of the four packages."""
    return sorted(
        path for part in PARTS for path in (ROOT / part / f"actorsnerf_{part}").rglob("*.py")
    )


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.stem)
def test_each_module_has_a_mirrored_test(path: Path) -> None:
    if path.stem in NO_TEST_OF_THEIR_OWN:
        return
    name = "main" if path.stem == "__main__" else path.stem
    part, _, *folders = path.relative_to(ROOT).parent.parts
    assert (ROOT / "tests").joinpath(part, *folders, f"test_{name}.py").is_file()


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.stem)
def test_no_long_tail(path: Path) -> None:
    text = path.read_text()
    assert text.count("\n") <= LONGEST_MODULE
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            docstring = ast.get_docstring(node, clean=False) or ""
            assert node.end_lineno is not None
            lines = node.end_lineno - node.lineno - docstring.count("\n")
            assert lines <= LONGEST_FUNCTION, f"{node.name} has {lines} lines"


def test_no_pickle_is_opened_but_by_the_restricted_unpickler() -> None:
    for path in modules():
        # workers reads back what its own run wrote, after comparing the digest in its task.
        if path.stem in ("pickles", "workers"):
            continue
        text = path.read_text()
        for word in ("allow_pickle=True", "pickle.load"):
            assert word not in text, f"{path.name} has {word}"
        for call in re.findall(r"(?<!safetensors\.)torch\.load\([^)]*\)", text):
            assert "weights_only=True" in call, f"{path.name} has {call}"


def test_the_readme_names_only_targets_that_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"^\s*make ([a-z-]+)", (ROOT / "README.md").read_text(), re.MULTILINE))
    assert named <= targets


def test_ci_runs_the_readmes_test_command() -> None:
    assert "make test" in (ROOT / ".ci" / "run").read_text()
    assert "make test" in (ROOT / "README.md").read_text()


def test_a_reader_needs_only_numpy_and_h5py() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    names = {re.split(r"[<>=]", text)[0] for text in project["dependencies"]}
    assert names == {"numpy", "h5py"}


def test_no_data_under_licence_is_tracked() -> None:
    names = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.lower()
    for word in ("smpl_neutral", "smpl_male", "smpl_female", "basicmodel", "coreview_"):
        assert word not in names
