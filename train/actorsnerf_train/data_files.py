"""The prepared files of a training: found, checked, and whether they may be trained on."""

from collections.abc import Sequence
from pathlib import Path

from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.shell import quoted
from actorsnerf_train.checkpoint import DataFile, Origin

SUFFIX = ".h5"
BLACK = (0.0, 0.0, 0.0)
WHITE = (1.0, 1.0, 1.0)
BACKGROUNDS = {"zju-mocap": BLACK, "aist++": WHITE, "synthetic": BLACK, "converted": BLACK}
"""What a data set's persons stand on (released code)."""


def training_files(data: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """The files to pre-train on, and what to tell about those left out.

    Of a folder, the files of actors that are held out for testing are left out, and named; so are
    all files of an actor that another of the files holds out. A held-out file that is itself named
    is taken, and refused when it is read. A file that is named twice, or by its folder too, counts
    once.

    Raises:
        UserError: nothing is there.
    """
    files = tuple({f.resolve(): f for path in data for f in _files_at(path)}.values())
    named = {path.resolve() for path in data}
    tested: set[Path] = set()
    held_out: dict[str, str] = {}
    actors: dict[Path, str] = {}
    for file in files:
        with SequenceFile(file) as sequence:
            header = sequence.header
        actors[file] = header.actor
        if any(protocol.role == "held_out" for protocol in header.protocols):
            tested.add(file)
            held_out.setdefault(header.actor, file.name)
    chosen: list[Path] = []
    left_out: list[str] = []
    for file in files:
        actor = actors[file]
        if actor not in held_out or (file in tested and file.resolve() in named):
            chosen.append(file)
        elif file in tested:
            left_out.append(f"{file.name}: actor {actor} is held out for testing")
        else:
            place = held_out[actor]
            left_out.append(f"{file.name}: actor {actor} is held out for testing in {place}")
    if not chosen:
        raise UserError(
            f"{', '.join(map(str, data))}: no file to pre-train on; every actor is held out for "
            "testing. Prepare other actors, or fewer --held-out."
        )
    return tuple(chosen), tuple(left_out)


def check_files(paths: Sequence[Path]) -> None:
    """Nothing, if every file passes its check.

    Raises:
        UserError: one does not; the first finding is quoted.
    """
    for path in paths:
        errors = [f for f in check_sequence(path, None) if f.severity == "error"]
        if errors:
            more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
            raise UserError(
                f"{path}: fails its check: {errors[0].sentence}{more}. All findings: "
                f"python -m actorsnerf_datasets check {quoted(path)}"
            )


def background_of(paths: Sequence[Path]) -> tuple[float, float, float]:
    """The colour that the files' persons stand on.

    Raises:
        UserError: the files are of data sets with different colours.
    """
    found = {p: BACKGROUNDS[SequenceFile(p).header.provenance.dataset] for p in paths}
    colours = set(found.values())
    if len(colours) > 1:
        black, white = (next(p for p, c in found.items() if c == one) for one in (BLACK, WHITE))
        raise UserError(
            f"{black} is of a data set on black and {white} of one on white: one training has one "
            "background, so train on the data sets separately."
        )
    return colours.pop()


def describe_file(path: Path) -> DataFile:
    """What a checkpoint remembers of a file."""
    with SequenceFile(path) as file:
        return DataFile(str(path), file.header.sequence, file.header.actor, file.digest)


def refuse_leakage(actor: str, file: Path, origin: Origin) -> None:
    """Nothing, if the category training has not seen the actor.

    Raises:
        UserError: it has.
    """
    seen = [known.path for known in origin.category_data if known.actor == actor]
    if seen:
        raise UserError(
            f"{file}: actor {actor} was in the category training already ({seen[0]}); few-shot "
            "results on a known person mean nothing: take another actor, or pretrain without."
        )


def _files_at(path: Path) -> list[Path]:
    """The prepared files of a folder, by name; a file is itself.

    Raises:
        UserError: the folder holds none.
    """
    if not path.is_dir():
        return [path]
    inside = sorted(path.glob(f"*{SUFFIX}"))
    if not inside:
        raise UserError(
            f"{path}: holds no prepared file (*{SUFFIX}): prepare a download first: "
            "python -m actorsnerf_preprocess prepare --source DOWNLOAD --out FOLDER"
        )
    return inside
