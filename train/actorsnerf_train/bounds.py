"""Numbers of the command line that can mean nothing: refused in a sentence, before any work.

A number that is left out (None) is never refused; one that is not a number always is.
"""

from actorsnerf_datasets.errors import UserError

Number = int | float


def at_least(option: str, value: Number | None, least: Number) -> None:
    """Nothing, if an option's value is no smaller.

    Raises:
        UserError: it is.

    >>> at_least("steps", 1, 1)
    """
    if value is not None and not value >= least:
        raise UserError(f"--{option} is {value:g}, expected at least {least:g}.")


def above(option: str, value: Number | None, floor: Number) -> None:
    """Nothing, if an option's value is larger.

    Raises:
        UserError: it is not.

    >>> above("fps", 0.5, 0)
    """
    if value is not None and not value > floor:
        raise UserError(f"--{option} is {value:g}, expected more than {floor:g}.")


def below(option: str, value: Number | None, ceiling: Number) -> None:
    """Nothing, if an option's value is smaller.

    Raises:
        UserError: it is not.

    >>> below("stop-transmittance", 0, 1)
    """
    if value is not None and not value < ceiling:
        raise UserError(f"--{option} is {value:g}, expected less than {ceiling:g}.")
