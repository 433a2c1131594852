"""`toolkit transfer`: do boosters work on networks that they were not trained on?"""

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json, show_table
from toolkit.experiments.transfer.transfer_config import TransferConfig


@from_config(config=TransferConfig)
def transfer(
    *,
    config: TransferConfig,
    model: options.Models = None,
    weights: options.WeightFiles = None,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train on all networks but one and test on that one, for each in turn; a stopped run goes on where it was."""
    from toolkit.boosters.detectors import load_networks
    from toolkit.core.workspace import open_workspace
    from toolkit.experiments.transfer.leave_one_out import HEADS, leave_one_out, tabulate

    space = open_workspace(workspace)
    networks = load_networks(model, weights, device, space.classifiers_dir, may_mix=True)
    typed = dict(zip(model or (), (one.name for one in networks), strict=False))
    config = config.with_overrides({"left_out": tuple(typed.get(name, name) for name in config.left_out)})
    result = leave_one_out(space, config, networks)
    if as_json:
        show_json([row.model_dump() for row in result.rows])
        return
    for seen, title in ((False, "judged by the network that was left out"), (True, "judged by those trained on")):
        say(title)
        show_table(HEADS, tabulate(result.rows, seen))
    say(f"matrix: {result.json_file}, {result.markdown_file}")
