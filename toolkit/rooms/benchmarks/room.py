"""Commands for benchmarks: studies of many pictures, and entries that are scored and ranked."""

from toolkit.core.rooms import Entry, Room

TURNED = {"--rotation": "--max-rotation", "--scale": "--patch-scale"}
"""In other commands these are a range of turns, and the size of a print."""

ROOM = Room(
    commands={
        "The road": {"sweep": Entry("commands:sweep", "vary a quantity: distance, light, size and more")},
        "Benchmarks": {
            "train-patches": Entry(
                "commands:train_patches", "train a patch for each of many classes", {**TURNED, "--size": "--size-px"}
            ),
            "baseline": Entry("commands:baseline", "make codes and other baselines", {"--size": "--size-px"}),
            "corrupt-eval": Entry(
                "commands:corrupt_eval",
                "corrupt a data set with and without patches",
                {**TURNED, "--corruption": "--corrupt"},
            ),
            "transfer": Entry("commands:transfer", "train on all networks but one, judge by the left-out network"),
        },
        "Challenge": {
            "challenge init": Entry("challenge.commands:init", "make an entry of your boosters"),
            "challenge check": Entry("challenge.commands:check", "check an entry against the rules"),
            "challenge run": Entry("challenge.commands:run", "render and score an entry"),
            "challenge board": Entry("challenge.commands:board", "rank entries on a page"),
        },
    },
    words={"challenge": "Find boosters that help networks that they were not trained on: enter, check, score, rank."},
    offers={
        "patches in training": "corruptions.training_boost:read_training_boost",
        "values of kind": "commands:list_kinds",
    },
)
