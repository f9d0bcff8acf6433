"""The one error that the small ros2 raises: its message is the line that the user sees."""


class CommandError(Exception):
    """A command that cannot be done; ``exit_code`` is 2 for a wrong call and 1 for everything else."""

    def __init__(self, message: str, exit_code: int = 1) -> None:
        super().__init__(message)
        self.exit_code = exit_code
