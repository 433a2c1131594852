"""An evaluation in the city, frame by frame, against the network's bare forward passes on the same pictures.

Processor time on one thread, in turns: rendering, ten weathers and clear air, development, and the answers. ResNet-18
has random weights: its speed does not depend on them. What is worked out once, the light, is left out.
"""

from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np

WORLD, FRAMES, PASS, WEATHERS = "city", 8, 8, ("fog:1-5", "dust")


def make_classifier():
    from toolkit.imaging.preprocessing import Preprocessing
    from toolkit.models.network import Classifier
    from toolkit.models.vision import torchvision
    from toolkit.models.weights import WeightsFile

    how = Preprocessing(256, 224, (0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
    labels = ["warplane", *map(str, range(999))]
    file = WeightsFile(Path("random.pth"), "0" * 64, "random.pth")
    return Classifier("resnet18", torchvision.models.resnet18().eval(), labels, how, file, "cpu", False)


def run() -> dict[str, float]:
    """Milliseconds of a picture's share of each part, and the bare passes' time over that of all."""
    import torch

    from toolkit.core.workspace import Workspace
    from toolkit.models.predict import predict_stream
    from toolkit.rooms.worlds.evaluation import WorldEvalConfig
    from toolkit.rooms.worlds.evaluation.frames import render_frame
    from toolkit.rooms.worlds.evaluation.world_run import plan_run
    from toolkit.rooms.worlds.picture import make_renderer

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    classifier = make_classifier()
    config = WorldEvalConfig(world=WORLD, places=1, sample=FRAMES + 1, weathers=WEATHERS, variants=("unpatched",))
    with TemporaryDirectory() as folder:
        asked = plan_run(Workspace(Path(folder)), classifier, config)
    renderer = make_renderer(asked.stage.places[0])
    spent: dict[str, list[float]] = {}
    for turn, task in enumerate(asked.tasks()):
        marks = [process_time()]
        frame = render_frame(asked.stage, task, renderer)
        marks.append(process_time())
        pictures = frame.pictures[:PASS]
        list(predict_stream([(0, picture) for picture in pictures], classifier, PASS))
        marks.append(process_time())
        batch = torch.from_numpy(np.stack(pictures)).permute(0, 3, 1, 2).float().div(255)
        with torch.inference_mode():
            classifier.logits(batch)
        marks.append(process_time())
        if turn:  # the first turn warms caches and kernels
            counts = (len(frame.pictures), PASS, PASS)
            for name, value, count in zip(("frame", "answers", "bare"), np.diff(marks), counts, strict=True):
                spent.setdefault(name, []).append(1e3 * float(value) / count)
    torch.set_num_threads(threads)
    shares = {name: median(times) for name, times in spent.items()}
    whole = shares["frame"] + shares["answers"]
    return {f"{name}, ms a picture": value for name, value in shares.items()} | {
        "bare passes: ratio to the evaluation": shares["bare"] / whole
    }
