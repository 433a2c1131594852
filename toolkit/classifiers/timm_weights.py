"""Find the weights of a timm network: the user's file, a folder of weights, or timm's own at the Hugging Face hub."""

from pathlib import Path
from typing import Any

from toolkit.classifiers.weights import (
    WeightsFile,
    check_named,
    download,
    find_in_folder,
    no_weights,
    open_weights,
)
from toolkit.errors import ToolkitError

HUB_FILE = "model.safetensors"
HUB_TIMEOUT_S = 10.0


def find_timm_weights(name: str, config: dict[str, Any], weights: Path | None, quiet: bool) -> WeightsFile:
    """The weights of a network: `weights`, else TOOLKIT_WEIGHTS, else the hub's cache, else timm's download.

    Args:
        name: timm's, without prefix: the folder's file is `NAME-*.pth` or `.safetensors`.
        config: timm's record of the network's weights.
        weights: `--weights`.
        quiet: no progress bar.

    Raises:
        ToolkitError: the named file is missing or of another kind, or none of the ways has weights.
    """
    if weights is not None:
        return open_weights(check_named(Path(weights)))
    if (local := find_in_folder(name)) is not None:
        return open_weights(local)
    if repo := config.get("hf_hub_id"):
        filename = config.get("hf_hub_filename") or HUB_FILE
        return open_weights(_fetch_from_hub(name, repo, filename, quiet), f"{repo}/{filename}")
    if url := config.get("url"):
        return open_weights(download(name, url, quiet))
    raise ToolkitError(f"no weights for timm:{name}, and timm publishes none: give a file with --weights")


def _fetch_from_hub(name: str, repo: str, filename: str, quiet: bool) -> Path:
    from huggingface_hub import get_hf_file_metadata, hf_hub_download, hf_hub_url, try_to_load_from_cache
    from huggingface_hub.utils import disable_progress_bars

    if isinstance(cached := try_to_load_from_cache(repo, filename), str):
        return Path(cached)
    if quiet:
        disable_progress_bars()
    try:
        # without a network the download itself would try again for half a minute; this asks once
        get_hf_file_metadata(hf_hub_url(repo, filename), timeout=HUB_TIMEOUT_S)
        return Path(hf_hub_download(repo, filename, etag_timeout=HUB_TIMEOUT_S))
    except Exception as error:  # those of requests or of httpx, by the hub client's version, and its own
        reason = (str(error).strip().splitlines() or [""])[0][:160] or error.__class__.__name__
    raise no_weights(f"timm:{name}", name, f"let it download {repo} from the Hugging Face hub (failed: {reason})")
