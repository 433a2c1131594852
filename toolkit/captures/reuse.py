"""Images that were shot before from the very same inputs, wherever they lie: copied instead of shot again."""

from dataclasses import dataclass
from pathlib import Path

from toolkit.captures.manifest import CaptureRecord, append_record, read_manifest
from toolkit.files import inside, sha256_bytes, write_bytes


@dataclass(frozen=True)
class StoredImage:
    """A finished image and what its source's manifest says of it."""

    file: Path
    record: CaptureRecord


def index_images(source_dir: Path) -> dict[str, StoredImage]:
    """The images of one source by the hash of their inputs; nothing where there is no manifest.

    Raises:
        ToolkitError: the manifest is broken.
    """
    return {
        record.inputs_sha256: StoredImage(inside(source_dir, path), record)
        for path, record in read_manifest(source_dir).items()
        if record.inputs_sha256
    }


def copy_image(stored: StoredImage, source_dir: Path, path: str) -> bool:
    """Copy an image to `source_dir / path` and into its manifest; False where its file is gone or was changed.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    try:
        content = stored.file.read_bytes()
    except OSError:
        return False
    if sha256_bytes(content) != stored.record.image_sha256:
        return False
    write_bytes(Path(source_dir) / path, content)
    append_record(source_dir, stored.record.model_copy(update={"path": path}))
    return True
