"""The card of a booster: `README.md` in the form of a model card, made from the booster's record."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from toolkit.objects.load import TableObject
from toolkit.rig.applied.base import AppliedBooster, BoosterKind

SHARES = re.compile(r"(?P<network>.+?)_(?P<where>held_out(?:_fog|_corrupted|_weather)?|mounted)_patched_top1")
WHERE = {
    "held_out": "clear", "held_out_fog": "fog", "held_out_corrupted": "corrupted", "held_out_weather": "weather",
    "mounted": "on the object",
}  # fmt: skip
Record = Mapping[str, Any]


def write_card(
    item: TableObject, kind: BoosterKind, booster: AppliedBooster, record: Record, files: Sequence[Path]
) -> str:
    """The card's text.

    Args:
        record: the content of the booster's JSON file.
        files: that lie beside the card, for the picture and the list.
    """
    # the training of some kinds is a part of their record
    trained = record if "networks" in record else record.get("booster") or {}
    label = record.get("class_name") or str(item.spec.class_name)
    picture = next((file.name for file in files if file.suffix == ".png"), None)
    folder, printed = (text.format(object=item.name) for text in (kind.folder, kind.print_options))
    lines = [
        "---", "tags:", "- unadversarial-example", "- image-classification", f"- {json.dumps(kind.noun)}", "---", "",
        f"# {item.name}: a {kind.noun}", "",
        f"A {kind.noun} that helps neural networks to recognise the object {item.name} as {label!r}, trained by "
        f"toolkit {trained['toolkit_version']}." if trained else
        f"A {kind.noun} for the object {item.name}, with a picture that was not trained.", "",
        *([f"![the {kind.noun}]({picture})", ""] if picture else []),
        *_list_facts(item, booster, record, trained), "",
        *_list_networks(trained), *_list_shares(trained),
        "## Use it", "", "```sh", *([f"toolkit print {printed}"] if printed else []),
        f"toolkit capture-sim --object {item.name} --variant unpatched --variant {kind.variant}",
        "toolkit eval captures/", "```", "",
        f"Copy the files into `{folder}` of a workspace that has the object. The "
        f"{kind.noun} fits this object alone, at this size.", "",
        *_list_limits(trained),
    ]  # fmt: skip
    return "\n".join(lines)


def _list_facts(item: TableObject, booster: AppliedBooster, record: Record, trained: Record) -> list[str]:
    long_mm = float(item.mesh.size_mm.max())
    rows = {"object": f"{item.name}, {long_mm:.0f} mm long", "mesh, SHA-256": item.shape_sha256}
    if booster.sizes_mm:
        rows["printed side"] = ", ".join(f"{side:g} mm" for side in booster.sizes_mm)
    rows |= booster.list_facts()
    texel = "" if booster.texel_mm is None else f", {booster.texel_mm:.3g} mm each"
    rows["texels"] = f"{len(booster.pixels)} × {len(booster.pixels)}{texel}"
    rows["SHA-256"] = booster.sha256
    # training data stand as they are in the record, so that the card can be checked against it
    if trained:
        rows["class"] = f"{record.get('class_name')} (index {trained['class_index']})"
        rows["seed"] = str(trained["seed"])
        rows["data"] = f"`{json.dumps(trained['data'], ensure_ascii=False)}`"
    return ["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())]


def _list_networks(trained: Record) -> list[str]:
    if not trained.get("networks"):
        return []
    rows = [f"| {net['arch']} | {net['weights']} | `{net['sha256']}` |" for net in trained["networks"]]
    return ["## Trained on", "", "| network | weights | SHA-256 |", "|---|---|---|", *rows, ""]


def _list_shares(trained: Record) -> list[str]:
    """Top-1 of each network with the booster and without, with intervals; nothing where the record has none."""
    # keys of the record are such as `resnet18_held_out_fog_patched_top1`
    final, rows = trained.get("final", {}), []
    for key in final:
        if (found := SHARES.fullmatch(key)) is None:
            continue
        place = f"{found['network']}_{found['where']}"
        cells = []
        # what was not measured stays an empty cell
        for what in ("bare", "patched"):
            top1, low, high, n = (final.get(f"{place}_{what}_{name}") for name in ("top1", "low", "high", "n"))
            cells.append("" if top1 is None else f"{top1:.0%} ({low:.0%} to {high:.0%}, n = {n:.0f})")
        rows.append(f"| {found['network']} | {WHERE[found['where']]} | {' | '.join(cells)} |")
    head = ["| network | views | without | with |", "|---|---|---|---|"]
    return ["## Accuracy on held-out views, 95 % intervals", "", *head, *rows, ""] if rows else []


def _list_limits(trained: Record) -> list[str]:
    if not trained:
        return []
    settings = json.dumps(trained["settings"], indent=1, ensure_ascii=False)
    return [
        "## Limits", "",
        "The shares above are of renders that were not trained on, and of networks that were. Judge other networks, "
        "and photographs of the real object, with `toolkit eval`.", "",
        "## Settings", "", "```json", settings, "```", "",
    ]  # fmt: skip
