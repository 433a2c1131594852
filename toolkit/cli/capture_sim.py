"""`toolkit capture-sim`."""

from toolkit.captures.simulate import SimulateConfig, simulate_captures
from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, show_result
from toolkit.engine.config import EngineConfig


@from_config(config=SimulateConfig, engine=EngineConfig)
def capture_sim(
    *,
    engine: EngineConfig,
    objects: options.Objects = None,
    variants: options.Variants = None,
    config: SimulateConfig,
    corrupt: options.Corrupt = None,
    patches: options.Patches = None,
    seed: options.Seed = 0,
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Shoot every object at every pose of the plan, unpatched and patched, in the virtual rig.

    With --like, every photograph of a folder from its own measured camera instead. With --corrupt, besides the images,
    a corrupted copy of them, 224² px as networks see them, in captures/SOURCE-fog-3. With --rehearse, what is to be
    expected of the printed patch before it is printed.
    """
    from toolkit.core.workspace import open_workspace

    space = open_workspace(workspace, is_needed=True).with_patches(patches)
    made = simulate_captures(space, config, objects or (), variants or (), corrupt or (), seed=seed, engine=engine)
    if made.remark:
        remark(made.remark)
    show_result(made, as_json)
