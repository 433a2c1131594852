"""Measure photographs by others, into docs/records/photographs: python docs/scripts/photographs.py PART.

The photographs lie in a folder beside the repository (`../shared`); none of them comes into it.
"""

import csv
import itertools
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.imaging.colour import LINEAR_OF_CODE, delta_e2000, lab_of_linear, linear_to_srgb, srgb_to_linear
from toolkit.imaging.preprocessing import resize_and_crop
from toolkit.imaging.read import decode_image, encode_image, read_image
from toolkit.rig.board import CharucoBoard, MarkerGrid
from toolkit.rooms.photos.board_pose import find_board
from toolkit.rooms.photos.gates.framing import (
    NETWORK_SIDE_PX,
    check_blur,
    check_over_exposure,
    check_under_exposure,
    measure_edge_blur,
    middle_of,
)
from toolkit.rooms.photos.lens_fit import calibrate_lens
from toolkit.rooms.photos.prints.align import cell_centres
from toolkit.rooms.photos.prints.find import find_patch, search_photo, shrink_image
from toolkit.rooms.photos.prints.fitted_photo import KnownPatch, fit_photo, read_known
from toolkit.rooms.photos.prints.look import light_terms
from toolkit.rooms.photos.retexture import encode_like, make_controls, predict_texels, redraw

RECORDS = Path(__file__).parents[1] / "records" / "photographs"
SHARED = Path(__file__).resolve().parents[3] / "shared"
STICKERS = SHARED / "photos" / "stickers-keyboard"
PATCHES = sorted((STICKERS / "originals").glob("*.png"))
ARCHS = ("resnet18", "mobilenet_v2")
LEVELS = (0, 64, 160, 250)
"""Grey levels between which noise is told: ink and shadow, middle, paper."""
OTHERS_BOARD = CharucoBoard(7, 5, 30.0, 22.0, "DICT_4X4_50")


def find_stickers() -> dict[str, object]:
    """Stickers of known size in their photographs, and false finds in photographs of ImageNet's classes."""
    pixels = {file.stem: read_image(file) for file in PATCHES}
    sizes: dict[str, list[int]] = {}
    for file in sorted(STICKERS.glob("*.jpg")):
        name = file.stem.split("_")[0]
        if name not in pixels:
            continue
        photo = read_image(file)
        whole = find_patch(photo, pixels[name])
        sizes.setdefault("as taken", []).append(whole is not None)
        if whole is None:
            continue
        for side in (100, 75, 50, 45, 40, 35, 30):
            small = shrink_image(photo, side / whole.warp.side_px)
            seen = find_patch(small, pixels[name])
            right = (
                seen is not None and np.abs(seen.corners_px - whole.corners_px * side / whole.warp.side_px).max() < 4
            )
            sizes.setdefault(str(side), []).append(right)
    others = sorted((SHARED / "images" / "imagenet_one_each").rglob("*.*"))
    false, looks = [], 0
    for file in others:
        searched = search_photo(read_image(file))
        for name, patch in pixels.items():
            looks += 1
            seen = find_patch(searched, patch)
            if seen is not None:
                false.append([file.name, name, round(seen.confidence, 3)])
    found = {side: [sum(map(bool, hits)), len(hits)] for side, hits in sizes.items()}
    return {"found": found, "photographs": len(others), "looks": looks, "false": false}


def time_large() -> dict[str, object]:
    """Seconds of one core and memory to find, fit and retexture a photograph of 12 megapixels, alone in a process."""
    if os.environ.get("PHOTOGRAPHS_TIMED") != "1":
        rows = []
        for name in ("bear1_6in_over", "basketball2_3in_side"):
            done = subprocess.run(
                [sys.executable, __file__, "time", name], check=True, capture_output=True, text=True,
                env=os.environ | {"PHOTOGRAPHS_TIMED": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )  # fmt: skip
            rows.append(json.loads(done.stdout.splitlines()[-1]))
        return {"megapixels": 12.2, "photographs": rows}
    cv2.setNumThreads(1)
    name = sys.argv[2]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "large.jpg"
        Image.open(STICKERS / f"{name}.jpg").resize((4032, 3024), Image.Resampling.BICUBIC).save(file, quality=95)
        space = make_workspace(Path(folder) / "ws")
        given = [read_known(space, str(PATCHES[0])), read_known(space, str(PATCHES[3]))]
        known = read_known(space, str(STICKERS / "originals" / f"{name.split('_')[0]}.png"))
        small = Path(folder) / "warm.jpg"
        Image.open(STICKERS / f"{name}.jpg").save(small)
        fit_photo(small, [known])  # what is loaded and compiled once is no photograph's
        begin = time.process_time()
        fitted = fit_photo(file, [known])
        fit_s = time.process_time() - begin
        for picture in fitted.with_patches(given[:1], Draws(0, 0, "time")):
            encode_like(fitted.photo, picture)
        row = {
            "name": name, "fit_s": round(fit_s, 2), "whole_s": round(time.process_time() - begin, 2),
            "memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        }  # fmt: skip
    print(json.dumps(row))  # noqa: T201
    sys.exit()


def describe_picture(image: np.ndarray) -> dict[str, float]:
    """Noise by level, spectrum's slope, contrast, blur and white balance of (h, w, 3) uint8 sRGB."""
    luma = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    mean = cv2.blur(luma, (5, 5))
    spread = np.sqrt(np.maximum(cv2.blur(luma * luma, (5, 5)) - mean * mean, 0) * 25 / 24)
    row: dict[str, float] = {}
    for name, low, high in zip(("dark", "middle", "bright"), LEVELS, LEVELS[1:], strict=False):
        inside = (mean >= low) & (mean < high)
        if inside.sum() > 2000:  # the quietest tenth lies on even ground, at 0.8 of what even ground has
            row[f"noise {name}"] = float(np.percentile(spread[inside], 10) / 0.8)
    side = 512
    scale = side / min(luma.shape)
    small = cv2.resize(luma, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    top, left = (small.shape[0] - side) // 2, (small.shape[1] - side) // 2
    cut = small[top : top + side, left : left + side]
    window = np.hanning(side)[:, None] * np.hanning(side)
    power = np.abs(np.fft.fftshift(np.fft.fft2((cut - cut.mean()) * window))) ** 2
    y, x = np.mgrid[:side, :side] - side // 2
    radius = np.hypot(x, y).astype(int)
    mean_power = np.bincount(radius.ravel(), power.ravel()) / np.bincount(radius.ravel())
    steps = np.arange(8, 128)  # cycles over the square: below are shapes, above what shrinking and JPEG leave
    row["spectrum slope"] = float(np.polyfit(np.log(steps), np.log(mean_power[steps] + 1e-9), 1)[0])
    row["contrast"] = float(luma.std() / 255)
    row["clipped %"] = float(100 * (np.sort(image, axis=2)[..., 1] >= 252).mean())
    blur = measure_edge_blur(luma.astype(np.uint8), middle_of(image))
    if blur is not None:
        row["blur px"] = blur * NETWORK_SIDE_PX / min(luma.shape)
    open_pixels = image[(image < 250).all(axis=2)]
    grey = open_pixels.sum(axis=1)
    light = LINEAR_OF_CODE[open_pixels[grey >= np.percentile(grey, 90)]].mean(axis=0)
    row["red / green"], row["blue / green"] = float(light[0] / light[1]), float(light[2] / light[1])
    return row


def compare_rig(folders: dict[str, list[Path]]) -> dict[str, object]:
    """Median and the middle 80 % of each number, for each set of pictures."""
    sets: dict[str, object] = {}
    for name, files in folders.items():
        rows = [describe_picture(read_image(file)) for file in files]
        keys = dict.fromkeys(key for row in rows for key in row)
        sets[name] = {"n": len(rows)} | {
            key: [round(float(x), 3) for x in np.percentile([r[key] for r in rows if key in r], [10, 50, 90])]
            for key in keys
        }
    return {"what": "of each number the 10th, 50th and 90th percentile of the pictures", "sets": sets}


def answer_real() -> dict[str, object]:
    """How many photographs as they were taken each network names rightly, by size, place and what lies there."""
    from toolkit.models.load import load_classifier
    from toolkit.models.predict import predict

    told: dict[str, object] = {}
    for arch in ARCHS:
        network = load_classifier(arch, SHARED / "weights" / f"{arch}-imagenet.pth")
        how = network.preprocessing
        keyboard = network.class_index("computer keyboard")
        counts: dict[str, list[int]] = {}
        for file in sorted(STICKERS.glob("*.jpg")):
            name, _, place = file.stem.partition("_")
            what = "bare" if name == "clean" else ("picture" if name.endswith("control") else "sticker")
            row = counts.setdefault(f"{what} {place}".strip(), [0, 0])
            answer = predict([resize_and_crop(read_image(file, how.resize_px), how)], network)
            row[0] += int(answer.argmax() == keyboard)
            row[1] += 1
        told[arch] = counts
    return told


def some_of(files: list[Path]) -> list[Path]:
    """Eight of them, evenly."""
    return [files[round(k)] for k in np.linspace(0, len(files) - 1, 8)]


def real_and_rehearsed() -> dict[str, object]:
    """Photographs by others, and the pictures in the folders that are named after the part, as NAME=FOLDER."""
    photos = SHARED / "photos"
    real = {"phone, stickers on a keyboard": STICKERS, "camera, ChArUco board": photos / "charuco"}
    real["webcam, sheet of markers"] = photos / "aruco-sheet"
    folders = {name: some_of(sorted(folder.glob("*.jpg"))) for name, folder in real.items()}
    for said in sys.argv[2:]:
        name, _, folder = said.partition("=")
        folders[name] = sorted(Path(folder).rglob("*.jpg")) or sorted(Path(folder).rglob("*.png"))
    return compare_rig(folders)


def gather_retextured() -> dict[str, object]:
    """By network, variant and place: right, of how many, mean probability; from the runs in `eval` that are named."""
    places = ("3in_over", "3in_side", "6in_over", "6in_side")  # the photographs' order in each half, by name
    cells: dict[str, dict[str, list[tuple[int, float]]]] = {}
    for run in map(Path, sys.argv[2:]):
        with (run / "predictions.csv").open(encoding="utf-8") as file:
            for row in csv.DictReader(file):
                number = int(Path(row["path"]).stem.removeprefix("pose_")) - 1
                network = cells.setdefault(run.name.split("-")[0], {})
                for key in (row["variant"], f"{row['variant']} {places[number % 4]}"):
                    network.setdefault(key, []).append((int(row["correct_top1"]), float(row["true_prob"])))
    return {
        network: {
            key: [sum(hit for hit, _ in seen), len(seen), round(float(np.mean([share for _, share in seen])), 2)]
            for key, seen in found.items()
            if not key.startswith("unpatched ")
        }
        for network, found in cells.items()
    }


def draw_path(kind: str, sigma_px: float, rng: np.random.Generator) -> np.ndarray:
    """(256, 2) places of a camera that moves while it exposes, whose larger principal deviation is `sigma_px`."""
    if kind == "straight":
        turn = rng.uniform(0, 2 * np.pi)
        path = np.linspace(-0.5, 0.5, 256)[:, None] * [np.cos(turn), np.sin(turn)]
    else:  # a hand: its velocity drifts, so that it lingers and hastens
        drift = cv2.GaussianBlur(rng.normal(size=(256, 2)), (0, 0), 30, borderType=cv2.BORDER_REFLECT)
        path = np.cumsum(drift, axis=0)
    path = path - path.mean(axis=0)
    return path * sigma_px / np.sqrt(np.linalg.eigvalsh(np.cov(path.T))[-1])


def shake(image: np.ndarray, path: np.ndarray) -> np.ndarray:
    """The picture as it would be had the camera moved so: its light averaged along the path."""
    reach = int(np.ceil(np.abs(path).max())) + 2
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    low = np.floor(path).astype(int)
    for dx, dy in np.ndindex(2, 2):  # each place is shared by the four pixels round it
        share = np.abs(1 - dx - (path - low)[:, 0]) * np.abs(1 - dy - (path - low)[:, 1])
        np.add.at(kernel, (low[:, 1] + dy + reach, low[:, 0] + dx + reach), share)
    light = cv2.filter2D((image / 255.0) ** 2.2, cv2.CV_32F, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    return np.rint(255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def sharpen(image: np.ndarray) -> np.ndarray:
    """As phones do: an unsharp mask of once the difference."""
    sigma = max(1.5 * min(image.shape[:2]) / 1080, 0.8)
    picture = image.astype(np.float32)
    return np.clip(2 * picture - cv2.GaussianBlur(picture, (0, 0), sigma), 0, 255).astype(np.uint8)


def judge_gates() -> dict[str, object]:
    """Real photographs that the gates refuse, and shaken ones that they pass: [how many, of how many]."""
    counts: dict[str, list[int]] = {}

    def add(key: str, hit: bool) -> None:
        row = counts.setdefault(key, [0, 0])
        row[0] += bool(hit)
        row[1] += 1

    for folder in ("stickers-keyboard", "charuco", "aruco-sheet", "colour-card"):
        for number, file in enumerate(sorted((SHARED / "photos" / folder).glob("*.jpg"))):
            image, rng = read_image(file), np.random.default_rng(number)
            middle = middle_of(image[..., 0])
            for label, known in (("", None), *([("board: ", OTHERS_BOARD)] if folder == "charuco" else [])):
                shown = {"refused": image, "refused, sharpened": sharpen(image)}
                for kind, sigma in itertools.product(("straight", "hand"), (1.0, 2.0)):
                    shaken = shake(image, draw_path(kind, sigma * min(image.shape[:2]) / NETWORK_SIDE_PX, rng))
                    shown |= {f"{kind} {sigma:g} px": shaken, f"{kind} {sigma:g} px, sharpened": sharpen(shaken)}
                for what, picture in shown.items():
                    sighting = None if known is None else find_board(picture, known)
                    result = check_blur(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), middle, sighting, known)
                    add(label + what, result.failed if what.startswith("refused") else result.passed)
            add("over-exposed", check_over_exposure(image[middle], is_object=False).failed)
            add("under-exposed", check_under_exposure(None, image[middle]).failed)
    return {"what": "refused as they were taken; passed though shaken by a path of that deviation", "counts": counts}


def compare_boards() -> dict[str, object]:
    """Boards of others: frames, errors and focal lengths against OpenCV by hand; how often two deviations hold."""
    boards = {"charuco": OTHERS_BOARD, "aruco-sheet": MarkerGrid(4, 5, 42.5, 37.5, "DICT_6X6_50")}
    told: dict[str, object] = {}
    for name, board in boards.items():
        files = sorted((SHARED / "photos" / name).glob("*.jpg"))
        views = [view for file in files if (view := find_board(read_image(file), board)) is not None]
        found, rng = calibrate_lens(views), np.random.default_rng(7)
        world = [view.world_mm.astype(np.float32) for view in views]
        corners = [(view.corners_px - 0.5).astype(np.float32) for view in views]
        size = (views[0].width, views[0].height)
        rms, matrix, *_ = cv2.calibrateCamera(world, corners, size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3)
        owner = np.load(SHARED / "photos/charuco/camera_intrinsics.npz")["cameraMatrix"][0, 0]
        truth, within, apart = owner if name == "charuco" else found.lens.fx, [], []
        for _ in range(60):
            count, order = int(rng.integers(6, len(views) // 2 + 1)), rng.permutation(len(views))
            try:
                halves = [calibrate_lens([views[i] for i in part]) for part in (order[:count], order[count:][:count])]
            except ToolkitError:  # too little slant in one of them
                continue
            within += [abs(one.lens.fx - truth) < 2 * one.focal_sigma_px for one in halves]
            off, sure = np.ptp([one.lens.fx for one in halves]), np.hypot(*[one.focal_sigma_px for one in halves])
            apart.append(off < 2 * sure)
        told[name] = {
            "frames": [len(views), len(files)], "rms_px": round(found.reprojection_px, 3),
            "flat_px": round(found.flat_px, 3), "opencv_px": round(rms, 3), "fx": round(found.lens.fx, 1),
            "sigma": round(found.focal_sigma_px, 1), "opencv_fx": round(float(matrix[0, 0]), 1),
            "truth": round(float(truth), 1), "within": [sum(map(int, within)), len(within)],
            "disjoint": [sum(map(int, apart)), len(apart)],
        }  # fmt: skip
    return told


def even_out(said: np.ndarray, seen: np.ndarray, terms: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
    """(k, 3) linear light times a smooth factor for each channel, the exponential of `terms` (k, m), fitted to `seen`.

    Bright places count most, and 0.02 keeps noise in the blacks from being a factor. `known`: (k,) where it is fitted.
    """
    lit, known = said.copy(), np.ones(len(said), bool) if known is None else known
    for k in range(3):
        root, ratio = np.sqrt(said[:, k]) * known, np.log((seen[:, k] + 0.02) / (said[:, k] + 0.02))
        lit[:, k] *= np.exp(terms @ np.linalg.lstsq(terms * root[:, None], ratio * root, rcond=None)[0])
    return lit


def median_apart(one: np.ndarray, other: np.ndarray) -> float:
    """Median ΔE00 of linear colours (k, 3)."""
    return round(float(np.median(delta_e2000(*(lab_of_linear(np.clip(light, 0, 1.2)) for light in (one, other))))), 2)


def move(image: np.ndarray, beside_px: float, zoom: float = 1.0) -> np.ndarray:
    """The picture from a little beside, or nearer; its rim is repeated beyond it."""
    h, w = image.shape[:2]
    T = np.array([[zoom, 0, (1 - zoom) * w / 2 + beside_px], [0, zoom, (1 - zoom) * h / 2 + beside_px]])
    return cv2.warpAffine(image, T, (w, h), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def brighten(image: np.ndarray, factors: tuple[float, float, float]) -> np.ndarray:
    """The picture with so much more light in red, green and blue."""
    return np.rint(255 * linear_to_srgb(np.clip(LINEAR_OF_CODE[image] * factors, 0, 1))).astype(np.uint8)


def add_grain(image: np.ndarray) -> np.ndarray:
    """Noise of two grey levels."""
    noisy = image + np.random.default_rng(0).normal(0, 2, image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


CHANGES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "JPEG 85": lambda image: decode_image(encode_image(image, "JPEG", quality=85), Path("again.jpg")),
    "grain of 2": add_grain,
    "8 px beside": lambda image: move(image, 8),
    "30 px beside": lambda image: move(image, 30),
    "2 % nearer": lambda image: move(image, 0, 1.02),
    "5 % brighter": lambda image: brighten(image, (1.05, 1.05, 1.05)),
    "5 % bluer": lambda image: brighten(image, (1.0, 1.0, 1.05)),
}
"""Differences between two photographs by one hand, each alone, in 2016 × 1512 pixels."""


def check_stickers() -> dict[str, object]:
    """Stickers predicted from photographs of others in one place; how steady networks' answers on the true ones are."""
    from toolkit.models.load import load_classifier
    from toolkit.models.predict import predict

    networks = {arch: load_classifier(arch, SHARED / "weights" / f"{arch}-imagenet.pth") for arch in ARCHS}

    def ask(image: np.ndarray) -> dict[str, np.ndarray]:
        crops = {arch: resize_and_crop(image, network.preprocessing) for arch, network in networks.items()}
        return {arch: predict([crops[arch]], network)[0].numpy() for arch, network in networks.items()}

    known = [KnownPatch(file.stem, read_image(file)) for file in PATCHES]
    photos = {one.name: sorted(STICKERS.glob(f"{one.name}_*.jpg")) for one in known}
    fitted = [fit_photo(file, [one]) for one in known for file in photos[one.name]]
    taken, grey = [ask(one.image) for one in fitted], make_controls(50, 0)["grey-patch"]
    greyed = []
    for one in fitted:
        (picture,) = one.with_patches([grey], Draws(0, len(greyed), "grey"))
        greyed.append(ask(decode_image(encode_like(one.photo, picture), one.photo.path)))
    rows: list[dict[str, object]] = []
    counts: dict[str, dict[str, list[int]]] = {arch: {} for arch in ARCHS}
    margins: dict[str, dict[str, list[float]]] = {arch: {"alike": [], "not": []} for arch in ARCHS}

    def count(what: str, one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
        for arch in ARCHS:
            row = counts[arch].setdefault(what, [0, 0])
            row[0] += int(one[arch].argmax() == other[arch].argmax())
            row[1] += 1

    for (i, one), (j, other) in itertools.product(enumerate(fitted), repeat=2):
        place = one.photo.path.stem.partition("_")[2]
        if other.photo.path.stem.partition("_")[2] != place:
            continue
        draws = Draws(0, len(rows), "check")
        predicted, said, seen, good = predict_texels(one, other, draws)
        light, terms = [srgb_to_linear(texels[good]) for texels in (said, seen)], light_terms(cell_centres(50))[good]
        even = [even_out(*light, np.c_[np.ones(len(terms)), terms][:, :m]) for m in (1, 6)]
        rows.append({
            "place": place, "own": i == j, "texel_px": one.look.warp.side_px / 50,
            "delta_e": [median_apart(told, light[1]) for told in (light[0], *even)],
        })  # fmt: skip
        answers = ask(predicted)
        count("own patch put back" if i == j else "predicted", answers, taken[j])
        if i != j:
            count("drawn into the true one", ask(redraw(one, other, draws)), taken[j])
            for arch in ARCHS:
                second, first = np.sort(taken[j][arch])[-2:]
                is_alike = answers[arch].argmax() == taken[j][arch].argmax()
                margins[arch]["alike" if is_alike else "not"].append(float(first - second))
        if i < j:
            count("the same grey paper", greyed[i], greyed[j])
            count("two true ones, other stickers", taken[i], taken[j])
    for what, change in CHANGES.items():
        for file in sorted(STICKERS.glob("*.jpg")):
            image = read_image(file)
            count(what, ask(change(image)), ask(image))
    places: dict[str, object] = {}
    for place in (*dict.fromkeys(row["place"] for row in rows), "all"):
        part = [row for row in rows if place in ("all", row["place"])]
        others = np.array([row["delta_e"] for row in part if not row["own"]])
        places[str(place)] = {
            "n": len(others), "texel_px": round(float(np.median([row["texel_px"] for row in part])), 1),
            "other": [round(float(x), 2) for x in np.median(others, axis=0)],
            "own": round(float(np.median([row["delta_e"][0] for row in part if row["own"]])), 2),
        }  # fmt: skip
    told = {arch: {key: round(float(np.median(of)), 2) for key, of in margins[arch].items() if of} for arch in ARCHS}
    return {"delta_e": places, "alike": counts, "median_margin": told}


CARD_CELLS = np.array([
    (34 + 57 * (column + 0.5), 33 + 57 * (row + 0.5)) for row in range(9) for column in range(8)
    # its markers and its window are no colours
    if not (row == 0 and column in (0, 7)) and not (row in (4, 5) and column in (3, 4))
], np.float32)  # fmt: skip


def compare_rooms() -> dict[str, object]:
    """A colour card in two photographs by others: median ΔE00 of its cells from one to the other, light fitted."""
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_ARUCO_ORIGINAL))
    light, places = {}, {}
    for name in ("color-card.png", "ref.jpg", "test.jpg"):
        image = read_image(SHARED / "photos" / "colour-card" / name)
        factor = 3  # the markers are small
        corners, ids, _ = detector.detectMarkers(
            cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        )
        places[name] = {int(k): c.reshape(4, 2) / factor for k, c in zip(ids.ravel(), corners, strict=True)}
        known = sorted(set(places[name]) & set(places["color-card.png"]))
        to_photo, _ = cv2.findHomography(
            np.concatenate([places["color-card.png"][k] for k in known]),
            np.concatenate([places[name][k] for k in known]),
        )
        around = 24 * (cell_centres(7) - 0.5)
        at = cv2.perspectiveTransform((CARD_CELLS[:, None] + around).reshape(-1, 1, 2).astype(np.float32), to_photo)
        seen = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR).reshape(len(CARD_CELLS), -1, 3)
        light[name] = np.median(srgb_to_linear(seen / 255.0), axis=1)
    u, v = ((CARD_CELLS - CARD_CELLS.mean(axis=0)) / 256).T
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    medians, mixed = {}, {}
    for source, truth in (("ref.jpg", "test.jpg"), ("test.jpg", "ref.jpg")):
        one, other = light[source], light[truth]
        medians[f"{source} to {truth}"] = median_apart(even_out(one, other, terms), other)
        said = one.copy()
        for cell in range(len(one)):  # each is told from the others alone
            known = np.arange(len(one)) != cell
            lit = even_out(one, other, terms, known)
            trust = known[:, None] / (other + 0.05)
            for k in range(3):
                mix = np.linalg.lstsq(lit * trust[:, [k]], other[:, k] * trust[:, k], rcond=None)[0]
                said[cell, k] = lit[cell] @ mix
        mixed[f"{source} to {truth}"] = median_apart(said, other)
    return {"cells": len(CARD_CELLS), "delta_e_median": medians, "channels_mixed": mixed}


PARTS: dict[str, Callable[[], dict[str, object]]] = {
    "finder": find_stickers, "time": time_large, "rehearsal": real_and_rehearsed, "keyboard": answer_real,
    "retextured": gather_retextured, "gates": judge_gates, "boards": compare_boards,
    "rooms": compare_rooms, "retexture": check_stickers,
}  # fmt: skip

if __name__ == "__main__":
    part = sys.argv[1]
    found = PARTS[part]()
    RECORDS.mkdir(parents=True, exist_ok=True)
    (RECORDS / f"{part}.json").write_text(json.dumps(found, indent=1) + "\n")
