"""Origin of a result: images counted and set aside, how they were made, and the network."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from toolkit.captures.capture import RENDERER_VERSION, Capture
from toolkit.captures.read import CaptureFolder
from toolkit.captures.reconcile import SHORT, SetAside
from toolkit.core.files import load_json, sha256_bytes
from toolkit.core.text import count_of, list_some
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.predictions_csv import hash_images
from toolkit.evaluation.run_files import SUMMARY
from toolkit.evaluation.summaries import Run
from toolkit.models.detector import Detector
from toolkit.models.network import Classifier
from toolkit.rig.variants import CONTROLS

MOST_BOOSTERS = 8
MOST_REASONS = 6
TITLE = "What was evaluated"


@dataclass(frozen=True)
class SourceOrigin:
    """Origin of the images of a source, by its manifest.

    Attributes:
        has_manifest: whether each image was compared with a manifest; else images are paired by name.
        renderers, lights: renderers and lights of the images; empty for photographs.
        plan: short hash of all poses; empty if they are not known.
        shapes: object and short hash of its mesh.
        boosters: (variant, name, short hash).
    """

    source: str
    n: int
    has_manifest: bool
    renderers: tuple[str, ...]
    lights: tuple[str, ...]
    plan: str
    shapes: tuple[tuple[str, str], ...]
    boosters: tuple[tuple[str, str, str], ...]
    controls: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return an entry of `sources` in `rests_on`."""
        lists = {name: list(getattr(self, name)) for name in ("renderers", "lights", "controls")}
        boosters = [{"variant": variant, "name": name, "sha256": sha256} for variant, name, sha256 in self.boosters]
        return vars(self) | lists | {"shapes": dict(self.shapes), "boosters": boosters}

    def describe(self) -> str:
        """Return the origin as a line."""
        made = f"rendered by {_list(self.renderers)}, {_list(self.lights)} light" if self.renderers else "not rendered"
        how = "compared with manifest.jsonl" if self.has_manifest else "no manifest: pairing by name"
        plan = f", plan {self.plan}" if self.plan else ""
        controls = f"controls {_list(self.controls)}" if self.controls else "no controls"
        return f"{count_of(self.n, 'image')}, {how}; {made}{plan}; {controls}"


@dataclass(frozen=True)
class Origin:
    """Origin of a result.

    Attributes:
        images_sha256: hash of their paths and file hashes.
        set_aside: images that do not count, each with its reason.
        is_trusted: whether images that contradict their manifest were counted.
        no_pairs: reasons why pairs were not formed, with counts.
        network: name, weights and number of classes of the network.
    """

    counted: int
    images_sha256: str
    set_aside: tuple[SetAside, ...]
    is_trusted: bool
    sources: tuple[SourceOrigin, ...]
    no_pairs: tuple[tuple[str, int], ...]
    network: str
    notes: tuple[str, ...] = ()

    @property
    def faults(self) -> list[tuple[str, str]]:
        """(path, reason) of images that contradict their folder or manifest."""
        return [(capture.path, capture.reason) for capture in self.set_aside if capture.is_fault]

    def as_json(self) -> dict[str, Any]:
        """Return the field `rests_on` of `summary.json`."""
        return {
            "counted": self.counted, "images_sha256": self.images_sha256, "trusted_files": self.is_trusted,
            "set_aside": [capture.as_json() for capture in self.set_aside],
            "sources": [source.as_json() for source in self.sources],
            "pairs_not_formed": [{"reason": reason, "n": n} for reason, n in self.no_pairs], "network": self.network,
            "notes": list(self.notes),
        }  # fmt: skip

    def lines(self) -> list[tuple[str, str]]:
        """Return (heading, text) lines for people, a screen at most."""
        reasons = Counter(capture.kind for capture in self.set_aside).most_common(MOST_REASONS)
        aside = "".join(f"; {n} set aside: {reason}" for reason, n in reasons)
        trust = "; files were trusted over their manifest" if self.is_trusted else ""
        rows = [("images", f"{self.counted} counted{aside}{trust}")]
        rows += [("pairs", f"{n} not formed, {reason}") for reason, n in self.no_pairs[:MOST_REASONS]]
        rows += [(source.source, source.describe()) for source in self.sources]
        # each booster once, however many objects have it
        worn = dict.fromkeys((name, sha) for source in self.sources for _, name, sha in source.boosters)
        named = [f"{name} {sha}".strip() for name, sha in worn]
        rows += [("boosters", list_some(named, MOST_BOOSTERS))] if named else []
        return [*rows, ("network", self.network), *(("note", note) for note in self.notes)]


def find_origin(
    folder: CaptureFolder, no_pairs: Iterable[tuple[str, int]], network: Classifier | Detector,
    notes: Sequence[str] = (),
) -> Origin:  # fmt: skip
    """Return the origin of an evaluation's result; `no_pairs` is from `count_no_pairs`, `notes` are contradictions."""
    weights = network.weights
    named = f"{network.name}, weights {weights.name} {weights.sha256[:SHORT]}, {len(network.labels)} classes"
    sources = dict.fromkeys(capture.source for capture in folder.captures)
    return Origin(
        counted=len(folder.captures), images_sha256=hash_captures(folder.captures), set_aside=folder.set_aside,
        is_trusted=folder.is_trusted, sources=tuple(_describe_source(name, folder) for name in sources),
        no_pairs=tuple(no_pairs), network=named, notes=tuple(notes),
    )  # fmt: skip


def hash_captures(captures: Iterable[Capture]) -> str:
    """Return the hash of the paths and file hashes of all images."""
    return sha256_bytes("".join(sorted(f"{capture.image_sha256} {capture.path}\n" for capture in captures)).encode())


def explain_replaced(run: Run, predictions: Sequence[Prediction], captures_dir: Path) -> list[str]:
    """Return a sentence if images of a run were replaced since, or if lost images leave that unknown.

    None if all images are gone, or if the run is too old.
    """
    before = read_images_hash(run)
    if before is None:
        return []
    hashed = list(zip(predictions, hash_images(predictions), strict=True))
    gone = sum(sha256 is None and prediction.is_read for prediction, sha256 in hashed)
    if gone:
        if all(sha256 is None for _, sha256 in hashed):
            return []
        return [
            f"{gone} of {len(hashed)} images of {run.name} are gone, so it is not known whether the others are those "
            "that it judged"
        ]
    if hash_captures(replace(prediction.capture, image_sha256=sha256) for prediction, sha256 in hashed) == before:
        return []
    return [
        f"{run.name} judged other images than there are in {captures_dir} now: they were shot again, edited or "
        "replaced. Run 'toolkit eval' again to judge the new images"
    ]


def read_images_hash(run: Run) -> str | None:
    """Return the hash of all images that a run judged, see `hash_captures`; None in older runs."""
    sha256: str | None = (load_json(run.folder / SUMMARY).get("rests_on") or {}).get("images_sha256")
    return sha256


def _describe_source(source: str, folder: CaptureFolder) -> SourceOrigin:
    own = [capture for capture in folder.captures if capture.source == source]
    boosters = {
        (capture.variant, str(capture.settings.get("booster") or ""), capture.booster_sha256[:SHORT])
        for capture in own if capture.booster_sha256
    }  # fmt: skip
    # poses by their cameras: two sources of the same plan share the hash
    posed = [capture for capture in own if capture.T_world_camera is not None]
    poses = {(item.object, item.pose_id, item.T_world_camera, item.focal_length) for item in posed}
    meshes = {(capture.object, capture.settings.get("mesh_sha256")) for capture in own}
    shapes = {(name, str(sha256)[:SHORT]) for name, sha256 in meshes if sha256}
    variants = {capture.variant for capture in own}
    return SourceOrigin(
        source, len(own), has_manifest=source not in folder.without_manifest,
        renderers=_collect(own, RENDERER_VERSION) or _collect(own, "renderer"), lights=_collect(own, "light"),
        plan=sha256_bytes("\n".join(sorted(map(str, poses))).encode())[:SHORT] if poses else "",
        shapes=tuple(sorted(shapes)), boosters=tuple(sorted(boosters)),
        controls=tuple(name for name in CONTROLS if name in variants),
    )  # fmt: skip


def _collect(captures: Sequence[Capture], name: str) -> tuple[str, ...]:
    return tuple(sorted({str(capture.settings[name]) for capture in captures if capture.settings.get(name)}))


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "unknown"
