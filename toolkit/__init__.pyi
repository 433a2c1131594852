"""The names of `import toolkit as tk`, in the order of the road: the one list that people, tools and Python read."""

__version__: str

from toolkit.core.workspace import Workspace as Workspace
from toolkit.core.workspace import make_workspace as make_workspace
from toolkit.core.workspace import open_workspace as open_workspace
from toolkit.objects.add import add_object as add_object
from toolkit.objects.add import ObjectRequest as ObjectRequest
from toolkit.objects.load import load_object as load_object
from toolkit.models.load import load_classifier as load_classifier
from toolkit.models.programs import wrap_module as wrap_module
from toolkit.models.network import Classifier as Classifier
from toolkit.boosters.train import train_patch as train_patch
from toolkit.boosters.train import train_texture as train_texture
from toolkit.objects.records import read_patch as read_patch
from toolkit.objects.records import read_texture as read_texture
from toolkit.boosters.apply import apply_patch as apply_patch
from toolkit.boosters.transforms.placement import AffineRanges as AffineRanges
from toolkit.rig.mount import mount_patch as mount_patch
from toolkit.printing.print_patches import print_patch as print_patch
from toolkit.printing.settings import PrintSettings as PrintSettings
from toolkit.rig.camera import Camera as Camera
from toolkit.rig.requests import Pattern as Pattern
from toolkit.rig.plan import plan_poses as plan_poses
from toolkit.rig.plan import plan_objects as plan_objects
from toolkit.captures.render import render as render
from toolkit.captures.shoot import shoot_plan as shoot_plan
from toolkit.captures.shoot import ShootSettings as ShootSettings
from toolkit.photos.retexture import retexture as retexture
from toolkit.photos.retexture_config import RetextureConfig as RetextureConfig
from toolkit.corruptions.batch import corrupt as corrupt
from toolkit.evaluation.evaluate import evaluate_captures as evaluate_captures
from toolkit.evaluation.eval_config import EvalConfig as EvalConfig
from toolkit.experiments.corruptions.benchmark_run import evaluate_benchmark as evaluate_benchmark
from toolkit.experiments.corruptions.benchmark_config import CorruptEvalConfig as CorruptEvalConfig
from toolkit.evaluation.notebook import predictions_table as predictions_table
from toolkit.evaluation.notebook import load_captures as load_captures
from toolkit.core.statistics import wilson_interval as wilson_interval
from toolkit.core.statistics import mcnemar_p as mcnemar_p
from toolkit.corruptions.draws import image_seed as image_seed
from toolkit.training.machine import check_machine as check_machine
from toolkit.core.console import quietly as quietly
from toolkit.core.errors import ToolkitError as ToolkitError
