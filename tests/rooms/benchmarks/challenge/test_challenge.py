"""Entries that keep the rules and entries that do not; scores that anybody can count again; the board."""

import json
import os
import shutil
import signal
import struct
import time
import zlib
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from forked import Forked, run
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes, sha256_file, write_bytes
from toolkit.core.workspace import PACKAGE_DATA, make_workspace
from toolkit.engine.local import LocalPool
from toolkit.models.load import load_classifier
from toolkit.objects.add import ObjectRequest, add_object
from toolkit.objects.records import NetworkRecord, decode_png, encode_png
from toolkit.rig.plan import read_plan
from toolkit.rooms.benchmarks.challenge import CLOSED_OBJECTS, POSES, EntryConfig
from toolkit.rooms.benchmarks.challenge import entry as entries
from toolkit.rooms.benchmarks.challenge import score as scores
from toolkit.rooms.benchmarks.challenge.board import rank_entries, write_board
from toolkit.rooms.benchmarks.challenge.entry import check_entry, init_entry, open_space, read_entry
from toolkit.rooms.benchmarks.challenge.score import (
    CONDITIONS,
    OUTCOMES,
    PICTURES,
    SCORE,
    SCORE_FILE,
    Judge,
    JudgedPicture,
    check_scores,
    choose_corruptions,
    read_judged,
    rescore,
    run_entry,
    write_score,
)

UNSEEN_SHA = "a" * 64
FEW = ("eggnog", "racer")
PICTURE = encode_png(np.full((24, 32, 3), 90, np.uint8))
DRIVER = f"""
import sys
from toolkit.rooms.benchmarks.challenge import entry
entry.POSES, entry.CLOSED_OBJECTS = 1, {FEW}
from toolkit.cli import app
space, *folders = sys.argv[1:]
for one in folders:
    app(["challenge", "run", one, "--judge", "rig18", "--workspace", space, "-q"], standalone_mode=False)
app(["challenge", "board", *folders, "--out", space + "/board", "-q"], standalone_mode=False)
"""


@pytest.fixture(scope="module")
def entered(tmp_path_factory):
    """The kit's own patches as an entry; tests that change it take a copy."""
    folder = tmp_path_factory.mktemp("entered")
    init_entry(make_workspace(folder / "space"), folder / "ours", EntryConfig())
    return folder / "ours"


@pytest.fixture
def entry(entered, tmp_path):
    return shutil.copytree(entered, tmp_path / "ours")


@pytest.fixture
def few(monkeypatch):
    """Entries of two objects, in one pose of each kind."""
    monkeypatch.setattr(entries, "POSES", 1)
    monkeypatch.setattr(entries, "CLOSED_OBJECTS", FEW)


def edit(folder, **changes):
    """Change fields of entry.json."""
    file = folder / "entry.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def claim_pixels(file, side_px):
    """A picture whose head tells of a huge one, with a record that says the same."""
    head = struct.pack(">4sIIBBBBB", b"IHDR", side_px, side_px, 8, 2, 0, 0, 0)
    content = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))
    file.write_bytes(content + file.read_bytes()[33:])
    record = file.with_suffix(".json")
    changes = {"n_px": side_px, "png_sha256": sha256_file(file)}
    record.write_text(json.dumps(json.loads(record.read_text()) | changes))


def make_up_score(folder, boosted, *, bare=0.25, name=None, unseen=UNSEEN_SHA):
    """A score of made-up answers: `boosted` of the pictures of each object are right with the patch."""
    if name is not None:
        edit(folder, name=name)
    read = read_entry(folder)
    trained = read.record.networks[0].sha256
    judges = [Judge(name=sha[:4], sha256=sha, preprocessing="", seen=sha == trained) for sha in (unseen, trained)]
    outcomes = [
        JudgedPicture(
            judge_sha256=judge.sha256, object=item, pose=pose, variant=variant, condition=condition, corruption="",
            severity=0, picture_sha256=sha256_bytes(PICTURE), correct=pose <= share[item] * 4,
            delta_e=10.0 if (variant, condition) == ("patched", "clear") else None,
        )
        for judge, condition, item, pose in product(judges, CONDITIONS, CLOSED_OBJECTS, range(1, 5))
        for variant, share in (("unpatched", dict.fromkeys(CLOSED_OBJECTS, bare)), ("patched", boosted))
    ]  # fmt: skip
    return write_score(read, judges, outcomes, dict.fromkeys(CLOSED_OBJECTS, PICTURE)).score


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
EVEN = dict.fromkeys(CLOSED_OBJECTS, 0.75)


def test_the_kits_own_patches_keep_the_rules(entered):
    assert check_entry(entered) == []


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda e: edit(e, link="javascript:alert(1)"), "link"),
        (lambda e: edit(e, name="../away"), "name"),
        (lambda e: edit(e, name="<script>alert(1)</script>"), "name"),
        (lambda e: edit(e, boosters={"../../etc/passwd": "0" * 64}), "boosters"),
        (lambda e: edit(e, boosters=read_entry(e).record.boosters | {"racer": "0" * 64}), "is not what entry.json"),
        (lambda e: claim_pixels(e / "boosters/racer.png", 30_000), "decompression bomb"),
        (lambda e: edit(e, networks=[]), "add it to networks"),
        (lambda e: edit(e, method="\x1b[2J"), "method"),
        (lambda e: edit(e, challenge_version=99), "challenge_version 99"),
        (lambda e: (e / "boosters/racer.png").unlink(), "racer.png is missing"),
        (lambda e: shutil.copy(e / "boosters/racer.png", e / "boosters/eggnog.png"), "does not match"),
        (lambda e: (e / "run.py").write_text("boom"), "run.py: has no place"),
        (lambda e: (e / "boosters/evil.py").write_text("boom"), "boosters/evil.py: has no place"),
        (lambda e: (e / "boosters/racer-x.uv.npz").write_text("boom"), "racer-x.uv.npz: has no place"),
        (lambda e: (e / "boosters/deep/er").mkdir(parents=True), "boosters/deep: has no place"),
        (lambda e: write_bytes(e / "score/more.py", b""), "score/more.py: has no place"),
        (lambda e: os.mkfifo(e / "README"), "README: is no file"),
        (lambda e: [write_bytes(e / f"boosters/{k}.png", b"") for k in range(100)], "80 more files"),
        (lambda e: edit(e, division="open"), "objects/racer.toml is missing: the open division"),
        (lambda e: (e / "objects").symlink_to("/etc"), "objects: a link"),
        (lambda e: (e / "boosters/more.png").symlink_to("/etc/passwd"), "a link"),
        (lambda e: (e / "entry.json").write_text("[" * 100_000), "entry.json"),
        (lambda e: shutil.rmtree(e), "is not an entry"),
    ],
)
def test_each_fault_is_one_line_and_nothing_is_written(entry, spoil, expected):
    spoil(entry)
    before = sorted(entry.rglob("*"))
    faults = check_entry(entry)
    assert any(expected in fault for fault in faults), faults
    assert all("\n" not in fault for fault in faults) and len(faults) <= 25
    assert sorted(entry.rglob("*")) == before


def test_an_object_of_ones_own_goes_into_the_entry_whole(tmp_path):
    """The mesh in a folder of its own, with its materials; nothing of the kit takes its place."""
    (tmp_path / "c.obj").write_text("mtllib c.mtl\nusemtl a\n" + TETRAHEDRON)
    (tmp_path / "c.mtl").write_text("newmtl a\nKd 1 0 0\n")
    space = make_workspace(tmp_path / "space")
    add_object(space, tmp_path / "c.obj", ObjectRequest(class_name="racer", name="own", length_mm=300))
    for suffix in (".png", ".json"):
        shutil.copy(PACKAGE_DATA / f"patches/racer{suffix}", space.patches_dir / f"own{suffix}")
    file = space.patches_dir / "own.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"name": "own"}))
    folder = tmp_path / "entry"
    init_entry(space, folder, EntryConfig(division="open", objects=("own",)))
    files = sorted(one.relative_to(folder).as_posix() for one in folder.rglob("*") if one.is_file())
    assert files == [
        "boosters/own.json", "boosters/own.png", "entry.json", "objects/own.toml", "objects/own/c.mtl",
        "objects/own/c.obj",
    ]  # fmt: skip
    assert check_entry(folder) == []
    (folder / "objects/own/c.png").write_bytes(b"")
    assert check_entry(folder) == ["objects/own/c.png: has no place in an entry of the open division: take it out"]


@pytest.mark.parametrize("spoil", [
    lambda place: (place / SCORE_FILE).write_text('{"kind": "challenge"}'),
    lambda place: (place / SCORE_FILE).unlink(),
    lambda place: (place / OUTCOMES).write_text("judge_sha256\n"),
    lambda place: (place / OUTCOMES).unlink(),
    lambda place: (place / PICTURES / "racer.png").unlink(),
])  # fmt: skip
def test_a_score_that_cannot_be_read_is_a_fault_of_the_check_alone(entry, spoil):
    make_up_score(entry, EVEN)
    assert check_scores(entry) == []
    spoil(entry / SCORE)
    done = CliRunner().invoke(app, ["challenge", "check", str(entry), "--json"])
    assert done.exit_code == 1 and len(json.loads(done.stdout)["faults"]) == 1, done.output
    assert check_entry(entry) == [], "it may be run again, which makes another score"


def test_a_booster_of_another_class_and_one_over_its_budget_are_refused(entry):
    for name, field, value in (("racer", "class_name", "tabby"), ("eggnog", "size_mm", 200.0)):
        file = entry / "boosters" / f"{name}.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | {field: value, "class_index": 281}))
    faults = "\n".join(check_entry(entry))
    assert "was trained for 'tabby'" in faults
    assert "200.0 mm on eggnog: expected at most" in faults


def test_the_plan_has_the_published_poses_and_as_many_that_nobody_trained_on(entered, tmp_path):
    plans = [read_plan(open_space(read_entry(entered), tmp_path / name).plan_file) for name in ("one", "two")]
    assert plans[0] == plans[1]
    for poses in plans[0].objects.values():
        assert [pose.id for pose in poses] == list(range(1, 2 * POSES + 1))
        assert len({(pose.azimuth_deg, pose.elevation_deg) for pose in poses}) == 2 * POSES


def test_each_corruption_is_met_about_as_often():
    chosen = choose_corruptions(product(CLOSED_OBJECTS, range(36)))
    counts = {pair: list(chosen.values()).count(pair) for pair in chosen.values()}
    assert len(counts) == 75
    assert set(counts.values()) <= {1, 2}


def test_gains_by_hand(entry):
    """Each object: 1 of 4 right bare, 3 of 4 with it: 50 points, with an interval over pictures."""
    found = make_up_score(entry, EVEN)
    row = next(row for row in found.pooled if row.condition == "fog")
    assert (row.n, row.bare, row.boosted, row.gained, row.lost) == (16, 4, 12, 8, 0)
    assert found.rank_gain == 0.5
    assert found.rank_ci95[0] == pytest.approx(0.5 - 2.13145 * 0.5 * np.sqrt(16 / 15) / 4, abs=1e-5)  # t of 15 degrees
    uneven = make_up_score(entry, EVEN | {"racer": 0.25})  # gains 2, 2, 0, 2 of 4
    assert uneven.rank_gain == 0.375
    half = 3.182446 * np.sqrt(4 / 3 * (3 * 0.125**2 + 0.375**2)) / 4  # t of 3 degrees, ratio estimator of 4 clusters
    assert uneven.rank_ci95 == pytest.approx((0.375 - half, 0.375 + half), abs=1e-6)


def test_a_network_that_the_entry_names_is_no_judge(entry):
    trained = read_entry(entry).record.networks[0].sha256
    found = make_up_score(entry, EVEN)
    assert {judge.sha256: judge.seen for judge in found.judges} == {UNSEEN_SHA: False, trained: True}
    assert {row.n for row in found.pooled} == {16}  # of one judge


@pytest.mark.parametrize("tamper", ["rank", "row", "outcome", "seen", "official", "picture"])
def test_a_tampered_score_is_found(entry, tamper):
    make_up_score(entry, EVEN | {"racer": 0.25})
    assert rescore(entry) == []
    file = entry / SCORE / SCORE_FILE
    content = json.loads(file.read_text())
    if tamper == "rank":
        content["rank_ci95"][0] += 0.1
    elif tamper == "row":
        content["rows"][0]["boosted"] += 1
    elif tamper == "seen":
        content["judges"][1]["seen"] = False
    elif tamper == "official":
        content["is_official"] = True
    elif tamper == "picture":
        write_bytes(entry / SCORE / PICTURES / "racer.png", encode_png(np.zeros((8, 8, 3), np.uint8)))
    else:
        lines = (entry / SCORE / OUTCOMES).read_text().splitlines()
        changed = lines[1].replace(",0,", ",1,", 1) if ",0," in lines[1] else lines[1].replace(",1,", ",0,", 1)
        (entry / SCORE / OUTCOMES).write_text("\n".join([lines[0], changed, *lines[2:]]) + "\n")
    file.write_text(json.dumps(content))
    assert rescore(entry)


def test_a_score_without_some_poses_is_not_official(entry, monkeypatch):
    """Four of the 36 pictures of each object, by the division's judges."""
    judges = (UNSEEN_SHA, read_entry(entry).record.networks[0].sha256)
    monkeypatch.setattr(scores, "JUDGES", {sha[:4]: sha for sha in judges})
    assert not make_up_score(entry, EVEN).is_official
    partial = read_judged(entry).score
    monkeypatch.setattr(scores, "POSES", 2)  # a version with as many poses
    whole = make_up_score(entry, EVEN)
    assert whole.is_official and whole.class_of != partial.class_of  # never ranked together
    assert rescore(entry / "score-2") == []


def test_boosters_that_were_swapped_after_the_score_are_found(entry, tmp_path):
    """The mean of their colours stays, so that only their hashes tell."""
    make_up_score(entry, EVEN)
    for suffix in (".png", ".json"):
        files = [entry / "boosters" / f"{name}{suffix}" for name in ("eggnog", "racer")]
        contents = [file.read_bytes() for file in files]
        for file, content in zip(files, reversed(contents), strict=True):
            file.write_bytes(content)
    assert [fault for fault in rescore(entry) if "eggnog.png: is not what entry.json names" in fault]
    with pytest.raises(ToolkitError, match=r"no entry to rank: .*eggnog\.png: is not what entry\.json names"):
        write_board([entry], tmp_path / "board")


@pytest.mark.slow
def test_a_score_by_other_judges_lies_beside_the_first(entry, tmp_path, capsys):
    make_up_score(entry, EVEN)
    first = read_folder(entry / SCORE)
    make_up_score(entry, EVEN | {"racer": 0.25}, unseen="5" * 64)
    assert read_folder(entry / SCORE) == first
    assert "score holds another result, and stays as it is" in capsys.readouterr().err
    # both are the entry's: they have a place in it, are checked, and can be ranked
    other = entry / "score-2"
    assert check_entry(entry) == check_scores(entry) == rescore(entry) == rescore(other) == []
    assert [read_judged(place).score.rank_gain for place in (entry, other)] == [0.5, 0.375]
    assert write_board([other], tmp_path / "board")[0][0].score.rank_gain == 0.375
    (other / PICTURES / "racer.png").unlink()
    assert len(check_scores(entry)) == 1 and rescore(entry) == [] and rescore(other)
    # the same judges again: their score is replaced
    make_up_score(entry, EVEN, unseen="5" * 64)
    assert read_judged(other).score.rank_gain == 0.5 and rescore(other) == []
    assert not (entry / "score-3").exists()


def test_the_board_ranks_by_the_lower_bound_and_shares_ties(entered, tmp_path):
    shares = {"steady": EVEN, "also": EVEN, "uneven": EVEN | {"racer": 1.0, "eggnog": 0.25}}
    folders = []
    for name, boosted in shares.items():
        folders.append(shutil.copytree(entered, tmp_path / name))
        make_up_score(folders[-1], boosted, name=name)
    folders.append(shutil.copytree(folders[0], tmp_path / "liar"))
    edit(folders[-1], name="liar")
    places, refused = write_board(folders, tmp_path / "board")
    assert [name for name, _ in refused] == [str(folders[-1])]
    assert len(places) == 3
    page = (tmp_path / "board/index.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert sorted(file.name for file in (tmp_path / "board").iterdir()) == [
        "also.json", "board.csv", "index.html", "steady.json", "uneven.json"
    ]  # fmt: skip
    ranked = rank_entries([read_judged(folder) for folder in folders[:3]])
    rank_of = {place.score.entry.name: place.rank for place in ranked}
    assert rank_of["steady"] == rank_of["also"] != rank_of["uneven"]
    with pytest.raises(ToolkitError, match="two entries are called"):
        write_board([folders[0], folders[0]], tmp_path / "twice")


def make_up_run(folder, boosters, gained, *, variant="patched"):
    """An evaluation of three renderers' images: how many of 36 pairs each gained."""
    renderers = ["raycast", "filament (open3d 0.19.0)", "mitsuba 3.9.1 llvm_ad_rgb"]
    sources = ["sim", "sim-filament", "sim-mitsuba"]
    summary = {
        "schema_version": 1,
        "model": {"arch": "resnet18"},
        "rests_on": {
            "sources": [
                {"source": one, "boosters": [{"variant": variant, "name": "", "sha256": sha[:12]} for sha in boosters]}
                for one in sources
            ]
        },
        "renderers": [
            {
                "sources": sources, "renderers": renderers,
                "gains": [
                    {"source": one, "variant": variant, "n_pairs": 36, "gained": up, "lost": 0}
                    for one, up in zip(sources, gained, strict=True)
                ],
            }
        ],
    }  # fmt: skip
    folder.mkdir()
    (folder / "summary.json").write_text(json.dumps(summary))
    return folder


def test_the_board_says_in_which_renderers_a_gain_holds(entered, tmp_path):
    """6 of 6 have p = 0.03, 5 of 5 have 0.06; what was shot of other boosters counts for nobody."""
    ours, others = (shutil.copytree(entered, tmp_path / name) for name in ("ours", "others"))
    make_up_score(ours, EVEN, name="ours")
    hashes = read_entry(ours).record.boosters
    for name in hashes:
        file = others / "boosters" / f"{name}.png"
        write_bytes(file, encode_png(255 - decode_png(file.read_bytes(), file)))
        record = file.with_suffix(".json")
        record.write_text(json.dumps(json.loads(record.read_text()) | {"png_sha256": sha256_file(file)}))
    edit(others, boosters={name: sha256_file(others / "boosters" / f"{name}.png") for name in hashes})
    make_up_score(others, EVEN | {"racer": 0.5}, name="others")
    shot = [hashes["racer"], hashes["eggnog"]]
    runs = [
        make_up_run(tmp_path / "all", shot, (6, 7, 8)), make_up_run(tmp_path / "some", shot, (6, 5, 0)),
        make_up_run(tmp_path / "foreign", [*shot, "f" * 64], (6, 7, 8)),
        make_up_run(tmp_path / "worn", shot, (6, 7, 8), variant="textured"),
    ]  # fmt: skip
    places, _ = write_board([ours, others], tmp_path / "board", runs)
    said = {place.score.entry.name: place.renderers for place in places}
    assert said == {"others": (), "ours": (
        "resnet18, 36 pairs: holds in all 3 renderers",
        "resnet18, 36 pairs: holds in raycast, and is not shown in filament and mitsuba",
    )}  # fmt: skip
    page = (tmp_path / "board/index.html").read_text()
    assert "several renderers" in page and said["ours"][1] in page
    assert said["ours"][0] in (tmp_path / "board/board.csv").read_text()
    write_board([ours], tmp_path / "again")
    assert "several renderers" not in (tmp_path / "again/index.html").read_text()
    (tmp_path / "all/summary.json").write_text('{"model": {}}')
    for spoilt in (tmp_path / "all", tmp_path / "absent"):
        with pytest.raises(ToolkitError, match=r"summary\.json"):
            write_board([ours], tmp_path / "bad", [spoilt])
    content = json.loads((tmp_path / "some/summary.json").read_text())
    (tmp_path / "some/summary.json").write_text(json.dumps(content | {"content_sha256": "0" * 64}))
    with pytest.raises(ToolkitError, match="was changed after the run"):
        write_board([ours], tmp_path / "bad", [tmp_path / "some"])


def test_commands(entry, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    make_up_score(entry, EVEN)
    assert runner.invoke(app, ["challenge", "check", entry.name, "--rescore"]).exit_code == 0
    done = runner.invoke(app, ["challenge", "board", entry.name, "--json"])
    assert json.loads(done.stdout)[0]["rank_gain"] == 0.5
    edit(entry, networks=[])
    bad = runner.invoke(app, ["challenge", "check", str(entry)])
    assert bad.exit_code == 1
    assert "add it to networks" in bad.stderr


def read_folder(folder):
    """Content by path."""
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


@pytest.mark.slow
def test_a_second_run_and_two_workers_give_the_same_bytes(few, tmp_path, forked_workers):
    entry = tmp_path / "ours"
    init_entry(make_workspace(tmp_path / "own"), entry, EntryConfig())
    judge, spaces = load_classifier("rig18"), [make_workspace(tmp_path / name) for name in ("one", "two")]
    found = []
    with LocalPool(2) as pool:
        for space, engine in ((spaces[0], None), (spaces[0], None), (spaces[1], pool)):
            shutil.rmtree(entry / SCORE, ignore_errors=True)
            judged = run_entry(read_entry(entry), [judge], space, engine)
            found.append(read_folder(entry / SCORE))
    assert found[0] == found[1] == found[2]
    assert sorted(found[0]) == [OUTCOMES, *(f"{PICTURES}/{name}.png" for name in FEW), SCORE_FILE]
    assert {row.variant for row in judged.score.rows} == {
        "patched", "wrong-patch", "random-patch", "grey-patch", "patch-alone"
    }  # fmt: skip
    assert rescore(entry) == []


@pytest.mark.slow
def test_entries_whose_runs_are_killed_end_with_the_same_bytes(few, tmp_path):
    """Killed while shooting, while judging and between entries, of which each has another budget or set of patches."""
    source = make_workspace(tmp_path / "source")
    configs = {"ours": EntryConfig(), "small": EntryConfig(), "whole": EntryConfig(budget="texture")}

    def prepare(name):
        space = make_workspace(tmp_path / name)
        folders = [space.root / one for one in configs]
        for folder, config in zip(folders, configs.values(), strict=True):
            if not folder.exists():
                chosen = source.with_patches("rig18" if folder.name == "small" else None)
                init_entry(chosen, folder, config)
        return space, (DRIVER, space.root, *folders)

    def count_done(space):
        home = space.eval_dir / "challenge"
        answers = home / "answers.jsonl"
        said = len(answers.read_bytes().splitlines()) if answers.exists() else 0
        return said + len(list(home.glob("*/captures/sim/*/*/*.png")))

    space, straight = prepare("straight")
    done = run(*straight, is_forked=False)
    assert done.returncode == 0, done.stderr.decode()
    wanted, most = read_folder(space.root), count_done(space)
    for share in (0.05, 0.3, 0.5, 0.8):
        space, words = prepare("killed")
        killed = Forked(*words)
        while count_done(space) < share * most and killed.process.is_alive():
            time.sleep(0.02)
        killed.process.kill()
        done = killed.wait()
        assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    done = run(*words)
    assert done.returncode == 0, done.stderr.decode()
    found = read_folder(space.root)
    for kept in ("ours/", "small/", "whole/", "board/"):
        assert {name: found[name] for name in found if name.startswith(kept)} == {
            name: wanted[name] for name in wanted if name.startswith(kept)
        }


def test_a_judge_that_was_saved_again_is_known_by_its_numbers():
    network = NetworkRecord(arch="net", weights="net.pth", sha256="ab" * 32, tensors_sha256="cd" * 32)
    record = SimpleNamespace(networks=[network])
    for tensors, seen in (("cd" * 32, True), ("0" * 64, False), (None, False)):
        judge = Judge(name="net", sha256="ef" * 32, preprocessing="", seen=False, tensors_sha256=tensors)
        assert judge.is_seen_by(record) is seen
