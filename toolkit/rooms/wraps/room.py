"""The room of wraps: flat pieces of an object's surface, planned, trained, printed and stuck on."""

from toolkit.core.rooms import Entry, Room

ROOM = Room(
    commands={
        "The road": {
            "train-wrap": Entry(
                "commands:train_wrap", "train the pictures on the pieces of a wrap", after="train-texture"
            ),
            "wrap": Entry("commands:wrap", "cut an object's surface into flat pieces", after="place"),
        }
    },
    offers={"variant:wrapped": "wrap_booster:WRAP", "printed wrap": "commands:print_pieces"},
)
