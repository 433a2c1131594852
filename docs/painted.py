"""The textures' part of docs/results.md and its figure, from result files and records alone."""

from pathlib import Path
from typing import Any

from PIL import Image
from tiles import make_sheet, paste_tile

from toolkit.captures.read import POOLED
from toolkit.core.workspace import Workspace
from toolkit.objects.load import BUILTIN
from toolkit.objects.records import TextureRecord, read_texture

CLEAR, FOGGY = "sim-textures", "sim-textures-fog"
RUN = "textures-"
GRADIENTS = Path(__file__).parent / "records" / "gradients"
"""Records of the shipped textures' requests, trained with either gradient, and in fewer steps."""
VARIANTS = ("unpatched", "patched", "textured", "grey-texture", "random-texture")


MESHES = Path(__file__).parent / "records" / "meshes"
"""Records of textures of meshes that are not in the repository."""


def write_textures(space: Workspace, summaries: dict[str, dict[str, Any]]) -> list[str]:
    """Markdown lines; none where no texture was evaluated."""
    runs = {name.removeprefix(RUN): summary for name, summary in summaries.items() if name.startswith(RUN)}
    if not runs:
        return []
    lines = [
        "", "## Textures", "",
        "The plan's 18 poses per object, never trained on, in studio light and in ImageNet-C's fog of severity 3:",
        "top-1 of the bare object, with its patch, in its texture, and in grey and in noise in its place. Gained, lost",
        "and p compare the texture with the bare object.", "",
        "![bare, in its texture, and in its texture in fog](figures/textures.jpg)", "",
        "| network | weather | object | n | bare | patch | texture | 95 % | gained | lost | p | grey | noise |",
        "|---" * 13 + "|",
    ]  # fmt: skip
    for network, summary in sorted(runs.items(), key=lambda run: run[0] != "resnet18"):
        for source, weather in ((CLEAR, "studio"), (FOGGY, "fog")):
            lines += _list_objects(summary, source, network, weather)
    return [*lines, *_list_meshes(), *_compare_gradients(space)]


def _list_objects(summary: dict[str, Any], source: str, network: str, weather: str) -> list[str]:
    groups = {(row["object"], row["variant"]): row for row in summary["groups"] if row["source"] == source}
    pairs = {row["object"]: row for row in summary["pairs"] if row["source"] == source and row["variant"] == "textured"}
    lines = []
    for name in (*BUILTIN, POOLED):
        if name not in pairs:
            continue
        pair, textured = pairs[name], groups[name, "textured"]
        low, high = textured["top1_ci95"]
        shares = {
            variant: f"{groups[name, variant]['top1']:.0%}" if (name, variant) in groups else "–"
            for variant in VARIANTS
        }
        p = "< 0.0001" if pair["mcnemar_p"] < 1e-4 else f"{pair['mcnemar_p']:.2g}"
        lines.append(
            f"| {network} | {weather} | {f'**all {len(pairs) - 1}**' if name == POOLED else name} | {textured['n']} "
            f"| {shares['unpatched']} | {shares['patched']} | {shares['textured']} | {low:.0%}–{high:.0%} "
            f"| {pair['gained']} | {pair['lost']} | {p} | {shares['grey-texture']} | {shares['random-texture']} |"
        )
    return lines


def _list_meshes() -> list[str]:
    lines = [
        "", "### Other meshes", "",
        "Top-1 on held-out views (random poses, lights and backdrops) of meshes that are not part of the kit: the",
        "warplane of the paper's release, two low-poly models by Kenney, and a universal texture of two racers.", "",
        "| texture | objects | triangles' coordinates | steps | bare | texture | bare, fog | texture, fog | n |",
        "|---" * 9 + "|",
    ]  # fmt: skip
    for file in sorted(MESHES.glob("*.json")):
        record = TextureRecord.model_validate_json(file.read_text(encoding="utf-8"))
        network, final = record.networks[0].arch, record.final
        shares = [
            f"{final[f'{network}_{where}_{paint}_top1']:.0%}"
            for where in ("held_out", "held_out_fog")
            for paint in ("bare", "patched")
        ]
        names = ", ".join(one.name for one in record.objects)
        own = "made by the kit" if any(one.unwrapped for one in record.objects) else "their own"
        lines.append(
            f"| {record.name} ({record.class_name}) | {names} | {own} | {record.settings['steps']} "
            f"| {' | '.join(shares)} | {final[f'{network}_held_out_bare_n']:.0f} |"
        )
    return lines


def _compare_gradients(space: Workspace) -> list[str]:
    lines = [
        "", "### Which gradient trains better", "",
        "The same request with both gradients, seed and views alike: loss and share recognised over the last ten",
        "steps, and top-1 on held-out views (random poses, lights and backdrops) in studio light and in fog.", "",
        "| object | gradient | steps | last loss | last recognised | held out | held out, fog |", "|---" * 7 + "|",
    ]  # fmt: skip
    records = [TextureRecord.model_validate_json(file.read_text(encoding="utf-8")) for file in GRADIENTS.glob("*.json")]
    records += [read_texture(space.texture(name)).record for name in BUILTIN]
    for record in sorted(records, key=lambda one: (one.settings["steps"], one.name, one.settings["gradient"])):
        final, network = record.final, record.networks[0].arch
        clear, fog = (
            f"{final[f'{network}_{where}_patched_top1']:.0%} of {final[f'{network}_{where}_patched_n']:.0f}"
            for where in ("held_out", "held_out_fog")
        )
        lines.append(
            f"| {record.name} | {record.settings['gradient']} | {record.settings['steps']} | {final['loss']:.3f} "
            f"| {final['accuracy']:.0%} | {clear} | {fog} |"
        )
    return lines


def draw_textures(space: Workspace, rows: list[dict[str, str]], font) -> Image.Image:
    """Per object one pose: bare, in its texture, and in its texture in fog, with the network's first guess."""
    views = ((CLEAR, "unpatched"), (CLEAR, "textured"), (FOGGY, "textured"))
    sheet = make_sheet(len(BUILTIN), len(views))
    for column, name in enumerate(BUILTIN):
        found = {
            (row["source"], row["variant"], int(row["pose_id"])): row
            for row in rows
            if row["object"] == name and row["pose_id"]
        }
        poses = sorted(pose for source, variant, pose in found if (source, variant) == views[0])
        differs = [pose for pose in poses if found[(*views[0], pose)]["correct_top1"] not in ("1", "True", "true")]
        for line, view in enumerate(views):
            row = found[(*view, (differs or poses)[0])]
            paste_tile(sheet, space, row, column, line, font)
    return sheet
