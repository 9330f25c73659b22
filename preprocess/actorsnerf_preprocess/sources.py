"""Any source folder: which data set it holds, which of its sequences, and who is held out."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from actorsnerf_preprocess.aist import find_aist, open_aist, survey_aist
from actorsnerf_preprocess.aist_names import PAPER_SEQUENCES, dancer_of, expanded_selection
from actorsnerf_preprocess.source import Found, OpenOptions, SourceError, SourceSequence, Survey
from actorsnerf_preprocess.zju import find_zju, open_zju, survey_zju
from actorsnerf_preprocess.zju_converted import is_converted_tree
from actorsnerf_preprocess.zju_tree import is_zju_tree, subject_of

DatasetName = Literal["zju-mocap", "aist", "synthetic"]
DATASETS: dict[DatasetName, str] = {
    "zju-mocap": "ZJU-MoCap",
    "aist": "AIST++",
    "synthetic": "synthetic actors",
}
HELD_OUT_FILE = "held_out.txt"
"""Names of held-out actors, one per line, at the top of a source folder."""


def find_sources(root: Path, unfilmed: bool = False) -> tuple[Found, ...]:
    """The sequences below a folder, by name.

    Args:
        root: the folder.
        unfilmed: also AIST++'s without a video.

    Raises:
        SourceError: the folder does not exist, or holds no data set, or two of them.
    """
    if not root.is_dir():
        raise SourceError(f"{root}: no such folder; --source names the folder of the download.")
    zju = find_zju(root)
    # With another data set beside it, AIST++ is told by its annotations alone.
    aist = find_aist(root, unfilmed=unfilmed or bool(zju))
    if zju and aist:
        raise SourceError(
            f"{root}: holds ZJU-MoCap ({zju[0].name}, ...) and AIST++ ({aist[0].name}, ...): pass "
            "the folder of one data set."
        )
    if not zju and not aist:
        raise SourceError(
            f"{root}: is no data set that can be read; looked for ZJU-MoCap (annots.npy in the "
            "folder or up to two levels below), AIST++ (motions/ and cameras/mapping.txt), and "
            "trees of HumanNeRF or ActorsNeRF (mesh_infos.pkl)."
        )
    return zju or aist


def require_dataset(root: Path, found: Sequence[Found], expected: DatasetName | None) -> None:
    """Nothing, if the folder holds the data set that was asked for.

    Raises:
        SourceError: it holds another one.
    """
    there: list[DatasetName] = ["zju-mocap" if _is_zju(found[0]) else "aist"]
    if found[0].dataset == "synthetic":
        there.append("synthetic")
    if expected is not None and expected not in there:
        raise SourceError(
            f"{root}: holds {DATASETS[there[-1]]} ({found[0].name}, ...), but "
            f"{DATASETS[expected]} was asked for: name another folder, or --dataset {there[-1]}."
        )


def selected(found: Sequence[Found], names: Sequence[str]) -> tuple[Found, ...]:
    """The sequences of the given names; all without names.

    A ZJU-MoCap subject's number is a name too; `actorsnerf-30` stands for the paper's AIST++ ones.

    Raises:
        SourceError: a name is not among them.
    """
    if not names:
        return tuple(found)
    wanted: dict[str, Found] = {}
    for name in expanded_selection(names):
        matches = [each for each in found if name in (each.name, subject_of(each.name))]
        if not matches:
            raise SourceError(
                f"{found[0].path.parent}: has no sequence {name!r}; it has {_listed(found)}."
            )
        wanted.update({each.name: each for each in matches})
    return tuple(wanted.values())


def find_wanted(root: Path, names: Sequence[str]) -> tuple[Found, ...]:
    """The sequences of the given names, whose videos need not be there yet.

    Without names, all that can be prepared; of AIST++ annotations without any video, the paper's
    thirty, or all where none of those is among them.

    Raises:
        SourceError: the folder holds no data set, or a name is not among its sequences.
    """
    found = find_sources(root, unfilmed=True)
    if names or _is_zju(found[0]):
        return selected(found, names)
    try:
        return find_aist(root)
    except SourceError:
        return tuple(each for each in found if each.name in PAPER_SEQUENCES) or found


def survey_source(found: Found, options: OpenOptions) -> Survey:
    """What is there of a sequence and what is wrong with it; needs no body model.

    Raises:
        SourceError: the annotations are missing or damaged.
    """
    return survey_zju(found, options) if _is_zju(found) else survey_aist(found, options)


def open_source(found: Found, options: OpenOptions) -> SourceSequence:
    """A sequence ready to be prepared.

    Raises:
        SourceError: something that it needs is missing or wrong.
    """
    if not _is_zju(found):
        return open_aist(found, options)
    if options.segmenter is not None:
        raise SourceError(
            f"{found.path}: has masks of its own, and --segmenter is for AIST++'s videos; put your "
            "own masks into a folder and pass it with --masks."
        )
    return open_zju(found, options)


def held_out_names(root: Path, given: Sequence[str]) -> tuple[str, ...]:
    """The names of held-out actors: those given, else those in the source's `held_out.txt`.

    Raises:
        SourceError: `held_out.txt` cannot be read.
    """
    path = root / HELD_OUT_FILE
    if given or not path.is_file():
        return tuple(given)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(
            f"{path}: cannot be read as text ({error}); it names one held-out actor per line."
        ) from error
    return tuple(line.strip() for line in lines if line.strip())


def require_known_actors(names: Sequence[str], found: Sequence[Found]) -> None:
    """Nothing, if each name is that of a sequence or of an actor.

    Raises:
        SourceError: a name is neither; its actor would silently count as pre-training.
    """
    known = _known_names(found)
    for name in names:
        if name not in known:
            raise SourceError(
                f"--held-out {name}: no such actor or sequence; there are {_listed(found)}."
            )


def unknown_held_out(root: Path, found: Sequence[Found]) -> tuple[str, ...]:
    """A sentence each on the names in the source's `held_out.txt` that nobody there has.

    Such a name may be of a sequence that is not downloaded, so it is no error.

    Args:
        root: the source folder.
        found: all of its sequences.

    Raises:
        SourceError: `held_out.txt` cannot be read.
    """
    known = _known_names(found)
    unlike = {name.casefold(): name for name in sorted(known)}
    absent = [name for name in held_out_names(root, ()) if name not in known]
    path = root / HELD_OUT_FILE
    lines = [
        f"{path}: {name} is no actor or sequence here, but {unlike[name.casefold()]} is, and "
        "is not held out by it: upper and lower case count."
        for name in absent
        if name.casefold() in unlike
    ]
    others = [name for name in absent if name.casefold() not in unlike]
    if others:
        shown = ", ".join(others[:8]) + (", ..." if others[8:] else "")
        lines.append(
            f"{path}: names without an actor or sequence here hold out nobody: {shown}; there are "
            f"{_listed(found)}."
        )
    return tuple(lines)


def _known_names(found: Sequence[Found]) -> set[str]:
    """All that a user may call the sequences and their actors."""
    known: set[str] = set()
    for each in found:
        subject = subject_of(each.name)
        known |= {each.name, subject, f"zju-{subject}", dancer_of(each.name)}
    return known


def _listed(found: Sequence[Found]) -> str:
    return ", ".join(each.name for each in found[:8]) + (", ..." if found[8:] else "")


def _is_zju(found: Found) -> bool:
    return is_zju_tree(found.path) or is_converted_tree(found.path)
