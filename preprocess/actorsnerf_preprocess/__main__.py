"""The command line: `python -m actorsnerf_preprocess prepare | inspect | synthetic`."""

import os
import sys
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import tyro

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.shell import quoted
from actorsnerf_preprocess.cluster import cluster_team
from actorsnerf_preprocess.commands import Command, Prepare, Reading, Synthetic
from actorsnerf_preprocess.estimate import estimate
from actorsnerf_preprocess.needs import ORIGINS, need_lines, needs_of
from actorsnerf_preprocess.pictures import PictureOptions
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.run_report import CHECK_NOTICE, finding_lines, report_lines
from actorsnerf_preprocess.source import Found, OpenOptions, SourceError, SourceSequence, Survey
from actorsnerf_preprocess.sources import (
    find_sources,
    find_wanted,
    held_out_names,
    open_source,
    require_dataset,
    require_known_actors,
    selected,
    survey_source,
    unknown_held_out,
)
from actorsnerf_preprocess.workers import team


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; the exit code is 2, with one sentence on stderr, if the input is bad.

    Interrupted by Ctrl-C it is 130, and 141 if nobody reads the output any more.
    """
    command = tyro.cli(Command, args=arguments, prog="actorsnerf-preprocess")
    try:
        match command:
            case Prepare():
                return _prepare(command)
            case Synthetic():
                return _synthesise(command)
            case _:
                return _inspect(command)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        # Whoever reads the output, such as `head`, has seen enough.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except KeyboardInterrupt:
        print("interrupted: run the same command again to go on", file=sys.stderr)
        return 130


def _inspect(reading: Reading) -> int:
    errors = 0
    said: set[str] = set()
    options = _options(reading)
    for found in _selected(reading):
        try:
            survey = survey_source(found, options)
        except UserError as error:
            _say_once(error, said)
            errors += 1
            continue
        _print_survey(survey)
        errors += any(finding.severity == "error" for finding in survey.findings)
    print(CHECK_NOTICE)
    return 2 if errors else 0


def _prepare(command: Prepare) -> int:
    _require_sensible(command)
    if command.dataset == "synthetic" and not command.source.exists():
        _synthesise(Synthetic(out=command.source))
    if command.list_needed:
        _check_held_out(command, find_sources(command.source, unfilmed=True))
        return _list_needed(command, find_wanted(command.source, command.sequences))
    found = _selected(command)
    options = _options(command)
    refused: set[str] = set()
    said: set[str] = set()
    with _workers(command) as executor:
        for each in found:
            try:
                _prepare_one(command, each, options, executor)
            except UserError as error:
                _say_once(error, said)
                refused.add(each.name)
    done = [each.name for each in found if each.name not in refused]
    if done and not command.dry_run:
        files = " ".join(quoted(command.out / f"{name}.h5") for name in done[:3])
        print(CHECK_NOTICE)
        print(f"next: python -m actorsnerf_datasets check {files}{' ...' if done[3:] else ''}")
    return 2 if refused else 0


def _synthesise(command: Synthetic) -> int:
    # Needs a renderer, which nothing else here does.
    from actorsnerf_preprocess.synthetic import PRESETS, write_aist_tree, write_zju_tree

    preset = PRESETS[command.preset]
    numbers = {
        name: getattr(preset if getattr(command, name) is None else command, name)
        for name in ("actors", "held_out", "frames", "cameras", "size")
    }
    options = replace(
        preset,
        **numbers,
        zoom=command.zoom,
        seed=command.seed,
        full=command.full,
        variant=command.variant,
        fit_noise=command.fit_noise,
        ragged_masks=command.ragged_masks,
    )
    write = write_aist_tree if command.format == "aist" else write_zju_tree
    write(command.out, options, progress=sys.stderr.isatty())
    print(f"{options.actors + options.held_out} dancers in {command.out}")
    source = quoted(command.out)
    print(f"next: python -m actorsnerf_preprocess prepare --source {source} --out prepared")
    return 0


def _selected(reading: Reading) -> tuple[Found, ...]:
    everything = find_sources(reading.source)
    require_dataset(reading.source, everything, reading.dataset)
    _check_held_out(reading, everything)
    return selected(everything, reading.sequences)


def _check_held_out(reading: Reading, everything: Sequence[Found]) -> None:
    """Refuses unknown names of the command line; those of the source's file are only said."""
    require_known_actors(reading.held_out, everything)
    if not reading.held_out:
        for line in unknown_held_out(reading.source, everything):
            print(f"warning: {line}", file=sys.stderr, flush=True)


def _say_once(error: UserError, said: set[str]) -> None:
    """Prints a refusal; what is wrong with the command is not said again for every sequence."""
    if str(error) not in said:
        print(f"error: {error}", file=sys.stderr, flush=True)
    said.add(str(error))


def _require_sensible(command: Prepare) -> None:
    if not 0 < command.scale <= 1:
        raise SourceError(
            f"--scale {command.scale:g}: expected more than 0 and at most 1, such as 0.5."
        )
    if command.workers < 1:
        raise SourceError(f"--workers {command.workers}: expected 1 or more processes.")


def _prepare_one(
    command: Prepare, found: Found, options: OpenOptions, executor: Executor | None
) -> None:
    source = open_source(found, options)
    print(f"{found.name}: {source.found.variant}, actor {source.actor}, {_roles(source)}")
    for line in finding_lines(source.findings):
        print(line)
    if command.dry_run:
        guess = estimate(source, PictureOptions(command.scale, command.keep_background))
        print(
            f"  would store {guess.pictures} pictures: about {guess.seconds:.0f} s with one worker "
            f"and {guess.bytes / 1e6:.0f} MB (from {guess.sampled} pictures)"
        )
        return
    _make_folder(command.out)
    run = PrepareOptions(
        scale=command.scale,
        keep_background=command.keep_background,
        workers=command.workers,
        progress=sys.stderr.isatty(),
    )
    report = prepare_sequence(source, command.out, run, executor)
    if report is None:
        print(f"  {command.out / found.name}.h5 is there already, made with the same settings")
    else:
        print("\n".join(report_lines(report)))


def _list_needed(command: Prepare, found: Sequence[Found]) -> int:
    missing = 0
    for each in found:
        needs = needs_of(each, _options(command))
        missing += sum(len(need.missing) for need in needs)
        print("\n".join(need_lines(each, needs)))
    print("\n".join(ORIGINS))
    return 2 if missing else 0


def _options(reading: Reading) -> OpenOptions:
    return OpenOptions(
        body_model=reading.body_model,
        pairs="all" if reading.all_pairs else "protocol",
        held_out=held_out_names(reading.source, reading.held_out),
        masks=reading.masks,
        segmenter=reading.segmenter,
        ignored="accept" if reading.accept_ignored else "refuse",
    )


def _workers(command: Prepare) -> AbstractContextManager[Executor | None]:
    return cluster_team(command.scheduler) if command.scheduler else team(command.workers)


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SourceError(f"{path}: cannot be made or used as a folder ({error}).") from error


def _roles(source: SourceSequence) -> str:
    return ", ".join(f"{protocol.role} in {protocol.name}" for protocol in source.protocols)


def _print_survey(survey: Survey) -> None:
    width = max(len(label) for label, _ in survey.facts)
    for label, value in survey.facts:
        print(f"{label:<{width}}  {value}")
    print("\n".join(finding_lines(survey.findings)) or "  nothing wrong was found")
    print()


if __name__ == "__main__":
    sys.exit(main())
