"""The errors that a user reads: one sentence, no traceback, exit code 2 on the command line."""


class UserError(ValueError):
    """Something outside the program is wrong; the message names it, and what to do next."""


class LayoutError(UserError):
    """A prepared file is not what the layout says."""


class BodyModelError(UserError):
    """A body-model file is missing, unreadable, or not in SMPL format."""
