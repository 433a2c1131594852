"""Commands that make classifiers of encoders: a head for a folder of images, classes from prompts."""

from pathlib import Path
from typing import Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import show_result
from toolkit.cli.trainings import describe_classifier
from toolkit.core.child import count_cores
from toolkit.core.errors import FieldError
from toolkit.core.workspace import open_workspace
from toolkit.training.head_config import HeadConfig

ENCODER = "timm:NAME, hf:ORG/NAME, a torchvision network, onnx:FILE, a .pt2, python:MODULE:FUNCTION."
IMAGE = "Image tower: onnx:FILE, a .pt2, timm:NAME, open_clip:NAME:WEIGHTS."
TEXT = "Text tower: onnx:FILE, a .pt2, open_clip:NAME:WEIGHTS. Default: that of an open_clip --image."
PROMPTS = "Class names: text, a name on each line, or JSON as CLIP_benchmark's classnames."
TEMPLATES = (
    "Templates with {} for the class: text, a template on each line, or JSON as CLIP_benchmark's. Default: a photo of "
    "a {}."
)
TOKENIZER = "tokenizer.json of the text tower. Default: the file beside the tower."
SCALE = "Factor of the cosine. Default: the tower's own, else CLIP's 100."


@from_config(config=HeadConfig)
def head(
    encoder: Annotated[str, typer.Argument(metavar="ENCODER", help=ENCODER)],
    *,
    config: HeadConfig,
    weights: Annotated[
        Path | None, typer.Option("--weights", metavar="FILE", help=f"{options.STATE_DICT} of the encoder.")
    ] = None,
    download: options.Download = False,
    workers: options.RenderProcesses = None,
    out: options.ClassifierFolder = None,
    restart: options.Restart = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Make a classifier of an encoder and a folder of images. Interrupted runs resume."""
    from toolkit.models.encoders import load_encoder
    from toolkit.models.heads import AsEncoder
    from toolkit.training.head import train_head

    space = open_workspace(workspace)
    loaded = load_encoder(encoder, weights, device, space.classifiers_dir, how=AsEncoder(config.tokens))
    made = train_head(
        config.with_overrides(seed=seed), space, loaded, out=out, workers=workers or count_cores(), download=download,
        restart=restart,
    )  # fmt: skip
    show_result(made, as_json, describe_classifier(made, out))


def zero_shot(
    name: Annotated[str, typer.Argument(metavar="NAME", help="File name of the classifier, for --model NAME.")],
    image: Annotated[str, typer.Option("--image", metavar="ENCODER", help=IMAGE)],
    prompts: Annotated[Path, typer.Option("--prompts", metavar="FILE", help=PROMPTS)],
    templates: Annotated[Path | None, typer.Option("--templates", metavar="FILE", help=TEMPLATES)] = None,
    text: Annotated[str | None, typer.Option("--text", metavar="ENCODER", help=TEXT)] = None,
    tokenizer: Annotated[Path | None, typer.Option(metavar="FILE", help=TOKENIZER)] = None,
    dataset: Annotated[
        str | None, typer.Option(metavar="NAME", help="Which of several data sets in the JSON files.")
    ] = None,
    scale: Annotated[float | None, typer.Option("--logit-scale", metavar="X", min=1e-6, help=SCALE)] = None,
    out: options.ClassifierFolder = None,
    restart: options.Restart = False,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Make a classifier of prompts by a network such as CLIP or SigLIP. Interrupted runs resume."""
    from toolkit.models.encoders import load_encoder
    from toolkit.models.find import OPEN_CLIP_PREFIX
    from toolkit.models.heads import AsEncoder
    from toolkit.models.prompts import make_prompts, read_class_names
    from toolkit.models.text_towers import load_text_tower
    from toolkit.training.classifier_config import check_name
    from toolkit.training.zero_shot import make_zero_shot

    # the text tower is the image tower's own, unless it is named
    space, named = open_workspace(workspace), text or image
    # small files are checked before a network is loaded
    asked = make_prompts(read_class_names(prompts, dataset), templates, dataset)
    if text is None and not image.startswith(OPEN_CLIP_PREFIX):
        raise FieldError("has no text tower: name it with {text}", {"image": image})
    # open_clip's networks hold both towers, other files a single one
    if named.startswith(OPEN_CLIP_PREFIX):
        from toolkit.models.open_clip import open_towers

        words = open_towers(named).text
    else:
        words = load_text_tower(named, tokenizer)
    tower = load_encoder(image, None, device, space.classifiers_dir, how=AsEncoder(whole=True))
    folder = out or space.classifiers_dir
    # a name that cannot be a file's is refused before prompts are encoded
    made = make_zero_shot(check_name(name), tower, words, asked, folder, scale=scale, restart=restart)
    show_result(made, as_json, describe_classifier(made, out))
