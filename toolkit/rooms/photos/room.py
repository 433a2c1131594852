"""Commands for photographs: from a phone to `captures/real`, and the page that the phone shows."""

from toolkit.core.rooms import Entry, Room

ROOM = Room(
    commands={
        "Your photographs": {
            "studio": Entry("commands:studio", "photograph with a phone, shot by shot", {"--address": "--lan-address"}),
            "import": Entry("commands:import_", "import photographs, find object and pose"),
            "check": Entry("commands:check", "check photographs: sharp, well exposed, complete"),
            "retexture": Entry("commands:retexture", "put another patch into photographs of a printed patch"),
            "calibrate": Entry("measure_commands:calibrate", "measure a camera's lens"),
            "print-profile": Entry("measure_commands:print_profile", "measure what a printer does to colours"),
        }
    },
    offers={
        "shot list": "commands:make_shot_list",
        "found patches": "prints.fitted_photo:view_photos",
        "failed gates": "gates.check_captures:mark_failed_gates",
    },
)
