"""Another patch put into a photograph of a printed one: renders whose truth is known, and real photographs."""

import io
import subprocess
import sys
from functools import cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from copier import print_colours
from PIL import ExifTags, Image

from toolkit.captures.manifest import read_manifest
from toolkit.captures.read import read_captures
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.imaging.colour import delta_e2000, lab_of_linear, linear_to_srgb, srgb_to_linear
from toolkit.imaging.preprocessing import Preprocessing, resize_and_crop
from toolkit.imaging.read import decode_image
from toolkit.rooms.photos.config import RetextureConfig
from toolkit.rooms.photos.photo import load_pixels, read_photo
from toolkit.rooms.photos.prints.colours import bending, cube_weights, solve_cube
from toolkit.rooms.photos.prints.fitted_photo import KnownPatch, fit_photo
from toolkit.rooms.photos.prints.look import _smooth_noise, draw_texels
from toolkit.rooms.photos.retexture import encode_like, retexture

SHARED = Path(__file__).resolve().parents[4] / "shared"
N, SIDE = 24, 240
CORNERS = np.array([[150, 110], [385, 128], [372, 366], [140, 340]], np.float32)
INKS = np.array([[0.70, 0.05, 0.02], [0.04, 0.62, 0.08], [0.03, 0.10, 0.66]])


def make_patch(seed: int) -> np.ndarray:
    """Blocks of bright colours: what is found and differs everywhere."""
    rng = np.random.default_rng(seed)
    fine = rng.integers(0, 2, (N, N, 3)) * 255
    coarse = rng.integers(0, 256, (N // 4, N // 4, 3)).repeat(4, 0).repeat(4, 1)
    return ((fine + 2 * coarse) // 3).astype(np.uint8)


def print_truth(pixels: np.ndarray) -> np.ndarray:
    """(n, n, 3) linear light of what this printer and camera make of a file's colours."""
    return 0.03 + srgb_to_linear(pixels / 255.0) @ INKS.T


def photograph(pixels: np.ndarray, **how: float) -> np.ndarray:
    """See `_photograph`; each is drawn once."""
    return _photograph(pixels.tobytes(), **how).copy()


@cache
def _photograph(
    content: bytes, seed: int = 0, blur_px: float = 0.7, noise: float = 1.5, wave: float = 0.0
) -> np.ndarray:
    """(480, 640, 3) uint8: the patch on a table, drawn at four times the size, with falling light, blur and noise.

    `wave`: how far the sheet's own waves move its texels, in texels.
    """
    pixels = np.frombuffer(content, np.uint8).reshape(N, N, 3)
    rng = np.random.default_rng(seed)
    table = cv2.GaussianBlur(np.random.default_rng(5).normal(0.3, 0.25, (480, 640, 1)), (0, 0), 4)[..., None]
    table = np.clip(0.25 + 3 * (table - 0.3), 0.05, 0.6).repeat(3, 2)
    big = print_truth(pixels).repeat(40, 0).repeat(40, 1)
    across = np.arange(len(big))
    moved = np.rint(40 * wave * np.sin(3 * np.pi * across / len(big))).astype(int)
    big = big[np.clip(across[:, None] + moved, 0, len(big) - 1), across]
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32) * big.shape[0]
    H = cv2.getPerspectiveTransform(unit, CORNERS * 4)
    drawn = cv2.warpPerspective(big, H, (2560, 1920), flags=cv2.INTER_LINEAR)
    cover = cv2.warpPerspective(np.ones(big.shape[:2]), H, (2560, 1920), flags=cv2.INTER_LINEAR)
    drawn, cover = (cv2.resize(one, (640, 480), interpolation=cv2.INTER_AREA) for one in (drawn, cover))
    light = drawn + (1 - cover[..., None]) * table
    light = light * np.linspace(0.85, 1.15, 640)[None, :, None]
    encoded = cv2.GaussianBlur(linear_to_srgb(light), (0, 0), blur_px) * 255 + rng.normal(0, noise, light.shape)
    return np.clip(np.rint(encoded), 0, 255).astype(np.uint8)


def save(path: Path, image: np.ndarray, **how: object) -> Path:
    path.parent.mkdir(exist_ok=True, parents=True)
    Image.fromarray(image).save(path, **how)
    return path


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return make_workspace(tmp_path / "ws")


def apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return delta_e2000(*(lab_of_linear(srgb_to_linear(image / 255.0)) for image in (one, other)))


def inner(shape: tuple[int, ...], shrink: float = 0.95) -> np.ndarray:
    middle = CORNERS.mean(axis=0)
    mask = np.zeros(shape[:2], np.uint8)
    cv2.fillConvexPoly(mask, np.rint(middle + shrink * (CORNERS - middle)).astype(np.int32), 1)
    return mask > 0


def test_a_cube_holds_every_straight_map_and_such_a_map_costs_nothing() -> None:
    colours = np.random.default_rng(0).random((200, 3))
    steps = np.linspace(0, 1, 7)
    nodes = np.array(list(product(steps, steps, steps)))
    assert np.allclose(cube_weights(colours) @ nodes, colours)
    straight = nodes @ [0.3, -0.2, 0.5] + 0.1
    assert abs(straight @ bending() @ straight) < 1e-9


def test_a_fitted_cube_says_what_unseen_colours_become() -> None:
    rng = np.random.default_rng(1)
    known, unseen = rng.random((1500, 3)), rng.random((300, 3)) * 0.8 + 0.1

    def curve(colours: np.ndarray) -> np.ndarray:
        return 0.1 + 0.8 * colours**1.3

    nodes, weight = solve_cube(cube_weights(known), curve(known), np.ones(len(known)))
    assert np.abs(cube_weights(unseen) @ nodes - curve(unseen)).max() < 0.02
    assert weight.min() >= 0


def test_pixels_are_means_of_texels() -> None:
    texels = np.arange(4.0).reshape(1, 4, 1).repeat(4, 0).astype(np.float32)
    # one pixel whose left third lies on texel 1 and the rest on texel 2; another wholly on texel 2
    u = np.array([[(2 + 1 / 6 * 0.5) / 4, 2.5 / 4]])
    uv = np.stack([u, np.full_like(u, 0.5)], -1)
    step = np.full_like(uv, 0.5 / 4)
    # half a texel wide, its centre a twelfth of a texel right of the edge: (0.25 - 1/12) / 0.5 of it is left of it
    assert np.allclose(draw_texels(texels, uv, step)[0, :, 0], [2 - (0.25 - 1 / 12) / 0.5, 2], atol=0.02)


def test_smooth_noise_is_as_strong_and_as_alike_as_said() -> None:
    white = np.random.default_rng(0).standard_normal((400, 400), np.float32)
    grain = _smooth_noise(white, 0.8)
    assert abs(grain.std() - 1) < 0.02
    # the autocorrelation of white noise through a Gaussian, at one pixel
    assert abs((grain[:, 1:] * grain[:, :-1]).mean() - np.exp(-1 / (4 * 0.8**2))) < 0.03


def test_another_patch_looks_as_if_it_had_been_photographed(tmp_path: Path) -> None:
    old, new = make_patch(1), make_patch(2)
    truth, rerun = photograph(new, seed=1), photograph(new, seed=2)
    fitted = fit_photo(save(tmp_path / "a.png", photograph(old)), [KnownPatch("old", old)])
    miss = np.linalg.norm(fitted.look.warp.corners - CORNERS, axis=1)
    assert miss.max() < 0.01 * SIDE
    (predicted,) = fitted.with_patches([KnownPatch("new", new)], Draws(0, 1, "test"))
    mask = inner(truth.shape)
    # two true photographs differ by their noise; the prediction may be little further away
    noise, error = (np.median(apart(one, truth)[mask]) for one in (rerun, predicted))
    assert error < noise + 1.5
    assert np.median(apart(photograph(old), truth)[mask]) > 15
    far = cv2.dilate(inner(truth.shape, 1.0).astype(np.uint8), np.ones((31, 31))) == 0
    assert (predicted[far] == fitted.image[far]).all()
    grain = [
        np.median(np.abs(cv2.Laplacian(one[..., 1].astype(np.float32), cv2.CV_32F))[mask]) for one in (predicted, truth)
    ]
    assert 0.8 < grain[0] / grain[1] < 1.25


@pytest.mark.slow
def test_colours_are_read_where_waves_of_the_paper_move_the_texels(tmp_path: Path) -> None:
    old = make_patch(1)
    fitted = fit_photo(save(tmp_path / "a.png", photograph(old, wave=0.6)), [KnownPatch("old", old)])
    colours = np.random.default_rng(3).integers(40, 216, (200, 1, 3)).astype(np.uint8)
    said, truth = fitted.look.colours(colours), linear_to_srgb(print_truth(colours))
    assert np.median(apart(255 * said, 255 * truth)) < 1.5, "1.9 where texels were read before the waves were known"


def test_what_hides_the_patch_stays(tmp_path: Path) -> None:
    old, new = make_patch(1), make_patch(2)
    image = photograph(old)
    cv2.circle(image, (300, 240), 32, (225, 170, 140), -1)
    fitted = fit_photo(save(tmp_path / "a.png", image), [KnownPatch("old", old)])
    (predicted,) = fitted.with_patches([KnownPatch("new", new)], Draws(0, 1, "test"))
    finger = np.zeros(image.shape[:2], np.uint8)
    cv2.circle(finger, (300, 240), 27, 1, -1)
    assert np.median(apart(predicted, image)[finger > 0]) < 1
    round_it = inner(image.shape) & (cv2.dilate(finger, np.ones((45, 45))) == 0)
    assert np.median(apart(predicted, image)[round_it]) > 10


@pytest.mark.slow
def test_a_folder_becomes_captures_that_eval_reads(tmp_path: Path, workspace: Workspace) -> None:
    old, new = save(tmp_path / "old.png", make_patch(1)), save(tmp_path / "new.png", make_patch(2))
    exif = Image.Exif()
    exif[0x0110] = "A phone"
    folder = tmp_path / "desk"
    taken = save(folder / "a.jpg", photograph(make_patch(1)), quality=83, subsampling=2, exif=exif.tobytes())
    save(folder / "b.jpg", photograph(make_patch(1))[:, ::-1].copy())
    save(folder / "c.jpg", photograph(make_patch(3)))
    bare = save(tmp_path / "bare.jpg", photograph(make_patch(4)))
    third = save(tmp_path / "third.jpg", photograph(make_patch(4), seed=1))
    (tmp_path / "broken.jpg").write_bytes(b"no picture")
    (folder / "linked.jpg").symlink_to(bare)
    config = RetextureConfig(found=(str(old),), given=(str(new),), bare=(bare, tmp_path / "broken.jpg", third))
    run = retexture(workspace, [folder], config)
    assert [Path(path).name for path, _ in run.skipped] == ["linked.jpg", "b.jpg", "c.jpg", "broken.jpg"]
    assert "a link" in run.skipped[0][1] and "mirrored" in run.skipped[1][1] and "not found" in run.skipped[2][1]
    (tmp_path / "links").mkdir()
    (tmp_path / "links" / "one.jpg").symlink_to(taken)
    with pytest.raises(ToolkitError, match=r"no photographs there: .*links/one.jpg: a link that leaves the folder"):
        retexture(workspace, [tmp_path / "links"], config)
    found = read_captures(run.folder)
    captures = found.captures
    assert any(note.startswith("retextured") and "desk/patched 1" in note for note in found.notes)
    variants = {one.variant for one in captures}
    assert variants == {"unpatched", "patched", "grey-patch", "random-patch", "as-taken"}
    assert run.paired and {one.source for one in captures} == {"retextured"}
    assert {one.pose_id for one in captures if one.variant != "unpatched"} == {1}
    assert {one.pose_id for one in captures if one.variant == "unpatched"} == {1, 3}
    with Image.open(taken) as one, Image.open(run.folder / "desk/patched/pose_01.jpg") as other:
        assert one.quantization == other.quantization  # type: ignore[attr-defined]
        assert other.getexif()[0x0110] == "A phone"
        # four chroma pixels were one in the photograph: in what is drawn like it that happens once, not twice
        assert one.layer[0][1:3] == (2, 2) and other.layer[0][1:3] == (1, 1)  # type: ignore[attr-defined]
    before = {file: file.stat().st_mtime_ns for file in run.folder.rglob("*.jpg") if "patch" in file.parent.name}
    retexture(workspace, [folder], config)
    assert {file: file.stat().st_mtime_ns for file in before} == before


@pytest.mark.parametrize(
    ("lost", "given", "pairs"), [(("b1", "p3"), 3, {"b2p2"}), (("p1",), 3, {"b2p2", "b3p3"}), (("b1",), 2, set())]
)
def test_bare_photographs_are_paired_before_any_is_refused(
    tmp_path: Path, workspace: Workspace, monkeypatch: pytest.MonkeyPatch, lost: tuple[str, ...], given: int, pairs: set
) -> None:
    """The one at the same place, whichever others cannot be used; none where another number is given."""
    old, new = save(tmp_path / "old.png", make_patch(1)), save(tmp_path / "new.png", make_patch(2))
    names = ["p1", "p2", "p3", *(f"b{k + 1}" for k in range(given))]
    for k, name in enumerate(names):
        file = save(tmp_path / name[0] / f"{name}.jpg", np.full((64, 64, 3), 20 * k, np.uint8))
        if name in lost:
            file.write_bytes(b"no picture")
    fitted = SimpleNamespace(
        facts=dict, patch=SimpleNamespace(sha256="0" * 64),
        with_patches=lambda some, draws: [np.zeros((64, 64, 3), np.uint8)] * len(some),
    )  # fmt: skip
    monkeypatch.setattr("toolkit.rooms.photos.retexture.fit_photo", lambda file, found: fitted)
    config = RetextureConfig(found=(str(old),), given=(str(new),), bare=(tmp_path / "b",))
    run = retexture(workspace, [tmp_path / "p"], config)
    taken: dict[int, str] = {}
    for record in sorted(read_manifest(run.folder).values(), key=lambda one: one.variant, reverse=True):
        if record.variant in ("unpatched", "as-taken") and record.pose_id is not None:
            name = str(record.made["original_name"]).removesuffix(".jpg")
            taken[record.pose_id] = taken.get(record.pose_id, "") + name
    assert {one for one in taken.values() if len(one) > 2} == pairs
    assert run.paired == (given == 3) and len(run.skipped) == len(lost)


def test_a_patch_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    old = make_patch(1)
    image = photograph(old)
    with pytest.raises(ToolkitError, match="there twice"):
        fit_photo(save(tmp_path / "a.png", np.concatenate([image, image], axis=1)), [KnownPatch("old", old)])


@pytest.mark.slow
def test_a_patch_half_outside_is_refused_and_one_that_is_mostly_inside_is_not(tmp_path: Path) -> None:
    old, image = make_patch(1), photograph(make_patch(1))
    with pytest.raises(ToolkitError, match=r"(only \d+% of the patch 'old' shows|the patch 'old' was not found)"):
        fit_photo(save(tmp_path / "half.png", image[:, 280:]), [KnownPatch("old", old)])
    fitted = fit_photo(save(tmp_path / "most.png", image[:, 190:]), [KnownPatch("old", old)])
    assert 0.6 < fitted.look.shown < 0.9, "a fifth of it lies beyond the edge"
    (predicted,) = fitted.with_patches([KnownPatch("new", make_patch(2))], Draws(0, 1, "test"))
    there, truth = inner(image.shape)[:, 190:], photograph(make_patch(2))[:, 190:]
    assert np.median(apart(predicted, truth)[there]) < 4 < np.median(apart(fitted.image, truth)[there])


@pytest.mark.slow
def test_what_glass_mirrors_lies_over_the_new_patch_too(tmp_path: Path) -> None:
    """A veil of a tenth over all of it is light like any other; a lamp's reflection hides what is under it."""
    old, new = make_patch(1), make_patch(2)
    behind = np.zeros((480, 640, 3))
    cv2.ellipse(behind, (270, 200), (45, 30), 0, 0, 360, (0.9, 0.9, 0.85), -1)
    behind = cv2.GaussianBlur(behind, (0, 0), 2) + 0.03

    def glaze(image: np.ndarray) -> np.ndarray:
        return np.rint(255 * linear_to_srgb(np.clip(0.9 * srgb_to_linear(image / 255.0) + behind, 0, 1))).astype(
            np.uint8
        )

    fitted = fit_photo(save(tmp_path / "a.png", glaze(photograph(old))), [KnownPatch("old", old)])
    (predicted,) = fitted.with_patches([KnownPatch("new", new)], Draws(0, 1, "test"))
    truth = glaze(photograph(new))
    mirrored = behind[..., 0] > 0.85
    clear = inner(truth.shape) & (cv2.dilate((behind[..., 0] > 0.04).astype(np.uint8), np.ones((41, 41))) == 0)
    assert np.median(apart(predicted, truth)[clear]) < 4 and np.median(apart(predicted, truth)[mirrored]) < 2


@pytest.fixture
def desk(tmp_path: Path) -> tuple[Path, Path]:
    """Five square photographs of a known patch, each a little brighter, and one without it; the patch's file."""
    image = photograph(make_patch(1))[:, :480].astype(float)
    for k in range(5):
        save(tmp_path / "desk" / f"{k}.png", np.clip(image * (0.8 + 0.05 * k), 0, 255).astype(np.uint8))
    save(tmp_path / "desk" / "bare.png", photograph(make_patch(3))[:, :480])
    return tmp_path / "desk", save(tmp_path / "old.png", make_patch(1))


@pytest.mark.slow
def test_views_of_photographs_show_a_patch_where_the_printed_one_was_found(
    workspace: Workspace, desk, monkeypatch
) -> None:
    """The printed patch in the colours that it has there gives the photograph back; others change its place alone."""
    import torch

    from toolkit.boosters.mounted import show_mounted
    from toolkit.rooms.photos.prints import fitted_photo as module

    monkeypatch.setattr(module, "WINDOW", (1.0, 1.0))  # the whole photograph
    folder, file = desk
    views, skipped = module.view_photos(
        workspace, [folder], [str(file)], size_px=N, size_mm=80.0, count=10, image_px=240, seed=0, device="cpu"
    )
    assert [Path(path).name for path, _ in skipped] == ["bare.png"] and "not found" in skipped[0][1]
    train, held_out = views.divide()
    assert (len(train), len(held_out)) == (8, 2), "two of each photograph, and all of the last one held out"

    def show(colours: np.ndarray) -> np.ndarray:
        patch = torch.from_numpy(np.ascontiguousarray(colours.transpose(2, 0, 1))).float()
        (picture,) = show_mounted(patch, views, np.array([0]), np.zeros((1, 2), int), 240)
        return picture.permute(1, 2, 0).numpy()

    fitted = fit_photo(folder / "0.png", [KnownPatch("old", make_patch(1))])
    inks, white = (srgb_to_linear(fitted.look.colours(p)) for p in (make_patch(1), np.full((1, 1, 3), 255, np.uint8)))
    truth = cv2.resize(fitted.image, (240, 240), interpolation=cv2.INTER_AREA) / 255.0
    place = np.zeros((240, 240), np.uint8)
    cv2.fillConvexPoly(place, np.rint(CORNERS / 2).astype(np.int32), 1)
    deep, far = cv2.erode(place, np.ones((7, 7))) > 0, cv2.dilate(place, np.ones((7, 7))) == 0
    miss = np.abs(show(linear_to_srgb(np.clip(inks / white, 0, 1))) - truth)
    assert np.median(miss[deep]) < 0.04 and np.median(miss[far]) < 0.01
    changed = (show(np.ones((N, N, 3))) - show(np.zeros((N, N, 3)))).min(axis=2)
    assert changed[deep].min() > 0.3 and np.abs(changed[far]).max() < 0.01


@pytest.mark.slow
def test_a_patch_is_trained_in_photographs_alone(workspace: Workspace, desk, monkeypatch, capsys) -> None:
    """No object, no mesh: the place is where the printed patch was found, and the record says what was seen."""
    from toolkit.cli import main
    from toolkit.objects.records import read_patch

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["toolkit", "train-patch", *arguments, "--workspace", str(workspace.root)])
        with pytest.raises(SystemExit) as stopped:
            main()
        return (int(stopped.value.code or 0), *capsys.readouterr())

    folder, file = desk
    asked = ["--found", str(file), "--class", "warplane", "--model", "rig18", "--size-px", "16", "--steps", "2"]
    asked += ["--batch", "2", "--mounted-views", "10", "--name", "desk"]
    code, said, told = run("--data", str(folder), *asked)
    assert code == 0, told
    assert "correct on the object" in said and "grey paper → patch: rig18" in said
    assert "bare.png" in told, "what shows no printed patch is listed"
    record = read_patch(workspace.patches_dir / "desk.png").record
    assert record.data["mounted_views_sha256"] and record.final["rig18_mounted_patched_n"] == 2
    for more, words in (
        (["--data", "rig:racer"], "expected folders of photographs"),
        (["--data", str(folder), "--weather", "fog"], "need the object itself"),
        (["--data", str(file.parent / "bare")], "none of 1 photographs could be used, 2 are needed"),
    ):
        save(file.parent / "bare" / "bare.png", photograph(make_patch(3)))
        code, _, told = run(*more, *asked)
        assert code == 2 and words in told and "Traceback" not in told


def test_retexturing_loads_no_torch() -> None:
    """It took half of the memory of a photograph of 12 megapixels."""
    asked = "import sys, toolkit.rooms.photos.retexture; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", asked], check=False).returncode == 0


def test_what_is_no_patch_is_said(workspace: Workspace, tmp_path: Path) -> None:
    wide = save(tmp_path / "wide.png", np.zeros((20, 30, 3), np.uint8))
    with pytest.raises(ToolkitError, match="expected the square file that was printed"):
        retexture(workspace, [tmp_path], RetextureConfig(found=(str(wide),), given=("nobody",)))


@pytest.mark.parametrize(("dimmed", "alike"), [(1.0, 1), (0.8, 0)])
def test_what_the_rest_of_two_photographs_changes_is_told_apart(
    workspace: Workspace, tmp_path: Path, dimmed: float, alike: int
) -> None:
    """A network that looks at the table alone: its answers differ where the light does, whatever patch is put there."""
    import torch

    from toolkit.rooms.photos.retexture import check_retexture, summarise

    first = photograph(make_patch(1))
    side = min(first.shape[:2])
    how = Preprocessing(side, side, (0.0,) * 3, (1.0,) * 3)
    limit = 0.9 * resize_and_crop(first, how)[:40, :40].mean() / 255

    def see_table(batch):
        light = batch[:, :, :40, :40].mean(dim=(1, 2, 3)) - limit
        return torch.stack([torch.zeros_like(light), light], dim=1)

    network = SimpleNamespace(
        name="table", arch="table", weights=SimpleNamespace(name="", sha256=""), device="cpu",
        labels=["dark", "light"], preprocessing=how, logits=see_table,
    )  # fmt: skip
    save(tmp_path / "photos" / "one_desk.png", first)
    save(tmp_path / "photos" / "two_desk.png", np.rint(dimmed * photograph(make_patch(2))).astype(np.uint8))
    patches = [str(save(tmp_path / f"{name}.png", make_patch(seed))) for name, seed in (("one", 1), ("two", 2))]
    found = check_retexture(workspace, [tmp_path / "photos"], patches, [network])  # type: ignore[list-item]
    assert found.same_scene == {"table": (alike, 1)} and not found.skipped
    assert [len(set(row.answers["table"])) == 1 for row in found.others] == [bool(alike)] * 2
    assert summarise(found.others)["alike_there"] == {"table": [2, 2]}, "the patch alone is drawn anew"


@pytest.mark.slow
def test_real_photographs_predict_each_other() -> None:
    folder = SHARED / "photos" / "stickers-keyboard"
    if not folder.is_dir():
        pytest.skip(f"the photographs of printed stickers are not in {folder}")
    from toolkit.rooms.photos.retexture import check_retexture, summarise

    photos = [folder / f"{name}_6in_side.jpg" for name in ("bear1", "bear2")]
    originals = [str(folder / "originals" / f"{name}.png") for name in ("bear1", "bear2")]
    found = check_retexture(Workspace(folder), photos, originals, [])
    assert not found.skipped and len(found.others) == 2
    # of all same-scene pairs the median was 2.9; these two are among the easier
    assert summarise(found.others)["delta_e_median"] < 2.5
    assert summarise(found.own)["delta_e_median"] < 2.0


@pytest.mark.slow
def test_a_profile_of_photographed_patches_prints_as_their_printer_does(tmp_path: Path) -> None:
    from toolkit.imaging.printer import white_paper
    from toolkit.rooms.photos.prints.profile_photos import profile_patches

    known = [KnownPatch(f"p{seed}", make_patch(seed)) for seed in (1, 2)]
    for patch in known:
        save(tmp_path / f"{patch.name}.png", photograph(patch.pixels))
    run = profile_patches([tmp_path], known, "desk")
    assert run.profile.held_out.median < 2.5 < run.profile.without.median / 2
    colours = np.random.default_rng(3).integers(40, 216, (20, 1, 3)).astype(np.uint8)
    truth = linear_to_srgb(print_truth(colours) / print_truth(np.full((1, 1, 3), 255, np.uint8)) * white_paper())
    said = print_colours(run.profile, colours / 255.0)
    assert np.median(apart(255 * said, 255 * truth)) < 3


def test_colours_of_an_adobe_rgb_photograph_are_converted_once(tmp_path: Path) -> None:
    """The camera's EXIF is kept, but not its word that the pixels are Adobe RGB: the picture's are sRGB."""
    exif = Image.Exif()
    exif[ExifTags.Base.Make] = "camera"
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ColorSpace] = 2
    file = save(tmp_path / "a.jpg", np.full((32, 32, 3), (60, 180, 70), np.uint8), exif=exif.tobytes())
    photo = read_photo(file)
    pixels = load_pixels(photo)
    again = encode_like(photo, pixels)
    assert np.abs(decode_image(again, file).astype(int) - pixels).max() <= 3
    assert Image.open(io.BytesIO(again)).getexif()[ExifTags.Base.Make] == "camera"
