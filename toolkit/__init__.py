"""Boost physical objects for a neural network, and prove that it worked: `import toolkit as tk`.

What is worth importing is listed here, once, in the order of the road: a workspace, objects and networks, training, the
page, the pose plan, pictures, evaluation. A name is loaded when it is first used, so that the import itself costs
nothing. Its docstring says shapes, units and errors. The packages behind it are open too, but their insides may move.
"""

TYPE_CHECKING = False  # as typing's own, without the time that importing it takes
if TYPE_CHECKING:
    __version__: str
    from toolkit.boosters.apply import apply_patch as apply_patch
    from toolkit.boosters.parts.affine import AffineRanges as AffineRanges
    from toolkit.boosters.train import train_patch as train_patch
    from toolkit.boosters.train import train_texture as train_texture
    from toolkit.captures.render import render as render
    from toolkit.captures.shoot import ShootSettings as ShootSettings
    from toolkit.captures.shoot import shoot_plan as shoot_plan
    from toolkit.cli.health import check_machine as check_machine
    from toolkit.core.console import quietly as quietly
    from toolkit.core.errors import ToolkitError as ToolkitError
    from toolkit.core.workspace import Workspace as Workspace
    from toolkit.core.workspace import make_workspace as make_workspace
    from toolkit.core.workspace import open_workspace as open_workspace
    from toolkit.corruptions.corrupt import corrupt as corrupt
    from toolkit.corruptions.draws import image_seed as image_seed
    from toolkit.evaluation.config import EvalConfig as EvalConfig
    from toolkit.evaluation.evaluate import evaluate_captures as evaluate_captures
    from toolkit.evaluation.notebook import load_captures as load_captures
    from toolkit.evaluation.notebook import predictions_table as predictions_table
    from toolkit.experiments.corruptions.config import CorruptEvalConfig as CorruptEvalConfig
    from toolkit.experiments.corruptions.evaluate import evaluate_benchmark as evaluate_benchmark
    from toolkit.models.load import load_classifier as load_classifier
    from toolkit.models.network import Classifier as Classifier
    from toolkit.objects.add import ObjectRequest as ObjectRequest
    from toolkit.objects.add import add_object as add_object
    from toolkit.objects.load import load_object as load_object
    from toolkit.objects.records import read_patch as read_patch
    from toolkit.objects.records import read_texture as read_texture
    from toolkit.printing.print_patches import print_patch as print_patch
    from toolkit.printing.settings import PrintSettings as PrintSettings
    from toolkit.rig.camera import Camera as Camera
    from toolkit.rig.mount import mount_patch as mount_patch
    from toolkit.rig.pattern import Pattern as Pattern
    from toolkit.rig.plan import plan_objects as plan_objects
    from toolkit.rig.plan import plan_poses as plan_poses
else:
    _HOMES = {
        "Workspace": "toolkit.core.workspace",
        "make_workspace": "toolkit.core.workspace",
        "open_workspace": "toolkit.core.workspace",
        "add_object": "toolkit.objects.add",
        "ObjectRequest": "toolkit.objects.add",
        "load_object": "toolkit.objects.load",
        "load_classifier": "toolkit.models.load",
        "Classifier": "toolkit.models.network",
        "train_patch": "toolkit.boosters.train",
        "train_texture": "toolkit.boosters.train",
        "read_patch": "toolkit.objects.records",
        "read_texture": "toolkit.objects.records",
        "apply_patch": "toolkit.boosters.apply",
        "AffineRanges": "toolkit.boosters.parts.affine",
        "mount_patch": "toolkit.rig.mount",
        "print_patch": "toolkit.printing.print_patches",
        "PrintSettings": "toolkit.printing.settings",
        "Camera": "toolkit.rig.camera",
        "Pattern": "toolkit.rig.pattern",
        "plan_poses": "toolkit.rig.plan",
        "plan_objects": "toolkit.rig.plan",
        "render": "toolkit.captures.render",
        "shoot_plan": "toolkit.captures.shoot",
        "ShootSettings": "toolkit.captures.shoot",
        "corrupt": "toolkit.corruptions.corrupt",
        "evaluate_captures": "toolkit.evaluation.evaluate",
        "EvalConfig": "toolkit.evaluation.config",
        "evaluate_benchmark": "toolkit.experiments.corruptions.evaluate",
        "CorruptEvalConfig": "toolkit.experiments.corruptions.config",
        "predictions_table": "toolkit.evaluation.notebook",
        "load_captures": "toolkit.evaluation.notebook",
        "image_seed": "toolkit.corruptions.draws",
        "check_machine": "toolkit.cli.health",
        "quietly": "toolkit.core.console",
        "ToolkitError": "toolkit.core.errors",
    }

    def __getattr__(name):
        """Load a name of the list above when it is first asked for (PEP 562)."""
        if name == "__version__":
            value = _find_version()
        elif name in _HOMES:
            from importlib import import_module

            value = getattr(import_module(_HOMES[name]), name)
        else:
            raise AttributeError(f"module 'toolkit' has no attribute '{name}'")
        globals()[name] = value
        return value

    def __dir__():
        return sorted({*globals(), *_HOMES, "__version__"})

    def _find_version():
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("toolkit-boost")
        except PackageNotFoundError:  # run from a source tree that was never installed
            return "0.0.0"
