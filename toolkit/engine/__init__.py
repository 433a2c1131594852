"""Run lists of work units in this process, in a pool of processes, or on Ray, with settings for all of them."""

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from toolkit.core.config import Config, Flag
from toolkit.core.errors import FieldError

if TYPE_CHECKING:
    from toolkit.engine.units import Engine

WHERE = "Where it runs"


class EngineConfig(Config):
    """Place and number of workers; the results do not depend on them."""

    engine: Annotated[Literal["local", "ray"], Flag(group=WHERE)] = Field(
        "local", description="This machine, or a Ray cluster (needs the extra [ray])."
    )
    workers: Annotated[int | None, Field(ge=1, le=1024), Flag(group=WHERE)] = Field(
        None,
        description="Processes with a core each. Default: a single process with threads on all cores; with ray as many "
        "as the cluster has cores.",
    )
    address: Annotated[str | None, Flag(metavar="HOST:PORT", group=WHERE)] = Field(
        None, description="Address of a Ray cluster, or auto for the cluster here. Default: start a cluster here."
    )

    def open(self, gpus: int = 0) -> "Engine":
        """Return the engine, a context manager; on a cluster each unit gets `gpus` GPUs.

        Raises:
            FieldError: an address without Ray.
            ToolkitError: Ray is not installed, or does not answer at the address.
        """
        from toolkit.engine.local import InProcess, LocalPool

        if self.engine == "ray":
            from toolkit.engine.on_ray import RayEngine

            return RayEngine(self.address, self.workers, gpus)
        if self.address is not None:
            raise FieldError("goes with {engine} ray", {"address": self.address})
        return InProcess() if self.workers is None else LocalPool(self.workers)
