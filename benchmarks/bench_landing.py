"""Landings: what collecting, flying in lockstep and the vehicle's dynamics take, beside what they could take at best.

Collecting is timed against bare renders of the same frames, in turns; flights against the same flights one at a time;
the vehicle against RotorPy's single-drone loop at steps of 10 ms. A picture that is asked alone costs as much as 16,
for answers have the same bytes whatever they are asked with. Lighting the pads is left out.
"""

import importlib.util
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

FRAMES, ROUNDS, PLACES, EPISODES, ALONE = 120, 3, 4, 64, 4
LONGEST_S = 6.0
STEPS, DRONES, PEER_STEP_S = 200, 64, 0.01


def run() -> dict[str, float | str]:
    """Ratios, and what they are made of."""
    found: dict[str, float | str] = _collect()
    found |= _fly()
    if importlib.util.find_spec("rotorpy"):
        ours, peer = _advance_ours(), _advance_peer()
        found |= {"dynamics: drone-steps/s": ours, "dynamics: RotorPy steps/s": peer}
        found["dynamics: ratio to RotorPy's loop"] = ours / peer
    return found


def _collect() -> dict[str, float | str]:
    """Frames with segmentation and truth in a shard on disk, against bare renders from the same cameras."""
    from toolkit.core.threads import map_ahead
    from toolkit.rig.shading import tone_map
    from toolkit.rooms.landing.collect import Collector
    from toolkit.rooms.landing.config import CollectConfig
    from toolkit.rooms.landing.dataset import EncodedSample, encode_sample, write_shard
    from toolkit.rooms.landing.site import draw_pad, find_world

    config = CollectConfig(places=PLACES, frames=FRAMES)
    collector = Collector(config, find_world(config.world), draw_pad("plain"), 0)
    sites = [collector.site(number) for number in range(PLACES)]
    poses = [collector.aim(index)[0] for index in range(FRAMES)]

    def render(index: int) -> np.ndarray:
        site = sites[index % PLACES]
        return tone_map(site.renderer.render(site.camera, poses[index]), (0, index), config.optics.noise)

    def shoot(index: int) -> EncodedSample:
        return encode_sample(collector.shoot(index))

    bare, whole = [], []
    with TemporaryDirectory() as folder:
        for turn in range(ROUNDS + 1):
            start = perf_counter()
            list(map_ahead(render, range(FRAMES)))
            middle = perf_counter()
            write_shard(Path(folder) / "shard.tar", map_ahead(shoot, range(FRAMES)))
            if turn:  # the first turn warms caches and kernels
                bare.append(middle - start)
                whole.append(perf_counter() - middle)
    return {"collect: frames/s": FRAMES / median(whole), "collect: ratio to bare frames": median(bare) / median(whole)}


def _fly() -> dict[str, float | str]:
    """Episodes in lockstep with one batched forward a tick, and one at a time."""
    from toolkit.rooms.landing.config import CameraConfig, FlyConfig
    from toolkit.rooms.landing.fly import Clock, FlightCell, FlightSetup, fly_cell
    from toolkit.rooms.landing.site import Sites, draw_pad, find_world, plan_places
    from toolkit.rooms.worlds.conditions import CLEAR

    world, pad = find_world("grass"), draw_pad("plain")
    config = FlyConfig(regressors=("random",), places=PLACES)
    config = config.with_overrides(episode=config.episode.with_overrides(time_limit_s=LONGEST_S))
    optics = CameraConfig()
    sites = Sites(world, plan_places(world, pad.size_m, PLACES), ("noon",), optics)
    cell, finder = (
        FlightCell("plain", "random", "grass", *CLEAR, "gentle"),
        _make_regressor(optics.image_px, optics.fov_deg),
    )
    setup = FlightSetup(config, 0, sites, {"plain": pad}, {"random": finder})
    fly_cell(replace(setup, seed=1), cell, [0], Clock())  # warms caches and kernels
    clock, start = Clock(), perf_counter()
    fly_cell(setup, cell, list(range(EPISODES)), clock)
    clock.whole = perf_counter() - start
    start = perf_counter()
    for index in range(ALONE):
        fly_cell(setup, cell, [index], Clock())
    alone = (perf_counter() - start) / ALONE
    shares = clock.shares
    return {
        "fly: episodes/s": EPISODES / clock.whole,
        "fly: share of physics": shares["physics_s"] / shares["whole_s"],
        "fly: ratio to one at a time": alone * EPISODES / clock.whole,
    }


def _make_regressor(image_px: int, fov_deg: float):
    """With random weights and a last layer of zeros: the drone goes straight down."""
    from toolkit.rooms.landing.regressor import Regressor, RegressorRecord, build_module, freeze

    module = build_module("resnet18", 2, "grid", image_px)
    for values in module.fc.parameters():
        values.data.zero_()
    record = RegressorRecord(
        name="random", arch="resnet18", outputs=2, pool="grid", image_px=image_px, fov_deg=fov_deg, mean=(0.5,) * 3,
        std=(0.2,) * 3, pad="plain", pad_sha256="", size_m=2.0, started_from="", data={}, settings={}, final={},
        held_out=[], inputs_sha256="", sha256="0" * 64, toolkit_version="",
    )  # fmt: skip
    return Regressor(record, freeze(module, "cpu"))


def _advance_ours() -> float:
    """Drone-steps a second of 64 in lockstep, control included."""
    from toolkit.rooms.landing.dynamics import SIMPLE_FLIGHT, MultirotorState, VelocityControl, advance
    from toolkit.rooms.landing.episodes import STEP_S

    zeros = np.zeros((3, DRONES))
    state, control = MultirotorState.at(zeros, np.zeros(DRONES), SIMPLE_FLIGHT.hover_signal), VelocityControl(DRONES)
    best = 0.0
    for _ in range(ROUNDS):
        start = perf_counter()
        for _ in range(STEPS):
            state = advance(SIMPLE_FLIGHT, state, control.signals(state, zeros, zeros[0], STEP_S), zeros, STEP_S)
        best = max(best, DRONES * STEPS / (perf_counter() - start))
    return best


def _advance_peer() -> float:
    """RotorPy's steps a second of its single-drone loop: its Hummingbird hovers, without control."""
    from rotorpy.vehicles.hummingbird_params import quad_params
    from rotorpy.vehicles.multirotor import Multirotor

    peer = Multirotor(quad_params, control_abstraction="cmd_motor_speeds")
    speeds = np.full(4, np.sqrt(quad_params["mass"] * 9.81 / 4 / quad_params["k_eta"]))
    state = {"x": np.zeros(3), "v": np.zeros(3), "q": np.array([0, 0, 0, 1.0]), "w": np.zeros(3), "wind": np.zeros(3),
             "rotor_speeds": speeds}  # fmt: skip
    best = 0.0
    for _ in range(ROUNDS):
        start = perf_counter()
        for _ in range(STEPS):
            state = peer.step(state, {"cmd_motor_speeds": speeds}, PEER_STEP_S)
        best = max(best, STEPS / (perf_counter() - start))
    return best
