"""What a result rests on: the images that were counted and set aside, how they were made, and who judged them."""

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
TITLE = "What this rests on"


@dataclass(frozen=True)
class SourceOrigin:
    """How the images of one source were made, as far as its manifest states it.

    Attributes:
        source: name of the source.
        n: images that count.
        has_manifest: whether each image was compared with a manifest; else images are paired by name.
        renderers, lights: that made the images; empty for photographs.
        plan: short hash of all poses that the objects were taken from; empty if they are not known.
        shapes: object and short hash of its mesh.
        boosters: (variant, name, short hash).
        controls: variants that are controls.
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
        """One of the `sources` of `rests_on`."""
        lists = {name: list(getattr(self, name)) for name in ("renderers", "lights", "controls")}
        boosters = [{"variant": variant, "name": name, "sha256": sha256} for variant, name, sha256 in self.boosters]
        return vars(self) | lists | {"shapes": dict(self.shapes), "boosters": boosters}

    def describe(self) -> str:
        """All of it in one line."""
        made = f"rendered by {_list(self.renderers)}, {_list(self.lights)} light" if self.renderers else "not rendered"
        how = "compared with manifest.jsonl" if self.has_manifest else "no manifest: pairing by name"
        plan = f", plan {self.plan}" if self.plan else ""
        controls = f"controls {_list(self.controls)}" if self.controls else "no controls"
        return f"{count_of(self.n, 'image')}, {how}; {made}{plan}; {controls}"


@dataclass(frozen=True)
class Origin:
    """What a result rests on.

    Attributes:
        counted: how many images count.
        images_sha256: hash of their paths and of the hashes of their files.
        set_aside: the images that do not, each with its reason.
        is_trusted: images that differ from their manifest were counted all the same.
        sources: how the images of each source were made.
        no_pairs: why pairs were not formed, and of how many images.
        network: that judged: its name, weights and number of classes.
        notes: contradictions that a reader should know.
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
        """(path, reason) of the images in which a folder contradicts itself."""
        return [(capture.path, capture.reason) for capture in self.set_aside if capture.is_fault]

    def as_json(self) -> dict[str, Any]:
        """The field `rests_on` of `summary.json`."""
        return {
            "counted": self.counted, "images_sha256": self.images_sha256, "trusted_files": self.is_trusted,
            "set_aside": [capture.as_json() for capture in self.set_aside],
            "sources": [source.as_json() for source in self.sources],
            "pairs_not_formed": [{"reason": reason, "n": n} for reason, n in self.no_pairs], "network": self.network,
            "notes": list(self.notes),
        }  # fmt: skip

    def lines(self) -> list[tuple[str, str]]:
        """(heading, text) for people, one screen at most."""
        reasons = Counter(capture.kind for capture in self.set_aside).most_common(MOST_REASONS)
        aside = "".join(f"; {n} set aside: {reason}" for reason, n in reasons)
        trust = "; files were trusted over their manifest" if self.is_trusted else ""
        rows = [("images", f"{self.counted} counted{aside}{trust}")]
        rows += [("pairs", f"{n} not formed, {reason}") for reason, n in self.no_pairs[:MOST_REASONS]]
        rows += [(source.source, source.describe()) for source in self.sources]
        worn = dict.fromkeys((name, sha) for source in self.sources for _, name, sha in source.boosters)
        named = [f"{name} {sha}".strip() for name, sha in worn]
        rows += [("boosters", list_some(named, MOST_BOOSTERS))] if named else []
        return [*rows, ("network", self.network), *(("note", note) for note in self.notes)]


def find_origin(
    folder: CaptureFolder,
    no_pairs: Iterable[tuple[str, int]],
    network: Classifier | Detector,
    notes: Sequence[str] = (),
) -> Origin:
    """Gather what the result of an evaluation rests on.

    Args:
        folder: whose images were judged.
        no_pairs: from `toolkit.evaluation.metrics.count_no_pairs`.
        network: that judged.
        notes: contradictions that were found besides.
    """
    named = (
        f"{network.name}, weights {network.weights.name} {network.weights.sha256[:SHORT]}, "
        f"{len(network.labels)} classes"
    )
    sources = dict.fromkeys(capture.source for capture in folder.captures)
    return Origin(
        counted=len(folder.captures), images_sha256=hash_captures(folder.captures), set_aside=folder.set_aside,
        is_trusted=folder.is_trusted, sources=tuple(_describe_source(name, folder) for name in sources),
        no_pairs=tuple(no_pairs), network=named, notes=tuple(notes),
    )  # fmt: skip


def hash_captures(captures: Iterable[Capture]) -> str:
    """Return one hash of all images: of their paths, and of the hashes of their files."""
    return sha256_bytes("".join(sorted(f"{capture.image_sha256} {capture.path}\n" for capture in captures)).encode())


def explain_replaced(run: Run, predictions: Sequence[Prediction], captures_dir: Path) -> list[str]:
    """Return a sentence if the images of a run are others now than those that it judged.

    Nothing is said if images are gone, or if an earlier version made the run.

    Args:
        run: from `open_run`.
        predictions: from `read_predictions`.
        captures_dir: where its images lie.
    """
    before = (load_json(run.folder / SUMMARY).get("rests_on") or {}).get("images_sha256")
    if before is None:
        return []
    hashes = list(hash_images(predictions, captures_dir))
    if any(sha256 is None and prediction.is_read for prediction, sha256 in zip(predictions, hashes, strict=True)):
        return []
    now = [
        replace(prediction.capture, image_sha256=sha256) for prediction, sha256 in zip(predictions, hashes, strict=True)
    ]
    if hash_captures(now) == before:
        return []
    return [
        f"{run.name} judged other pictures than lie in {captures_dir} now: they were shot again, edited or replaced. "
        "Run 'toolkit eval' again to judge these"
    ]


def _describe_source(source: str, folder: CaptureFolder) -> SourceOrigin:
    own = [capture for capture in folder.captures if capture.source == source]
    boosters = {
        (one.variant, str(one.settings.get("booster") or ""), one.booster_sha256[:SHORT])
        for one in own if one.booster_sha256
    }  # fmt: skip
    posed = [one for one in own if one.T_world_camera is not None]
    meshes = {(one.object, one.settings.get("mesh_sha256")) for one in own}
    shapes = {(name, str(sha256)[:SHORT]) for name, sha256 in meshes if sha256}
    return SourceOrigin(
        source, len(own), has_manifest=source not in folder.without_manifest,
        renderers=_collect(own, RENDERER_VERSION) or _collect(own, "renderer"), lights=_collect(own, "light"),
        plan=_hash_poses(posed) if posed else "",
        shapes=tuple(sorted(shapes)),
        boosters=tuple(sorted(boosters)),
        controls=tuple(name for name in CONTROLS if any(one.variant == name for one in own)),
    )  # fmt: skip


def _collect(captures: Sequence[Capture], name: str) -> tuple[str, ...]:
    return tuple(sorted({str(capture.settings[name]) for capture in captures if capture.settings.get(name)}))


def _hash_poses(captures: Sequence[Capture]) -> str:
    """Return the short hash of all places that objects were taken from."""
    poses = {(capture.object, capture.pose_id, capture.T_world_camera, capture.focal_length) for capture in captures}
    return sha256_bytes("\n".join(sorted(map(str, poses))).encode())[:SHORT]


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "unknown"
