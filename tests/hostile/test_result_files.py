"""Results, tables and entries of a challenge that somebody sends: read, or refused in a line."""

import json
import os
import shutil
from itertools import product

import pytest
from hostile_checks import count
from hostile_inputs import OTHER_KINDS, damaged, json_texts, names, put_in_place, tables
from hostile_space import put_result
from hypothesis import given, settings
from hypothesis import strategies as st
from test_commands import can_be_typed

from toolkit.rooms.benchmarks.challenge import CLOSED_OBJECTS
from toolkit.rooms.benchmarks.challenge.entry import read_entry
from toolkit.rooms.benchmarks.challenge.score import CONDITIONS, Judge, JudgedPicture, write_score

FEWER = settings(max_examples=settings.default.max_examples // 2)
READING = (
    ("compare", "old", "whole"), ("compare", "eval/old/predictions.csv", "eval/whole/predictions.csv"),
    ("export", "old", "--to", "csv"), ("export", "old", "--to", "parquet"), ("export", "old", "--to", "fiftyone"),
    ("export", "old", "--to", "coco"), ("runs",), ("report", "--all"), ("report", "old"),
)  # fmt: skip
PREDICTIONS, SUMMARY = ["predictions.csv"], ["summary.json"]
PAIRS = b"file,object,variant,pose,class\npose_03.jpg,crate,patched,1,crate\npose_03.png,crate,bare,1,crate\n"


@given(data=st.data())
def test_a_bad_result_is_a_line(sandbox, evaluated, data):
    space = sandbox.renew()
    put_result(space, evaluated, "whole")
    folder = put_result(space, evaluated)
    for name in data.draw(st.sampled_from((PREDICTIONS, SUMMARY, PREDICTIONS + SUMMARY))):
        whole = evaluated[name]
        content = tables(whole) if name.endswith(".csv") else json_texts(json.loads(whole))
        (folder / name).write_bytes(data.draw(content))
    if data.draw(st.integers(0, 9)) == 0:
        put_in_place(folder / name, data.draw(st.sampled_from(OTHER_KINDS)))
    count("results")
    sandbox.run(*data.draw(st.sampled_from(READING)))


@FEWER
@given(content=tables(PAIRS))
def test_a_bad_table_of_pairs_is_a_line(sandbox, content):
    space = sandbox.renew()
    (space / "pairs.csv").write_bytes(content)
    count("tables of pairs")
    sandbox.run("import", "photos", "--pairs", "pairs.csv", "--no-ask")


LABELS = st.sampled_from(("x" * 900, "x" * 100_000, "a\nb", "\x1b]0;owned\x07", "=1+1", "", " ", "<script>")) | names


@FEWER
@given(labels=st.lists(LABELS, min_size=2, max_size=2), data=st.data())
def test_odd_labels_are_shown_or_a_line(sandbox, monkeypatch_labels, labels, data):
    """A class of an object, of a network and of a patch's record, through all that shows it."""
    space = sandbox.renew()
    monkeypatch_labels(labels)
    (space / "rig/objects/crate.toml").write_text(
        f'class = {json.dumps(labels[0])}\nmesh = "crate.obj"\nlength_mm = 300\n', "utf-8", "surrogatepass"
    )
    record = space / "print/patches/crate.json"
    record.write_text(json.dumps(json.loads(record.read_text()) | {"class_name": labels[0]}))
    count("labels")
    network = ("--model", "python:hostile_space:tell_crates")
    named = labels[0] if can_be_typed(labels[0]) else "crate"
    sandbox.run(*data.draw(st.sampled_from((
        ("eval", "captures/real", *network), ("print", "--object", "crate"), ("objects",), ("coco", "captures/sim"),
        ("plan", "--object", "crate"), ("print", "--class", named),
    ))))  # fmt: skip


@pytest.fixture
def monkeypatch_labels(monkeypatch):
    """Set what the network calls its classes."""
    import hostile_space

    return lambda labels: monkeypatch.setattr(hostile_space, "LABELS", labels)


@pytest.fixture(scope="module")
def entry(sandbox, tmp_path_factory):
    """An entry with a score of made-up answers."""
    space = sandbox.renew()
    assert sandbox.run("challenge", "init", "entry") == 0, sandbox.err
    folder = shutil.copytree(space / "entry", tmp_path_factory.mktemp("entries") / "entry")
    read = read_entry(folder)
    judge = Judge(name="judge", sha256="a" * 64, preprocessing="", seen=False)
    outcomes = [
        JudgedPicture(
            judge_sha256=judge.sha256, object=item, pose=pose, variant=variant, condition=condition, corruption="",
            severity=0, picture_sha256="b" * 64, correct=pose > 1 and variant == "patched",
            delta_e=1.0 if (condition, variant) == ("clear", "patched") else None,
        )
        for condition, item, pose, variant in product(CONDITIONS, CLOSED_OBJECTS, (1, 2), ("unpatched", "patched"))
    ]  # fmt: skip
    write_score(read, [judge], outcomes)
    return folder


FILES = ("entry.json", "boosters/racer.json", "score/score.json", "score/outcomes.csv", "boosters/racer.png")
PLACES = (
    "evil.py",
    "boosters/evil.py",
    "boosters/racer/wrap.json",
    "score/page/x.html",
    "objects/racer.toml",
)


@given(data=st.data())
def test_a_bad_entry_is_lines(sandbox, entry, data):
    folder = sandbox.renew() / "entry"
    shutil.copytree(entry, folder)
    file = folder / data.draw(st.sampled_from(FILES))
    whole = file.read_bytes()
    if data.draw(st.integers(0, 3)):
        bad = json_texts(json.loads(whole)) if file.suffix == ".json" else damaged(whole)
        file.write_bytes(data.draw(tables(whole) if file.suffix == ".csv" else bad))
    else:
        put_in_place(file, data.draw(st.sampled_from(OTHER_KINDS)))
    more = data.draw(st.none() | st.sampled_from(PLACES))
    if more is not None:
        place = folder / more
        place.parent.mkdir(parents=True, exist_ok=True)
        put_in_place(place, data.draw(st.sampled_from(OTHER_KINDS)))
    count("entries")
    before = os.listdir(folder)  # noqa: PTH208
    words = data.draw(st.sampled_from((("check", "entry"), ("check", "entry", "--rescore"), ("board", "entry"))))
    code = sandbox.run("challenge", *words)
    assert sorted(before) == sorted(os.listdir(folder))  # noqa: PTH208
    lines = sandbox.err.splitlines()
    assert code == 0 or 0 < len(lines) < 60, lines
    assert code != 0 or more is None or words[0] == "board", f"{more} is no fault: {sandbox.out}"
