from pathlib import Path

import pytest
import tyro

from actorsnerf_preprocess.commands import Command, Inspect, Prepare, Synthetic


def parsed(*words: str) -> object:
    return tyro.cli(Command, args=words)


def test_each_command_has_its_options() -> None:
    prepare = parsed("prepare", "--source", "raw", "--sequences", "387", "393", "--all-pairs")
    assert prepare == Prepare(source=Path("raw"), sequences=("387", "393"), all_pairs=True)
    assert parsed("inspect", "--source", "raw") == Inspect(source=Path("raw"))
    synthetic = parsed("synthetic", "--out", "raw", "--variant", "converted-actorsnerf")
    assert synthetic == Synthetic(out=Path("raw"), variant="converted-actorsnerf")


@pytest.mark.parametrize("words", [("prepare",), ("synthetic", "--out", "a", "--variant", "nhp")])
def test_what_is_no_option_is_refused(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        parsed(*words)
    assert left.value.code == 2
    assert "--help" in capsys.readouterr().err
