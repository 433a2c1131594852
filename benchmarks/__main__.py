"""`make bench`: every benchmark, as ratios in one run, each with the mark it should reach."""

from importlib import import_module

MARKS = {
    "224x224: ratio to pyrender": 10.0, "224x224: ratio to open3d": 20.0, "640x480: ratio to pyrender": 6.0,
    "640x480: ratio to open3d": 10.0, "ratio to the formula": 1.0, "geometric mean": 3.0,
    "ratio to its slower part": 0.8, "ratio to one worker": 1.7, "ratio to no engine": 0.95,
    "ratio to the weathers": 1.0, "city: ratio to pyrender": 5.0,
    "city: ratio to filament": 8.0, "ratio to the evaluation": 0.77,
    "ratio to bare frames": 0.8, "ratio to one at a time": 4.0, "ratio to RotorPy's loop": 20.0,
    "ratio to ONNX Runtime": 0.9, "ratio to its forward": 0.9,
    "ratio to models": 1.0, "ratio to capture-sim": 0.4, "ratio to demo": 0.2,
}  # fmt: skip
MODULES = (
    "bench_rig", "bench_eval", "bench_train_patch", "bench_train_texture", "bench_corruptions", "bench_corrupt_eval",
    "bench_weather", "bench_world", "bench_world_eval", "bench_networks", "bench_engine",
    "bench_landing", "bench_start",
)  # fmt: skip


def main() -> None:
    for module in MODULES:
        print(f"{module}:", flush=True)
        for name, value in import_module(f"benchmarks.{module}").run().items():
            mark = next((f"  (mark {wanted:g})" for end, wanted in MARKS.items() if name.endswith(end)), "")
            print(f"  {name}: {value:.3g}{mark}" if isinstance(value, float) else f"  {name}: {value}", flush=True)


if __name__ == "__main__":
    main()
