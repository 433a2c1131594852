"""Draw the figures and write docs/results.md from a finished workspace: python docs/make.py WORKSPACE."""

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarked import write_benchmark_results
from everyday import draw_everyday
from painted import RUN, draw_textures, write_textures
from parts import draw_parts
from PIL import Image, ImageFont
from sections import write_summary, write_sweeps
from tiles import RIGHT, WRONG, make_sheet, paste_tile

from toolkit.core.workspace import Workspace, open_workspace
from toolkit.models.bundled import read_bundled
from toolkit.models.find import ClassifierRecord
from toolkit.objects.load import BUILTIN
from toolkit.objects.records import PatchRecord, read_patch
from toolkit.rig.variants import PAIR

DOCS = Path(__file__).parent
FIGURES = DOCS / "figures"


def read_predictions(space: Workspace, run: str) -> list[dict[str, str]]:
    """Rows of a run's predictions."""
    with (space.eval_dir / run / "predictions.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def draw_pairs(space: Workspace, rows: list[dict[str, str]]) -> Image.Image:
    """Per object the first pose at which bare and patched differ, else pose 1: bare above, patched below."""
    sheet, font = make_sheet(len(BUILTIN), 2), _font(18)
    for column, name in enumerate(BUILTIN):
        by_pose: dict[int, dict[str, dict[str, str]]] = {}
        for row in rows:
            if row["object"] == name and row["pose_id"]:
                by_pose.setdefault(int(row["pose_id"]), {})[row["variant"]] = row
        pairs = [pair for _, pair in sorted(by_pose.items()) if {"patched", "unpatched"} <= pair.keys()]
        differs = [pair for pair in pairs if pair["patched"]["correct_top1"] != pair["unpatched"]["correct_top1"]]
        chosen = (differs or pairs)[0]
        for line, variant in enumerate(("unpatched", "patched")):
            row = chosen[variant]
            paste_tile(sheet, space, row, column, line, font)
    return sheet


def _font(size: int) -> ImageFont.FreeTypeFont:
    """DejaVu, which has the marks; it comes with matplotlib."""
    from matplotlib import get_data_path

    return ImageFont.truetype(Path(get_data_path()) / "fonts/ttf/DejaVuSans.ttf", size)


def draw_contact_sheet(space: Workspace, rows: list[dict[str, str]]) -> Image.Image:
    """Every capture of the sim source: a row per object and variant, a column per pose, framed right or wrong."""
    names = sorted({row["object"] for row in rows})
    poses = sorted({int(row["pose_id"]) for row in rows if row["pose_id"]})
    w, h, frame = 128, 96, 3
    sheet = Image.new("RGB", (len(poses) * (w + 2 * frame), len(names) * 2 * (h + 2 * frame)), "white")
    for row in rows:
        if not row["pose_id"]:
            continue
        line = 2 * names.index(row["object"]) + (row["variant"] == "patched")
        left, top = poses.index(int(row["pose_id"])) * (w + 2 * frame), line * (h + 2 * frame)
        right = row["correct_top1"] in ("1", "True", "true")
        sheet.paste(RIGHT if right else WRONG, (left, top, left + w + 2 * frame, top + h + 2 * frame))
        picture = Image.open(space.captures_dir / row["path"]).convert("RGB")
        sheet.paste(picture.resize((w, h), Image.Resampling.LANCZOS), (left + frame, top + frame))
    return sheet


def draw_patches(space: Workspace) -> Image.Image:
    """The shipped patches side by side, pixel for pixel."""
    side, gap = 300, 16
    sheet = Image.new("RGB", (len(BUILTIN) * (side + gap) - gap, side), "white")
    for i, name in enumerate(BUILTIN):
        pixels = read_patch(space.patch(name)).pixels
        sheet.paste(Image.fromarray(pixels).resize((side, side), Image.Resampling.NEAREST), (i * (side + gap), 0))
    return sheet


def draw_page(space: Workspace, name: str) -> Image.Image:
    """The printed page as a picture."""
    import pypdfium2

    page = pypdfium2.PdfDocument(space.print_dir / f"{name}.pdf")[0]
    return page.render(scale=1.6).to_pil()


def draw_shot_list(space: Workspace) -> Image.Image:
    """The first two pages of the shot list, side by side."""
    import pypdfium2

    document = pypdfium2.PdfDocument(space.print_dir / "shot_list.pdf")
    pages = [document[number].render(scale=1.3).to_pil() for number in range(2)]
    sheet = Image.new("RGB", (sum(page.width for page in pages), pages[0].height), "white")
    for number, page in enumerate(pages):
        sheet.paste(page, (number * pages[0].width, 0))
    return sheet


def photograph_report(space: Workspace, run: str, target: Path) -> bool:
    """A picture of the report's top, where a Chromium is installed."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        return False
    report = (space.eval_dir / run / "report.html").resolve().as_uri()
    subprocess.run(
        [browser, "--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1200,1500",
         f"--screenshot={target}", report],
        check=True, capture_output=True,
    )  # fmt: skip
    return True


def photograph_studio(space: Workspace, target: Path) -> bool:
    """A picture of the studio's page as a phone shows it, where a Chromium is installed and there is a shot list."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None or not (space.root / "rig" / "shots.json").is_file():
        return False
    command = [sys.executable, "-m", "toolkit", "studio", "--workspace", str(space.root), "--port", "8797"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        address = server.stdout.readline().strip() if server.stdout else ""
        subprocess.run(
            [browser, "--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=430,1000",
             "--virtual-time-budget=15000", f"--screenshot={target}", address],
            check=True, capture_output=True,
        )  # fmt: skip
        server.terminate()
    return True


def read_summaries(space: Workspace, main_run: str) -> dict[str, dict[str, Any]]:
    """Every run's `summary.json` by its name, the main run first."""
    files = sorted(space.eval_dir.glob("*/summary.json"), key=lambda file: (file.parent.name != main_run, file))
    return {file.parent.name: json.loads(file.read_text(encoding="utf-8")) for file in files}


def write_results(space: Workspace, run: str = "resnet18") -> str:
    """The results page: a summary, the sweeps, and the tables of every run in the workspace."""
    summaries = read_summaries(space, run)
    lines = [
        "# Results",
        "",
        "Made by `python docs/make.py WORKSPACE` from the result files of `toolkit eval`; no number is typed by hand.",
        "Intervals are 95 % Wilson intervals; p is from an exact two-sided McNemar test over pairs of the same pose.",
        "",
        *write_summary({name: one for name, one in summaries.items() if not name.startswith(RUN)}),
        "",
        "Rows called `both-…` are of two patches trained on ResNet-18 and MobileNetV2 together (`print/patches/both`),",
        "the others of the shipped ones, trained on ResNet-18 alone. In rows called `board-…` the object stands on the",
        "printed ChArUco board, pale as `toolkit print --board` makes it, or black (`--ink 100`).",
        "",
        "![all captures](figures/contact-sheet.jpg)",
        "",
        "All captures of the shipped run: per object the bare row above the patched row, a column per pose, framed",
        "green where the network's first guess is right and red where it is wrong.",
    ]
    sets = [space, *(space.with_patches(one) for one in space.patch_sets())]
    lines += write_textures(space, summaries)
    lines += write_benchmark_results()
    lines += write_sweeps(space, FIGURES, run)
    for name, summary in summaries.items():
        model = summary["model"]
        patch_set = summary["groups"][0]["source"].partition("-")[2] or None
        own = next((one for one in sets if one.patch_set == patch_set), space)
        seen = {net.sha256 for patch in own.patches().values() for net in read_patch(patch).record.networks}
        role = f"a network that {'the patches were trained on' if model['sha256'] in seen else 'no patch saw'}"
        lines += [
            "", f"## {name}: {role}", "",
            f"{model['description']}, sha256 `{model['sha256'][:16]}…`.", "",
            "<details><summary>Every object and variant</summary>", "",
            "| source | object | variant | n | top-1 | 95 % interval | top-5 | mean p(true) |",
            "|---|---|---|---|---|---|---|---|",
        ]  # fmt: skip
        for group in summary["groups"]:
            low, high = group["top1_ci95"]
            lines.append(
                f"| {group['source']} | {group['object']} | {group['variant']} | {group['n']} | {group['top1']:.3f} | "
                f"{low:.3f}-{high:.3f} | {group['top5']:.3f} | {group['mean_true_prob']:.3f} |"
            )
        lines += ["", "| source | object | variant | pairs | gained | lost | McNemar p |", "|---" * 7 + "|"]
        for pair in summary["pairs"]:
            lines.append(
                f"| {pair['source']} | {pair['object']} | {pair['variant']} | {pair['n_pairs']} | {pair['gained']} | "
                f"{pair['lost']} | {pair['mcnemar_p']:.2g} |"
            )
        lines += [
            "", "</details>", "",
            *(f"- **{a['question']}** {a['verdict']}. {a['sentence']}" for a in summary["controls"]["answers"]),
        ]  # fmt: skip
    lines += ["", "## Patches", "", "![patches](figures/patches.png)", ""]
    lines += ["| patch | side | networks | data | settings | total variation | non-printability |", "|---" * 7 + "|"]
    for own in sets:
        for patch in own.patches().values():
            lines.append(_describe_patch(own.patch_set, read_patch(patch).record))
    bundled = read_bundled()
    if bundled is not None:
        lines += ["", "## rig18", "", *_describe_classifier(bundled)]
    return "\n".join(lines) + "\n"


def _describe_patch(patch_set: str | None, record: PatchRecord) -> str:
    networks = ", ".join(f"{net.weights} `{net.sha256[:8]}…`" for net in record.networks)
    settings = f"{record.settings['steps']} steps of {record.settings['batch']}, lr {record.settings['lr']:g}"
    scores = " | ".join(f"{record.final[score]:.3f}" for score in ("total_variation", "non_printability"))
    name = record.name if patch_set is None else f"{patch_set}/{record.name}"
    side = f"{record.n_px} px, {record.size_mm:.1f} mm"
    return f"| {name} | {side} | {networks} | {_describe_data(record)} | {settings} | {scores} |"


def _describe_classifier(record: ClassifierRecord) -> list[str]:
    """Held-out accuracy of the bundled classifier, of all kinds and of the four shipped ones."""
    held_out, (low, high) = record.held_out, record.held_out.ci95
    lines = [
        f"{record.arch} trained on {record.trained_on}, {record.crop_px} px, sha256 `{record.sha256[:16]}…`. On "
        f"{held_out.what} it is right on {held_out.correct} of {held_out.n} ({held_out.accuracy:.1%}, 95 % interval "
        f"{low:.1%}-{high:.1%}).",
        "",
        "| kind | held-out renders | right |",
        "|---|---|---|",
    ]
    for name in BUILTIN:
        share = held_out.per_class[name]
        lines.append(f"| {name} | {share.n} | {share.correct / share.n:.0%} |")
    mistakes = ", ".join(f"{true} taken for {answer} ({count})" for true, answer, count in held_out.confusions[:5])
    return [*lines, "", f"Commonest mistakes: {mistakes}."]


def _describe_data(record: PatchRecord) -> str:
    sources = [f"{source['used']} images of {source['source']}" for source in record.data["sources"]]
    share = record.settings.get("mounted_share", 0)
    if share:
        views = (
            f"{record.settings['mounted_views']} views of the object with the sheet mounted ({share:.0%} of each batch)"
        )
        sources.append(views)
    return ", ".join(sources)


def main(folder: str, run: str = "resnet18") -> None:
    """Write all figures and the results page."""
    space = open_workspace(Path(folder))
    FIGURES.mkdir(exist_ok=True)
    rows = [r for r in read_predictions(space, run) if r["source"] == "sim" and r["variant"] in PAIR]
    draw_pairs(space, rows).save(FIGURES / "pairs.jpg", quality=90)
    draw_contact_sheet(space, rows).save(FIGURES / "contact-sheet.jpg", quality=88)
    draw_patches(space).save(FIGURES / "patches.png")
    draw_page(space, "warplane").save(FIGURES / "page.png")
    if (space.print_dir / "shot_list.pdf").is_file():
        draw_shot_list(space).save(FIGURES / "shot-list.png")
    with Image.open(space.captures_dir / rows[0]["path"]) as photo:
        draw_parts(read_patch(space.patch(BUILTIN[0])).pixels, photo.convert("RGB"), _font(18)).save(
            FIGURES / "parts.png"
        )
    draw_everyday(_font(13)).save(FIGURES / "everyday.jpg", quality=90)
    if (space.eval_dir / f"{RUN}{run}").is_dir():
        rows = read_predictions(space, f"{RUN}{run}")
        draw_textures(space, rows, _font(18)).save(FIGURES / "textures.jpg", quality=90)
    photograph_report(space, run, FIGURES / "report.png")
    photograph_studio(space, FIGURES / "studio.png")
    (DOCS / "results.md").write_text(write_results(space, run), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
