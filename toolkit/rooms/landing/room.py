"""The room of landing: a drone that lands on a pad."""

from toolkit.core.rooms import Entry, Room

ROOM = Room(
    needs=("worlds",),
    commands={
        "Landing": {
            "landing collect": Entry("commands:collect", "shoot a pad from a cone of places: pictures with the truth"),
            "landing train": Entry("commands:train", "train a network to find the pad"),
            "landing boost": Entry("commands:boost", "train the pad's picture for that network"),
            "landing fly": Entry("commands:fly", "fly landings with it in worsening weather"),
            "landing demo": Entry("commands:demo", "run the whole landing experiment, small"),
        }
    },
    words={"landing": "Land a drone on a pad: shoot the pad, train a network, boost the pad, fly."},
)
