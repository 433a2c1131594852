"""Flat pieces for an object: planned, drawn, and kept in the workspace."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolkit.captures.shoot import ShootSettings, studio_for
from toolkit.core.files import write_bytes
from toolkit.core.workspace import Workspace
from toolkit.objects.load import load_object
from toolkit.objects.wrap import Wrap, write_wrap
from toolkit.rig.requests import WrapConfig
from toolkit.rig.wrap_pictures import draw_pieces, draw_stretch
from toolkit.rig.wrap_plan import plan_wrap

TITLES = ("piece", "size, mm", "area, cm²", "stretch", "folds", "meets")


@dataclass(frozen=True)
class SuggestedWrap:
    """A plan of pieces as it was written.

    Attributes:
        wrap: the plan.
        folder: where it is kept.
        preview: picture of the pieces on the object.
        stretch: picture of how far each part is stretched.
    """

    wrap: Wrap
    folder: Path
    preview: Path
    stretch: Path

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        record = self.wrap.record
        pieces = [
            one.model_dump(include={"number", "width_mm", "height_mm", "area_mm2", "stretch"}) for one in record.pieces
        ]
        return {
            "object": record.object, "folder": str(self.folder), "preview": str(self.preview),
            "stretch_picture": str(self.stretch), "covered": record.covered,
            "covered_surface": record.covered_surface, "texel_mm": record.texel_mm, "n_px": record.n_px,
            "pieces": pieces,
        }  # fmt: skip

    def rows(self) -> list[tuple[str, ...]]:
        """A row under `TITLES` for each piece."""
        return [
            (
                str(one.number), f"{one.width_mm:.0f} × {one.height_mm:.0f}", f"{one.area_mm2 / 100:.1f}",
                f"{one.stretch:.1%}", str(len(one.folds_mm)),
                ", ".join(map(str, sorted({seam.piece for seam in one.seams}))),
            )
            for one in self.wrap.record.pieces
        ]  # fmt: skip

    def lines(self) -> Iterator[str]:
        """What was reached, where it is, and what comes next."""
        record = self.wrap.record
        count = "1 piece covers" if len(record.pieces) == 1 else f"{len(record.pieces)} pieces cover"
        yield (
            f"{count} {record.covered:.0%} of what random cameras see of {record.object} ({record.covered_surface:.0%} "
            f"of its surface); 95 % of each is stretched by {record.stretch_allowed:.1%} or less"
        )
        yield f"{self.preview}: the pieces on the object; {self.stretch}: their stretch"
        yield f"wrote {self.folder}"
        yield f"next: toolkit train-wrap --object {record.object}, then toolkit print --wrap {record.name}"


def suggest_wrap(workspace: Workspace, object_name: str, config: WrapConfig, seed: int = 0) -> SuggestedWrap:
    """Plan the pieces of an object, draw them, and write them to `print/wraps/NAME`.

    Raises:
        ToolkitError: an unknown object, or no part of it lies flat.
    """
    item = load_object(workspace.object_spec(object_name))
    wrap = plan_wrap(item, config, seed)
    folder = workspace.wraps_dir / wrap.record.name
    wrap = write_wrap(folder, wrap)
    preview = workspace.root / "rig" / "preview" / f"{object_name}-wrap.png"
    stretch = preview.with_name(f"{object_name}-wrap-stretch.png")
    write_bytes(preview, draw_pieces(item, wrap, studio_for(item, ShootSettings())))
    write_bytes(stretch, draw_stretch(item, wrap))
    return SuggestedWrap(wrap, folder, preview, stretch)
