"""The room of worlds: places outdoors with their sky and weather, and all that is modelled by hand."""

from toolkit.core.rooms import Entry, Room

ROOM = Room(
    commands={
        "Benchmarks": {"world-eval": Entry("commands:world_eval", "evaluate an object in a city, in fog and dust")},
        "Worlds": {
            "world list": Entry("commands:list_worlds", "list the worlds, built in and your own"),
            "world preview": Entry("commands:preview", "see a world by day, at dusk, in fog: pictures, map, film"),
            "world export": Entry("commands:export", "write a world as GLB for Blender, Unreal, three.js"),
        },
    },
    words={"world": "List, see and export the worlds that objects stand in."},
    offers={
        "values of world": "own:list_names",
        "world": "views:open_setting",
        "times of day": "conditions:check_times",
        "weather": "weathered:read_words",
        "everyday": "content.everyday:MAKERS",
        **{f"builtin:{name}": f"content.{name}:build" for name in ("racer", "warplane", "coffeepot", "eggnog")},
    },
)
