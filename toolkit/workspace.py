"""The folder that a user works in, and the package's own data behind it."""

from dataclasses import dataclass
from pathlib import Path

from toolkit.errors import ToolkitError, one_of

PACKAGE_DATA = Path(__file__).parent / "data"


@dataclass(frozen=True)
class Workspace:
    """A folder with `rig/`, `print/`, `captures/` and `eval/`; what it lacks comes from the package's data."""

    root: Path

    @property
    def plan_file(self) -> Path:
        """Where the capture plan is written."""
        return self.root / "rig" / "plan.json"

    @property
    def objects_dir(self) -> Path:
        """Specs of the user's own objects."""
        return self.root / "rig" / "objects"

    @property
    def print_dir(self) -> Path:
        """Printed pages."""
        return self.root / "print"

    @property
    def patches_dir(self) -> Path:
        """Trained patches and their records."""
        return self.root / "print" / "patches"

    @property
    def captures_dir(self) -> Path:
        """Images, by source."""
        return self.root / "captures"

    @property
    def eval_dir(self) -> Path:
        """Results, by run."""
        return self.root / "eval"

    def object_specs(self) -> dict[str, Path]:
        """Spec file of every known object by name; a file of the workspace wins over the package's."""
        return _named_files("objects", "*.toml", self.objects_dir)

    def patches(self) -> dict[str, Path]:
        """PNG of every known patch by name; a file of the workspace wins over the package's."""
        return _named_files("patches", "*.png", self.patches_dir)

    def object_spec(self, name: str) -> Path:
        """The spec of one object; an unknown name is a `ToolkitError`."""
        specs = self.object_specs()
        if name not in specs:
            raise one_of("object", name, sorted(specs))
        return specs[name]

    def patch(self, name: str) -> Path:
        """The PNG of one patch; an unknown name is a `ToolkitError`."""
        patches = self.patches()
        if name not in patches:
            raise one_of("patch", name, sorted(patches))
        return patches[name]


def _named_files(kind: str, pattern: str, own: Path) -> dict[str, Path]:
    found = {path.stem: path for path in sorted((PACKAGE_DATA / kind).glob(pattern))}
    return found | {path.stem: path for path in sorted(own.glob(pattern))}


def open_workspace(folder: Path | None = None) -> Workspace:
    """The workspace of a command: `folder` (from `--workspace`), else the nearest with `rig/` from here upwards.

    Where there is none, the current folder: built-in objects, plan and patches need no workspace.

    Raises:
        ToolkitError: `folder` was named and has no `rig/`.
    """
    if folder is not None:
        if not (Path(folder) / "rig").is_dir():
            raise ToolkitError(f"{folder} is no workspace (it has no rig/): make one with 'toolkit init {folder}'")
        return Workspace(Path(folder).resolve())
    here = Path.cwd()
    return Workspace(next((up for up in (here, *here.parents) if (up / "rig").is_dir()), here))
