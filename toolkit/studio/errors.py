"""What the page is told when something cannot be done."""

from toolkit.errors import ToolkitError


class Refused(ToolkitError):
    """A request that is answered with one clear line; `status` is HTTP's.

    404: no such shot. 409: the state is another one than the page thought. 413: too large. 415: no photograph.
    """

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status
