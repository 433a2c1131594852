"""Export captures as a data set: an image folder that the Hugging Face Hub shows, with card and Croissant."""

import json
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from mimetypes import guess_type
from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.captures.read import read_captures
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import (
    delete_file,
    inside,
    read_bytes,
    real_path,
    sha256_bytes,
    write_bytes,
    write_json,
    write_text,
)
from toolkit.core.text import count_of
from toolkit.core.workspace import Workspace
from toolkit.evaluation.predictions_csv import find_captures_dir, has_own_file, read_predictions
from toolkit.evaluation.summaries import Run
from toolkit.imaging.read import MAX_MEGAPIXELS, UnreadableImage, open_image
from toolkit.objects.spec import read_spec

SPLIT = "test"
"""The images judge networks that were trained elsewhere."""
METADATA = f"{SPLIT}/metadata.jsonl"
MOST_BYTES = 4_000_000 * MAX_MEGAPIXELS
Row = dict[str, Any]
COLUMNS: dict[str, tuple[str, str]] = {
    "file_name": ("sc:Text", "Path of the image below the split's folder."),
    "label": ("sc:Text", "The class that the object should be recognised as."),
    "source": ("sc:Text", "Where the image is from: `sim` is the virtual rig, `real` a camera."),
    "object": ("sc:Text", "Name of the object."),
    "variant": ("sc:Text", "What is on the object: `unpatched` is nothing, `patched` a printed patch."),
    "pose_id": ("sc:Integer", "Pose of the plan; images of one object and pose form a pair."),
    "rendered": ("sc:Boolean", "Whether a renderer made the image."),
    "booster_sha256": ("sc:Text", "SHA-256 of what is on the object."),
    "image_sha256": ("sc:Text", "SHA-256 of the image file."),
}
"""Columns of `metadata.jsonl`: Croissant's type, and description. Each run adds columns."""


def write_imagefolder(
    folder: Path, workspace: Workspace, runs: Sequence[Run], captures_dir: Path | None = None
) -> tuple[int, int]:
    """Copy the images of a capture folder into `folder/test/`, with labels and metadata.

    `datasets.load_dataset("imagefolder", …)` and the Hub's viewer read `metadata.jsonl`. `README.md` is the data set's
    card, `croissant.json` its description in Croissant 1.0. Each run adds its predictions as columns. Images of an
    earlier export that are gone are removed.

    Returns:
        Number of images, and number of images that cannot be read.

    Raises:
        ToolkitError: there are no images, predictions are damaged, or the folder cannot be written.
    """
    # labels by the specs; what the manifest states wins below
    found, labels = read_captures(captures_dir or workspace.captures_dir), _list_labels(workspace)
    check_names(runs, _column_of)
    files = {capture.file: real_path(capture.file) for capture in found.captures}
    answers = [_list_answers(workspace, run, captures_dir) for run in runs]
    for run, known in zip(runs, answers, strict=True):
        if known.keys().isdisjoint(files.values()):
            raise ToolkitError(
                f"{run.name} judged none of the images in {found.root}: leave it out, or name their folder"
            )
    before = _list_written(folder)
    rows, left_out = list[Row](), len(found.faults)
    for capture in found.captures:
        # only images that open are copied
        try:
            with open_image(capture.file):
                pass
        except (UnreadableImage, OSError, ValueError, SyntaxError):
            left_out += 1
            continue
        content = read_bytes(capture.file, MOST_BYTES)
        write_bytes(folder / SPLIT / capture.path, content, folder)
        row = {
            "file_name": capture.path, "label": capture.class_name or labels.get(capture.object, capture.object),
            "source": capture.source, "object": capture.object, "variant": capture.variant,
            "pose_id": capture.pose_id, "rendered": capture.is_rendered,
            "booster_sha256": capture.booster_sha256, "image_sha256": sha256_bytes(content),
        }  # fmt: skip
        # the columns of each run, for the images that it judged
        for known in answers:
            row |= known.get(files[capture.file], {})
        rows.append(row)
    if not rows:
        raise ToolkitError(f"{found.root}: none of {left_out} images can be read")
    # after the new images: until then the earlier set is whole
    for name in sorted(before - {row["file_name"] for row in rows}):
        delete_file(inside(folder / SPLIT, name))
    # metadata, description and card
    columns = COLUMNS | _list_columns(runs)
    text = "".join(json.dumps({name: row.get(name) for name in columns}, ensure_ascii=False) + "\n" for row in rows)
    write_text(folder / METADATA, text, folder)
    formats = sorted({guess_type(row["file_name"])[0] or "image/*" for row in rows})
    title = f"{workspace.root.resolve().name} captures"
    write_json(folder / "croissant.json", describe_croissant(title, columns, text, formats), folder)
    write_text(folder / "README.md", write_card(title, columns, rows), folder)
    return len(rows), left_out


def _list_labels(workspace: Workspace) -> dict[str, str]:
    """Return the class of each object by its spec."""
    labels: dict[str, str] = {}
    for name, file in workspace.object_specs().items():
        with suppress(ToolkitError):  # a broken spec names no class
            labels[name] = str(read_spec(file).class_name)
    return labels


def _list_answers(workspace: Workspace, run: Run, captures_dir: Path | None) -> dict[Path, Row]:
    """Return the predictions of a run by their images, of those that still have their own file."""
    place, name = captures_dir or find_captures_dir(workspace, run), _column_of(run)
    return {
        real_path(prediction.capture.file): {
            f"{name}_label": prediction.top1_label, f"{name}_prob": prediction.top1_prob,
            f"{name}_correct": prediction.correct_top1,
        }
        for prediction in read_predictions(run, place) if prediction.is_read and has_own_file(prediction, place)
    }  # fmt: skip


def _list_columns(runs: Sequence[Run]) -> dict[str, tuple[str, str]]:
    columns = dict[str, tuple[str, str]]()
    for run in runs:
        name, network = _column_of(run), run.rows[0].network
        columns |= {
            f"{name}_label": ("sc:Text", f"First answer of {network}."),
            f"{name}_prob": ("sc:Float", f"Probability that {network} gives its answer."),
            f"{name}_correct": ("sc:Boolean", f"Whether the answer of {network} is the label."),
        }
    return columns


def check_names(runs: Sequence[Run], shorten: Callable[[Run], str]) -> None:
    """Raise a `ToolkitError` if two runs would share a name in an export, as `shorten` gives it."""
    owners = dict[str, str]()
    for run in runs:
        owner = owners.setdefault(shorten(run), run.name)
        if owner != run.name:
            raise ToolkitError(
                f"{owner} and {run.name} would both be called {shorten(run)} in the export: export them into two "
                "folders, or rename one of the runs"
            )


def _column_of(run: Run) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in run.name)


def _list_written(folder: Path) -> set[str]:
    """Return the images of an earlier export into this folder."""
    file = folder / METADATA
    if not file.is_file():
        return set()
    try:
        return {str(json.loads(line)["file_name"]) for line in file.read_text(encoding="utf-8").splitlines()}
    except (ValueError, KeyError, TypeError):
        raise FieldError(f"{file} was not written by this command: name another folder with {{out}}", {}) from None


CONTEXT: Row = {
    "@language": "en", "@vocab": "https://schema.org/", "citeAs": "cr:citeAs", "column": "cr:column",
    "conformsTo": "dct:conformsTo", "cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"}, "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/", "examples": {"@id": "cr:examples", "@type": "@json"}, "extract": "cr:extract",
    "field": "cr:field", "fileProperty": "cr:fileProperty", "fileObject": "cr:fileObject", "fileSet": "cr:fileSet",
    "format": "cr:format", "includes": "cr:includes", "isLiveDataset": "cr:isLiveDataset", "jsonPath": "cr:jsonPath",
    "key": "cr:key", "md5": "cr:md5", "parentField": "cr:parentField", "path": "cr:path", "recordSet": "cr:recordSet",
    "references": "cr:references", "regex": "cr:regex", "repeated": "cr:repeated", "replace": "cr:replace",
    "sc": "https://schema.org/", "separator": "cr:separator", "source": "cr:source", "subField": "cr:subField",
    "transform": "cr:transform",
}  # fmt: skip
"""The JSON-LD context that Croissant 1.0 gives (Croissant format specification, appendix 1)."""


def describe_croissant(title: str, columns: dict[str, tuple[str, str]], metadata: str, formats: Sequence[str]) -> Row:
    """Return the content of `croissant.json`: a record for each line of `metadata.jsonl` (Croissant 1.0)."""
    return {
        "@context": CONTEXT, "@type": "sc:Dataset", "name": "".join(c if c.isalnum() else "-" for c in title),
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "description": ABOUT,
        "distribution": [
            {
                "@type": "cr:FileObject", "@id": "metadata", "name": "metadata", "contentUrl": METADATA,
                "encodingFormat": "application/jsonlines", "sha256": sha256_bytes(metadata.encode()),
            },
            {
                "@type": "cr:FileSet", "@id": "images", "name": "images", "encodingFormat": [*formats],
                "includes": f"{SPLIT}/**/*.*", "description": "The images that file_name names.",
            },
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet", "@id": "captures", "name": "captures", "description": "One image each.",
                "key": {"@id": "captures/file_name"},
                "field": [
                    {
                        "@type": "cr:Field", "@id": f"captures/{name}", "name": name, "description": about,
                        "dataType": kind,
                        "source": {"fileObject": {"@id": "metadata"}, "extract": {"column": name}},
                    }
                    for name, (kind, about) in columns.items()
                ],
            }
        ],
    }  # fmt: skip


ABOUT = (
    "Images of objects with and without what makes them easier to recognise (a printed patch, a wrap, a texture), each "
    "from the same camera poses, so that networks are judged by pairs."
)


def write_card(title: str, columns: dict[str, tuple[str, str]], rows: Sequence[Row]) -> str:
    """Return the `README.md` of a data set: the Hub's settings, image counts, and columns."""
    # counts by source, object, label and variant; a bar would end a cell of the table
    counts = Counter(tuple(str(row[name]).replace("|", "/") for name in HEADS) for row in rows)
    # the Hub's word for the size
    size = next(word for most, word in SIZES if len(rows) < most)
    lines = [
        "---", f"pretty_name: {json.dumps(title)}", "task_categories:", "- image-classification", "size_categories:",
        f"- {size}", "configs:", "- config_name: default", "  data_files:", f"  - split: {SPLIT}",
        f'    path: "{SPLIT}/**"', "---", "", f"# {title}", "", ABOUT, "",
        f"{count_of(len(rows), 'image')}, written by toolkit {__version__}. Pairs are images of one source, object and "
        "`pose_id` that differ in `variant` alone.", "",
        f"| {' | '.join(HEADS)} | images |", "|---|---|---|---|---|",
        *(f"| {' | '.join(key)} | {count} |" for key, count in sorted(counts.items())), "",
        "## Columns", "", "| column | what it holds |", "|---|---|",
        *(f"| `{name}` | {about} |" for name, (_, about) in columns.items()), "",
        "## Load it", "", "```python", "from datasets import load_dataset", "",
        f'images = load_dataset("imagefolder", data_dir=".", split="{SPLIT}")', "```", "",
        "`croissant.json` describes the same table in [Croissant](https://mlcommons.org/croissant) 1.0. State the "
        "licence of your images here before you publish them.", "",
    ]  # fmt: skip
    return "\n".join(lines)


HEADS = ("source", "object", "label", "variant")
SIZES = ((1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"), (float("inf"), "n>1M"))
"""The Hub's words for how many examples a data set has."""
