import pytest

from actorsnerf_datasets.camera_checks import camera_findings
from actorsnerf_datasets.fit_checks import fit_findings
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.case import judged
from actorsnerf_train.stability.cases_input import (
    centimetre_headers,
    input_cases,
    invented_header,
)


def test_all_within_their_bounds(bench: Bench) -> None:
    rows = [judged(case, bench.subjects) for case in input_cases()]
    assert [row.name for row in rows if not row.passed] == []


def test_the_invented_sequence_is_sound() -> None:
    header = invented_header()
    assert [*camera_findings(header), *fit_findings(header)] == []


@pytest.mark.parametrize("what", ["cameras", "translations", "the body", "everything"])
def test_centimetres_are_told_by_their_units(what: str) -> None:
    header = centimetre_headers(invented_header())[what]
    sentences = [finding.sentence for finding in (*camera_findings(header), *fit_findings(header))]
    assert any("units" in sentence or "metres" in sentence for sentence in sentences)


def test_a_check_that_accepts_centimetres_is_found_out(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("actorsnerf_train.stability.cases_input.camera_findings", lambda _: [])
    rows = {row.name: row for row in (judged(case, bench.subjects) for case in input_cases())}
    assert not rows["centimetres as metres: cameras"].passed
    assert rows["centimetres as metres: the body"].passed
