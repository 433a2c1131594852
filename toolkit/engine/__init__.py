"""Lists of idempotent work units, addressed by the hash of their inputs: here, in a pool of processes, or on Ray.

Where they are done is declared here once, for the command line and for Python.
"""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from toolkit.core.config import Config, Flag
from toolkit.core.errors import FieldError

if TYPE_CHECKING:
    from toolkit.engine.units import Engine

WHERE = "Where it runs"


class EngineConfig(Config):
    """Where units are done, and by how many; the results are the same."""

    engine: Annotated[Literal["local", "ray"], Flag(group=WHERE)] = Field(
        "local", description="This machine, or a Ray cluster (needs the extra [ray])."
    )
    workers: Annotated[int | None, Field(ge=1, le=1024), Flag(group=WHERE)] = Field(
        None,
        description="Processes with one core each. Default: this one alone, whose threads use all cores; with ray as "
        "many as the cluster has room for.",
    )
    address: Annotated[str | None, Flag(metavar="HOST:PORT", group=WHERE)] = Field(
        None, description="Address of a Ray cluster, or auto for the one on this machine; default: start one here."
    )

    def open(self, gpus: int = 0) -> "Engine":
        """The engine; used as a context manager.

        Args:
            gpus: that each unit needs, where the cluster has any.

        Raises:
            FieldError: an address without Ray.
            ToolkitError: Ray is not installed, or nobody answers at the address.
        """
        from toolkit.engine.local import InProcess, LocalPool

        if self.engine == "ray":
            from toolkit.engine.on_ray import RayEngine

            return RayEngine(self.address, self.workers, gpus)
        if self.address is not None:
            raise FieldError("goes with {engine} ray", {"address": self.address})
        return InProcess() if self.workers is None else LocalPool(self.workers)
