"""Classifiers in training: a task for the loop, views of images and attacks on them, a start, a test."""

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn.functional import affine_grid, cross_entropy, grid_sample

from toolkit import __version__
from toolkit.core.console import notice, progress
from toolkit.core.draws import Draws, image_seed
from toolkit.core.errors import FieldError
from toolkit.core.files import read_json, sha256_bytes, sha256_file, write_bytes, write_json
from toolkit.core.statistics import wilson_interval
from toolkit.core.work import INPUTS, Work, find_made
from toolkit.corruptions.batch import corrupt, draw_corrupted
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.architectures import build_network
from toolkit.models.find import ClassifierRecord, ClassShare, HeldOut, UnderAttack
from toolkit.models.network import Classifier
from toolkit.models.precision import autocast, choose_precision
from toolkit.models.predict import predict
from toolkit.models.vision import torchvision
from toolkit.models.weights import WeightsFile, read_state_dict, unwrap_names
from toolkit.training.classifier_config import Attack, Augmentation, ClassifierConfig, ClassPictures, Corrupting
from toolkit.training.data import Pack, TrainingSet
from toolkit.training.loop import History, TrainingTask
from toolkit.training.processes import current

# ITU-R BT.601's luma, of sRGB-encoded values
GREY_WEIGHTS = (0.299, 0.587, 0.114)
AUXILIARY_WEIGHT = 0.3
"""Loss weight of the side outputs that GoogLeNet and Inception have during training."""
UNFOLD_BATCHES = 8
TEST_BATCH, TEST_PART, TEST_STEPS = 64, 16, 20
"""Images at a time, and steps of the attack that a robust network is tested under."""
MOST_CONFUSIONS = 12


def augment_batch(
    images: torch.Tensor, rng: np.random.Generator, image_px: int, how: Augmentation,
    overlay: Callable[[torch.Tensor], torch.Tensor] = lambda batch: batch,
) -> torch.Tensor:  # fmt: skip
    """(b, 3, s, s) uint8 sRGB to (b, 3, image_px, image_px) float32, sRGB-encoded in [0, 1], varied at random.

    What `overlay` puts on the framed images is seen by the same camera: it has their colours, focus and noise.
    """
    batch = overlay(_cut(images.float().div_(255), rng, image_px, how))
    batch = _colour(batch, rng, how)
    batch = _blur(batch, rng, how)
    return _add_noise(batch, rng, how).clamp_(0, 1)


def _draw(rng: np.random.Generator, low_high: tuple[float, float], like: torch.Tensor) -> torch.Tensor:
    """Return (b, 1, 1, 1) uniform numbers, a number for each image of a batch."""
    return torch.from_numpy(rng.uniform(*low_high, (len(like), 1, 1, 1)).astype(np.float32)).to(like.device)


def _cut(batch: torch.Tensor, rng: np.random.Generator, image_px: int, how: Augmentation) -> torch.Tensor:
    count = len(batch)
    side = rng.uniform(*how.crop, (count, 1)) * (1 + rng.uniform(-how.stretch, how.stretch, (count, 2)))
    side = side.clip(0, how.crop[1])
    # the crop stays within the image, but for `shift` at either side
    middle = rng.uniform(-1, 1, (count, 2)) * (1 - side + 2 * how.shift)
    mirror = np.where(rng.random((count, 1)) < 0.5, -1.0, 1.0)
    # in affine_grid's units the image reaches from -1 to 1
    theta = np.zeros((count, 2, 3), np.float32)
    theta[:, 0, 0], theta[:, 1, 1], theta[:, :, 2] = side[:, 0] * mirror[:, 0], side[:, 1], middle
    grid = affine_grid(torch.from_numpy(theta).to(batch.device), [count, 3, image_px, image_px], align_corners=False)
    return grid_sample(batch, grid, "bilinear", "reflection", align_corners=False)


def _colour(batch: torch.Tensor, rng: np.random.Generator, how: Augmentation) -> torch.Tensor:
    weights = torch.tensor(GREY_WEIGHTS, device=batch.device).view(1, 3, 1, 1)
    grey = (batch * weights).sum(1, keepdim=True)
    batch = grey + (batch - grey) * _draw(rng, how.saturation, batch)
    # saturation moves values about each pixel's grey, contrast about the image's
    mean = grey.mean((2, 3), keepdim=True)
    batch = mean + (batch - mean) * _draw(rng, how.contrast, batch)
    tint = 1 + rng.uniform(-how.tint, how.tint, (len(batch), 3, 1, 1)).astype(np.float32)
    return batch * (_draw(rng, how.brightness, batch) * torch.from_numpy(tint).to(batch.device))


def _blur(batch: torch.Tensor, rng: np.random.Generator, how: Augmentation) -> torch.Tensor:
    """One sigma for all that are blurred: a convolution each would cost more than the network's first layer."""
    chosen = np.flatnonzero(rng.random(len(batch)) < how.blur_share)
    sigma = float(rng.uniform(*how.blur_sigma)) * batch.shape[-1]
    if len(chosen):
        reach = min(int(np.ceil(3 * sigma)), batch.shape[-1] - 1)
        which = torch.from_numpy(chosen).to(batch.device)
        blur = torchvision.transforms.functional.gaussian_blur
        batch[which] = blur(batch[which], [2 * reach + 1, 2 * reach + 1], [sigma, sigma])
    return batch


def _add_noise(batch: torch.Tensor, rng: np.random.Generator, how: Augmentation) -> torch.Tensor:
    # drawn on the CPU: a GPU's generator gives other numbers
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    noise = torch.randn(batch.shape, generator=generator).to(batch.device)
    return batch + noise * _draw(rng, how.noise_sigma, batch)


def corrupt_some(batch: torch.Tensor, rng: np.random.Generator, how: Corrupting) -> torch.Tensor:
    """(b, 3, s, s) float32 sRGB-encoded in [0, 1], a share of it corrupted; the batch is changed."""
    for chosen, name, severity, seeds in draw_corrupted(rng, len(batch), how.corruptions, how.share):
        which = torch.from_numpy(chosen).to(batch.device)
        batch[which] = corrupt(batch[which], name, severity, seeds)
    return batch


def find_worst_images(
    images: torch.Tensor, measure_losses: Callable[[torch.Tensor], torch.Tensor], attack: Attack
) -> torch.Tensor:
    """The images of the ball around each at which its loss was found to be largest, the image itself among them.

    Projected gradient descent (Madry et al. 2018); as in MadryLab's robustness library nothing is drawn at random.

    Args:
        images: (b, 3, h, w) float, sRGB-encoded in [0, 1].
        measure_losses: images to their losses (b,), differentiable; an image's loss may not depend on another image.
        attack: the ball and the steps.

    Returns:
        (b, 3, h, w) without gradient, in [0, 1].
    """
    images = moved = worst = images.detach()
    highest: torch.Tensor | None = None
    for _ in range(attack.steps):
        moved = moved.detach().requires_grad_()
        with torch.enable_grad():
            losses = measure_losses(moved)
            # the sum's gradient is each image's own, as no loss depends on another image
            (gradient,) = torch.autograd.grad(losses.sum(), moved)
        with torch.no_grad():
            # the image itself is asked in the first round
            worst, highest = _keep_higher(worst, highest, moved, losses)
            moved = attack.project(attack.climb(moved, gradient), images)
    with torch.no_grad():
        # the last place was reached and not yet asked
        worst, _ = _keep_higher(worst, highest, moved, measure_losses(moved))
    return worst.detach()


def _keep_higher(
    worst: torch.Tensor, highest: torch.Tensor | None, moved: torch.Tensor, losses: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    # the first asked is the image itself: what is found is never better for the network than that
    if highest is None:
        return moved, losses
    is_higher = losses > highest
    return torch.where(is_higher.view(-1, 1, 1, 1), moved, worst), torch.where(is_higher, losses, highest)


class _Sum(torch.autograd.Function):
    """Over all processes, of whose losses each holds a part: the gradients of a sum are summed as well."""

    @staticmethod
    def forward(ctx: object, tensor: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        return current().add(tensor)

    @staticmethod
    def backward(ctx: object, gradient: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        return current().add(gradient)


class SharedBatchNorm(nn.BatchNorm2d):
    """As `BatchNorm2d`, with the statistics of all processes' shares; torch's `SyncBatchNorm` takes GPUs alone."""

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(b, c, h, w) to the same shape; every process has as many images of the same size."""
        if not self.training or current().count == 1:
            return super().forward(images)
        # sums of many squares lose too much in half precision
        values = images if images.dtype == torch.float64 else images.float()
        count = values.numel() // values.shape[1] * current().count
        mean = _Sum.apply(values.sum((0, 2, 3))) / count
        # in two passes: the mean of squares less the square of the mean would cancel
        away = values - mean[:, None, None]
        variance = _Sum.apply(away.square().sum((0, 2, 3))) / count
        if self.running_mean is not None and self.running_var is not None and self.momentum is not None:
            with torch.no_grad():
                if self.num_batches_tracked is not None:
                    self.num_batches_tracked.add_(1)
                self.running_mean.lerp_(mean, self.momentum)
                # the running variance is the unbiased estimate, as torch's own
                self.running_var.lerp_(variance * (count / (count - 1)), self.momentum)
        normal = away * (variance + self.eps).rsqrt()[:, None, None]
        if self.affine:
            normal = normal * self.weight[:, None, None] + self.bias[:, None, None]
        return normal.to(images.dtype)


def share_norms(module: nn.Module) -> None:
    """Let every batch normalisation of a network see the whole batch; weights and their names stay."""
    for layer in module.modules():
        # without momentum torch averages over all batches so far, which is not what is shared here
        if type(layer) is nn.BatchNorm2d and layer.momentum is not None:
            # the class alone: weights, names and hooks stay where they are
            layer.__class__ = SharedBatchNorm


def are_folded(module: nn.Module) -> bool:
    """Whether all batch normalisation of a network has mean 0 and variance 1."""
    norms = _list_norms(module)
    return bool(norms) and all(
        # 1 - eps is folded as well: it makes √(variance + eps) equal 1
        bool((mean == 0).all() and ((variance - 1).abs() <= 2 * layer.eps).all())
        for layer, (mean, variance) in zip(norms, map(_running, norms), strict=True)
    )


def unfold_norms(module: nn.Module, batches: Iterable[torch.Tensor]) -> None:
    """Give batch normalisation the statistics of `batches` (b, 3, h, w); what the network says in eval mode stays."""
    norms = _list_norms(module)
    # double precision, on the CPU: sums over millions of values
    sums = {layer: torch.zeros(2, layer.num_features, dtype=torch.float64) for layer in norms}
    counts = dict.fromkeys(norms, 0)

    def measure(layer: nn.BatchNorm2d, inputs: tuple[torch.Tensor, ...]) -> None:
        values = inputs[0].double()
        counts[layer] += values.numel() // layer.num_features
        sums[layer] += torch.stack([values.sum((0, 2, 3)), values.square().sum((0, 2, 3))]).cpu()

    hooks = [layer.register_forward_pre_hook(measure) for layer in norms]
    with torch.no_grad():
        module.eval()
        for batch in batches:
            module(batch)
        for hook in hooks:
            hook.remove()
        for layer in norms:
            running_mean, running_var = _running(layer)
            mean, square = (sums[layer] / counts[layer]).to(running_mean.device)
            # rounding may leave a variance a little below 0
            variance = (square - mean.square()).clamp(min=0)
            # the layer's line through old statistics, with the new statistics: slope · x + offset stays the same
            slope = layer.weight.double() / (running_var.double() + layer.eps).sqrt()
            layer.bias.add_(slope * (mean - running_mean.double()))
            layer.weight.copy_(slope * (variance + layer.eps).sqrt())
            running_mean.copy_(mean)
            running_var.copy_(variance)


def _running(layer: nn.BatchNorm2d) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean and variance of a layer that `_list_norms` found."""
    assert layer.running_mean is not None and layer.running_var is not None
    return layer.running_mean, layer.running_var


def _list_norms(module: nn.Module) -> list[nn.BatchNorm2d]:
    return [layer for layer in module.modules() if isinstance(layer, nn.BatchNorm2d) and layer.track_running_stats]


@dataclass(frozen=True)
class ClassifierInputs:
    """What a classifier is trained on.

    Attributes:
        data: its images.
        used: classes that have images.
        pictures: what every image carries by its class, if anything.
        init: weights to start from, if any.
        words: what the images are, in a few words, and how the held-out images differ.
    """

    data: TrainingSet
    used: list[int]
    pictures: ClassPictures | None
    init: WeightsFile | None
    words: tuple[str, str]


class ClassifierTask(TrainingTask[ClassifierRecord]):
    """A network goes down the cross-entropy of augmented images of its classes."""

    work = Work("classifier", 1, old_at=0)
    recent = 50

    def __init__(self, config: ClassifierConfig, inputs: ClassifierInputs, file: Path, device: str) -> None:
        """Build the network at its start.

        Args:
            config: every setting.
            inputs: what it is trained on.
            file: of the weights; the record is written beside them.
            device: where it runs, `cpu` or `cuda`.
        """
        labels, how = inputs.data.labels, config.preprocessing()
        self.config, self.inputs, self.file = config, inputs, file
        self.title = f"Training {config.name}"
        self.advice = f"train again with {{restart}} and a lower {{lr}} than {config.lr:g}"
        self._how, self._device, self._precision = how, device, "float32"
        # in [0, 1], as images are before they are normalised
        self._mean, self._std = (torch.tensor(v, device=device).view(1, 3, 1, 1) for v in (how.mean, how.std))
        pictures = inputs.pictures
        self._overlay = None if pictures is None else pictures.fit(labels, inputs.used, config.image_px)
        network = start_network(config, len(labels), inputs.init)
        self.module = network.to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.batch = min(config.batch, len(inputs.data.train.images))
        # each process sees a part of the batch, whose own statistics would be noisier
        if current().count > 1:
            share_norms(self.module)

    def list_inputs(self) -> list[Any]:
        """Settings, labels, photographs, and the weights that it begins with."""
        config, inputs = self.config, self.inputs
        init_sha256 = "" if inputs.init is None else inputs.init.sha256
        settings = config.settings(inputs.pictures)
        return [config.name, config.arch, settings, inputs.data.labels, inputs.data.train.sha256, init_sha256]

    def parameters(self) -> dict[str, torch.Tensor]:
        """Weights and biases."""
        return dict(self.module.named_parameters())

    def buffers(self) -> dict[str, torch.Tensor]:
        """Statistics of batch normalisation."""
        return dict(self.module.named_buffers())

    def find_finished(self) -> ClassifierRecord | None:
        """The record, where the weights are whole and of the same inputs."""
        return find_finished(self.file, self.key)

    @contextmanager
    def open(self) -> Iterator[None]:
        """Choose the precision."""
        self._precision = choose_precision(self.config.arch, self.config.image_px, self._device)
        yield

    def begin(self) -> None:
        """Measure the statistics of batch normalisation where the given weights have lost them."""
        init, pack = self.inputs.init, self.inputs.data.train
        if init is not None and are_folded(self.module):
            notice(f"the batch normalisation of {init.name} is folded for evaluation: measuring its statistics again")
            # a phase of their own: what is measured is not what the first steps show
            batches = (self._draw_batch(pack, k, "unfold")[0] for k in range(UNFOLD_BATCHES))
            unfold_norms(self.module, (self._normalise(batch) for batch in batches))

    def loss(self, step: int) -> tuple[torch.Tensor, dict[str, float]]:
        """Cross-entropy, with that of side outputs where the network has them; and the share recognised."""
        # the whole batch is drawn, and each process takes its part: the draws do not depend on their number
        batch, classes = self._draw_batch(self.inputs.data.train, step, self.work.kind)
        batch, wanted = current().share(batch), torch.from_numpy(current().share(classes)).to(self._device)
        # images are moved to where the loss is high, before they are learnt
        if self.config.robust is not None:
            batch = self._attack(batch, wanted, self.config.robust)
        self.module.train()
        with autocast(self._precision, self._device):
            outputs = self.module(self._normalise(batch))
        # some networks have side outputs in training, which count less
        main, *sides = outputs if isinstance(outputs, tuple) else (outputs,)
        smoothing = self.config.label_smoothing
        loss = cross_entropy(main.float(), wanted, label_smoothing=smoothing)
        for side in sides:
            if side is not None:
                loss = loss + AUXILIARY_WEIGHT * cross_entropy(side.float(), wanted, label_smoothing=smoothing)
        return loss, {"accuracy": float((main.float().argmax(1) == wanted).float().mean())}

    def _attack(self, batch: torch.Tensor, wanted: torch.Tensor, attack: Attack) -> torch.Tensor:
        """The worst images around those of a batch, for the network in eval mode: by the statistics of all batches."""

        def measure_losses(images: torch.Tensor) -> torch.Tensor:
            with autocast(self._precision, self._device):
                logits = self.module(self._normalise(images))
            return cross_entropy(logits.float(), wanted, reduction="none")

        # running statistics: an image's worst neighbour does not depend on its batch
        self.module.eval()
        return find_worst_images(batch, measure_losses, attack)

    def _normalise(self, batch: torch.Tensor) -> torch.Tensor:
        # channels last, as the weights are: convolutions need no reordering
        return ((batch - self._mean) / self._std).contiguous(memory_format=torch.channels_last)

    def _draw_batch(self, pack: Pack, step: int, phase: str) -> tuple[torch.Tensor, np.ndarray]:
        """Images in [0, 1], augmented, with their pictures, some corrupted; and their classes."""
        draws = Draws(self.config.seed, step, phase)
        # by seed and step: every image once in each epoch
        chosen = choose_images(self.config.seed, step, self.config.batch, len(pack.images))
        images, classes = pack.images[chosen], pack.classes[chosen]
        raw = torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2))).to(self._device)

        def overlay(batch: torch.Tensor) -> torch.Tensor:
            if self._overlay is None:
                return batch
            return self._overlay(batch, classes, draws.of("overlay").integers(2**62, size=len(batch)).tolist())

        how = self.config.augmentation
        batch = augment_batch(raw, draws.of("augmentation"), self.config.image_px, how, overlay)
        # corruptions last: they act on the finished image
        if self.config.corrupting is not None:
            batch = corrupt_some(batch, draws.of("corruption"), self.config.corrupting)
        return batch, classes

    def finish(self, history: History) -> ClassifierRecord:
        """Test the rounded weights on the held-out images and write `NAME.safetensors`, then `NAME.json`."""
        from safetensors.torch import save

        config, how, data = self.config, self._how, self.inputs.data
        # what is tested is what is written
        halved = halve_weights(self.module.state_dict())
        content = save(halved)
        load_tensors(self.module, halved)
        self.module.eval()
        weights, labels = WeightsFile(self.file, sha256_bytes(content), self.file.name), list(data.labels)
        classifier = Classifier(
            config.arch, self.module, labels, how, weights, self._device, is_imagenet=False, name=config.name
        )
        own = {"precision": self._precision, INPUTS: self.key}
        return write_classifier(
            self.file, content, how, arch=config.arch, trained_on=self.inputs.words[0], labels=labels, data=data.record,
            seed=config.seed, settings=config.settings(self.inputs.pictures) | own,
            final=history.recent(self.recent), held_out=self._measure_held_out(classifier),
        )  # fmt: skip

    def _measure_held_out(self, classifier: Classifier) -> HeldOut:
        """Classify the held-out images through the classifier's own preprocessing, in single precision."""
        pack, robust = self.inputs.data.held_out, self.config.robust
        answers, attacked = (np.zeros(len(pack.images), np.int64) for _ in range(2))
        # tested with a fixed number of steps, whatever the number in training
        attack = None if robust is None else robust.with_overrides(steps=TEST_STEPS)
        title = "Testing on held-out images" + (f", and under attack ({attack.describe()})" if attack else "")
        with progress(title, len(pack.images)) as bar:
            for start in range(0, len(pack.images), TEST_BATCH):
                part = slice(start, start + TEST_BATCH)
                batch, classes = self._show_held_out(classifier, part)
                answers[part] = predict(batch, classifier, part=TEST_PART).argmax(1).numpy()
                if attack is not None:
                    # an attack follows the gradient of the same network that is tested
                    worst = find_worst_images(batch, partial(measure_losses, classifier, classes), attack)
                    attacked[part] = predict(worst, classifier, part=TEST_PART).argmax(1).numpy()
                bar.advance(len(batch))
        found = summarise_answers(classifier.labels, pack.classes, answers, self.inputs.words[1])
        if attack is None or not found.n:
            return found
        return found.model_copy(update={"under_attack": _summarise_attack(attack, pack.classes == attacked)})

    def _show_held_out(self, classifier: Classifier, part: slice) -> tuple[torch.Tensor, torch.Tensor]:
        """Some of the held-out images and their classes; what they carry lies where their number and the seed say."""
        pack = self.inputs.data.held_out
        batch = torch.stack([classifier.preprocess(image) for image in pack.images[part]]).to(classifier.device)
        classes = pack.classes[part]
        if self._overlay is not None:
            numbers = range(part.start, part.start + len(batch))
            seeds = [image_seed(self.config.seed, f"held-out/{number}") for number in numbers]
            batch = self._overlay(batch, classes, seeds)
        return batch, torch.from_numpy(np.ascontiguousarray(classes)).to(classifier.device)


def measure_losses(classifier: Classifier, classes: torch.Tensor, images: torch.Tensor) -> torch.Tensor:
    """(b,) cross-entropy of (b, 3, h, w) images, differentiable."""
    return cross_entropy(classifier.logits(images), classes, reduction="none")


def _summarise_attack(attack: Attack, right: np.ndarray) -> UnderAttack:
    n, correct = len(right), int(right.sum())
    return UnderAttack(
        norm=attack.norm, eps=attack.eps, steps=attack.steps, step_size=attack.step_size,
        n=n, correct=correct, accuracy=correct / n, ci95=wilson_interval(correct, n),
    )  # fmt: skip


def choose_images(seed: int, step: int, batch: int, count: int) -> np.ndarray:
    """Which of `count` images a step shows, sorted: every image once in each epoch's own order."""
    epoch, k = divmod(step, max(count // batch, 1))
    # 0x0E tells these draws from others of the same seed and number
    order = np.random.default_rng([seed, epoch, 0x0E]).permutation(count)
    # sorted: images lie in a file, which is read forwards
    return np.sort(order[k * batch : (k + 1) * batch])


def write_classifier(file: Path, content: bytes, how: Preprocessing, **about: Any) -> ClassifierRecord:
    """Write a classifier's file and its record, of which `about` has what file and preprocessing do not say.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    record = ClassifierRecord(
        name=file.stem, resize_px=how.resize_px, crop_px=how.crop_px, mean=how.mean, std=how.std,
        filter_name=how.filter_name, channels="BGR" if how.channels == "BGR" else None, squash=how.squash or None,
        sha256=sha256_bytes(content), toolkit_version=__version__, **about,
    )  # fmt: skip
    # the record last: where it is, the weights are whole
    write_bytes(file, content)
    write_json(file.with_suffix(".json"), record.model_dump(mode="json"))
    return record


def find_finished(file: Path, key: str) -> ClassifierRecord | None:
    """The record of a classifier that was trained by this key before and is whole; else None."""
    labels = file.with_suffix(".json")  # another kind of labels file is replaced
    record = find_made(
        key, lambda: read_json(labels, ClassifierRecord), lambda made: made.settings.get(INPUTS), file, labels
    )
    return None if record is None or record.sha256 != sha256_file(file) else record


def summarise_answers(labels: list[str], truth: np.ndarray, answers: np.ndarray, what: str) -> HeldOut:
    """Accuracy overall and by class, and the commonest mistakes, of class numbers (n,) and (n,)."""
    right = truth == answers
    per_class = {
        label: ClassShare(n=int((truth == k).sum()), correct=int(right[truth == k].sum()))
        for k, label in enumerate(labels)
    }
    # the commonest mistakes: true class and answer
    wrong = Counter(zip(truth[~right].tolist(), answers[~right].tolist(), strict=True))
    commonest = sorted(wrong.items(), key=lambda mistake: (-mistake[1], mistake[0]))[:MOST_CONFUSIONS]
    n, correct = len(truth), int(right.sum())
    return HeldOut(
        n=n,
        correct=correct,
        accuracy=correct / n if n else None,
        ci95=wilson_interval(correct, n),
        per_class=per_class,
        confusions=[(labels[true], labels[answer], count) for (true, answer), count in commonest],
        what=what,
    )


def halve_weights(state: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Half precision, but for whole numbers and for tensors that would leave its range."""
    halved = {}
    for name, value in state.items():
        half = value.detach().cpu().half() if value.is_floating_point() else value.detach().cpu()
        # half precision ends at 65504
        fits = bool(half.isfinite().all()) if half.is_floating_point() else True
        halved[name] = (half if fits else value.detach().cpu()).contiguous()
    return halved


def start_network(config: ClassifierConfig, classes: int, init: WeightsFile | None) -> nn.Module:
    """A network of the config's architecture, its weights drawn by the seed; with `init`, all but the last layer's.

    Raises:
        ToolkitError: the file holds weights of another network.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        module = build_network(config.arch, classes)
        _initialise(module, config.arch)
    if init is not None:
        _take_weights(module, config.arch, init)
    return module


def load_tensors(module: nn.Module, tensors: Mapping[str, torch.Tensor], strict: bool = True) -> None:
    """`load_state_dict` for tensors that have lost torch's notes on the versions of layers, which some need."""
    state = OrderedDict(tensors)
    state._metadata = module.state_dict()._metadata  # type: ignore[attr-defined]
    module.load_state_dict(state, strict=strict)


def _initialise(module: nn.Module, arch: str) -> None:
    """GoogLeNet and Inception are built bare, as they are for loading; here they need a start."""
    if arch not in ("googlenet", "inception_v3"):
        return
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d | nn.Linear):
            nn.init.trunc_normal_(layer.weight, std=0.05)


def _take_weights(module: nn.Module, arch: str, init: WeightsFile) -> None:
    own = module.state_dict()
    given = unwrap_names(read_state_dict(init), own, init.path)
    # side outputs for training only, and batch norm's step counter, may be absent
    needed = [name for name in own if not name.endswith("num_batches_tracked") and not name.lower().startswith("aux")]
    other = [name for name in needed if name not in given or given[name].shape != own[name].shape]
    # a single layer may differ: the last, whose classes are new
    layers = {name.rpartition(".")[0] for name in other}
    if len(layers) > 1:
        raise FieldError(
            f"holds no weights of {arch}: {len(layers)} layers differ (first: {sorted(layers)[0]}): "
            "name its network with {arch}",
            {"init": init.path},
        )
    fitting = {name: value for name, value in given.items() if name in own and value.shape == own[name].shape}
    load_tensors(module, fitting, strict=False)
