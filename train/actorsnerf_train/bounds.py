"""Numbers of the command line that can mean nothing: refused in a sentence, before any work.

Options are named by their fields; one that is left out (None) is never refused, and one that is not
a number (NaN) always is. Of several numbers each counts.
"""

from collections.abc import Iterator

from actorsnerf_datasets.errors import UserError

Number = int | float


def at_least(least: Number, options: object, *names: str) -> None:
    """Nothing, if the options' values are no smaller.

    Raises:
        UserError: one is.
    """
    for option, value in _given(options, names):
        if not value >= least:
            raise UserError(f"{option} is {value:g}, expected at least {least:g}.")


def above(floor: Number, options: object, *names: str) -> None:
    """Nothing, if the options' values are larger.

    Raises:
        UserError: one is not.
    """
    for option, value in _given(options, names):
        if not value > floor:
            raise UserError(f"{option} is {value:g}, expected more than {floor:g}.")


def below(ceiling: Number, options: object, *names: str) -> None:
    """Nothing, if the options' values are smaller.

    Raises:
        UserError: one is not.
    """
    for option, value in _given(options, names):
        if not value < ceiling:
            raise UserError(f"{option} is {value:g}, expected less than {ceiling:g}.")


def _given(options: object, names: tuple[str, ...]) -> Iterator[tuple[str, Number]]:
    """Each number with the option's name on the command line."""
    for name in names:
        value = getattr(options, name)
        for one in value if isinstance(value, tuple) else (value,):
            if one is not None:
                yield f"--{name.replace('_', '-')}", one
