"""All twenty weathers of one 224² frame, against a ResNet-18's forward passes on them, in turns, on one thread.

The network has random weights: its speed does not depend on them.
"""

from statistics import median
from time import perf_counter

import numpy as np

SIDE_PX, ROUNDS = 224, 7


def make_frame():
    """A level view down a street: ground, a wall at 25 m, sky."""
    from toolkit.rig.camera import Camera, look_at
    from toolkit.rooms.worlds.particles import DepthView

    pose = look_at(np.array([30.0, 5.0, 8.0]), np.array([0.0, 0.0, 2.0]))
    camera = Camera.from_fov(SIDE_PX, SIDE_PX, 60)
    down = DepthView(np.zeros((SIDE_PX, SIDE_PX), np.float32), camera, pose).directions[..., 2]
    depth = np.where(down < -0.01, 8 / np.maximum(-down, 0.01), np.inf).astype(np.float32)
    depth[60:130, 60:160] = 25
    ground = np.isfinite(depth) & (depth != 25)
    light = np.random.default_rng(0).uniform(0, 1, (SIDE_PX, SIDE_PX, 3)).astype(np.float32)
    return DepthView(depth, camera, pose, ground=ground), light


def run() -> dict[str, float]:
    """Milliseconds, and the network's time over the weathers'."""
    import torch

    from toolkit.models.vision import torchvision
    from toolkit.rooms.worlds.conditions import parse_weathers
    from toolkit.rooms.worlds.depth_weather import add_weather, make_weather, weather_rng

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    network = torchvision.models.resnet18().eval()
    view, light = make_frame()
    weathers = parse_weathers(["fog", "dust", "rain", "snow"])
    airlight, one = np.array([0.6, 0.62, 0.65]), torch.rand(1, 3, SIDE_PX, SIDE_PX)
    spent: dict[str, list[float]] = {}
    for turn in range(ROUNDS + 1):
        forward = 0.0
        for name, severity in weathers:
            start = perf_counter()
            add_weather(light, view, make_weather(name, severity), airlight, weather_rng(0, turn, name, severity))
            middle = perf_counter()
            with torch.inference_mode():
                network(one)
            forward += perf_counter() - middle
            if turn:  # the first turn warms caches and kernels
                spent.setdefault(name, []).append(middle - start)
        if turn:
            spent.setdefault("forward", []).append(forward / len(weathers))
    torch.set_num_threads(threads)
    shares = {name: 1e3 * median(times) for name, times in spent.items()}
    mean = sum(shares[name] for name in ("fog", "dust", "rain", "snow")) / 4
    return {f"{name}, ms": value for name, value in shares.items()} | {
        "ratio to the weathers": shares["forward"] / mean
    }
