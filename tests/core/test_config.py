"""A config's validation, overrides, record, hash and description."""

import json
from dataclasses import dataclass
from typing import Annotated, Literal

import pytest
from pydantic import Field, model_validator

from toolkit.core.config import (
    Config,
    Expect,
    Flag,
    Joined,
    Later,
    Range,
    Rising,
    align_rows,
    bounds_of,
    describe,
    describe_changes,
)
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import sha256_json


class Turn(Config):
    rotation_deg: Annotated[Range, Rising(-360, 360), Flag("--rotation")] = (-180.0, 180.0)
    length_mm: Annotated[float, Field(gt=0)] = 270.0
    probability: float = 0.5
    most_mm: Annotated[float | None, Later] = None


@dataclass(frozen=True)
class Blur:
    sigma_px: float = 1.0


class Job(Config):
    """A small config with one of each kind of field."""

    size_px: Annotated[int, Field(ge=8, le=224)] = 100
    lr: Annotated[float, Field(gt=0, le=1), Expect("a number above 0 and at most 1")] = 0.1
    schedule: Literal["constant", "linear", "cosine"] = "cosine"
    turn: Turn = Turn()
    pose: Annotated[Turn | None, Flag()] = None
    blur: Blur | None = None
    note: str = Field("", exclude=True)
    added: Annotated[int, Later] = 0
    limit_mm: Annotated[float | None, Later] = None

    @model_validator(mode="after")
    def _check(self) -> "Job":
        if self.schedule == "linear" and self.lr > 0.5:
            raise FieldError("expected at most 0.5 with a linear {schedule}", {"lr": self.lr})
        return self


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"size_px": 4}, "size_px 4: expected 8 to 224"),
        ({"size_px": 4.5}, "size_px 4.5: expected 8 to 224"),
        ({"size_px": "many"}, "size_px many: expected a whole number, 8 to 224"),
        ({"lr": 2.0}, "lr 2: expected a number above 0 and at most 1"),
        ({"lr": float("nan")}, "lr nan: expected a number above 0 and at most 1"),
        ({"schedule": "cosin"}, "schedule cosin: expected constant, linear or cosine; did you mean cosine?"),
        ({"schedule": "linear", "lr": 0.6}, "lr 0.6: expected at most 0.5 with a linear schedule"),
        ({"turn": {"rotation_deg": (5, -5)}}, "turn.rotation_deg 5 -5: expected two rising numbers from -360 to 360"),
        ({"turn": {"rotation_deg": (5, "x")}}, "turn.rotation_deg 5 x: expected two rising numbers from -360 to 360"),
        ({"pose": {"length_mm": 0}}, "pose.length_mm 0: expected above 0"),
    ],
)
def test_an_error_names_the_field_what_came_and_what_was_expected(values, message):
    with pytest.raises(FieldError) as caught:
        Job(**values)
    assert str(caught.value) == message
    assert "\n" not in message


def test_an_error_knows_its_field_and_can_be_spelled_otherwise():
    with pytest.raises(FieldError) as caught:
        Job(schedule="linear", lr=0.6)
    assert caught.value.found == {"lr": 0.6}
    assert caught.value.spell(lambda path: f"--{path}") == "--lr 0.6: expected at most 0.5 with a linear --schedule"


def test_a_name_in_a_value_is_no_field():
    assert str(FieldError("expected a file", {"name": "{lr}"})) == "name {lr}: expected a file"


def test_a_mistyped_field_is_answered_by_the_nearest():
    with pytest.raises(ToolkitError, match="no setting called 'sizepx': did you mean size_px"):
        Job(sizepx=3)
    with pytest.raises(ToolkitError, match="no setting called 'rotation': did you mean rotation_deg"):
        Job().with_overrides({"turn.rotation": (0, 1)})


def test_a_missing_field_is_named():
    class Needs(Config):
        name: str

    with pytest.raises(FieldError, match=r"^name: expected text; it has no default$"):
        Needs()


def test_it_is_frozen():
    with pytest.raises(Exception, match="frozen"):
        Job().size_px = 9


def test_overrides_change_what_they_name_and_leave_the_rest():
    changed = Job(lr=0.3).with_overrides({"turn.rotation_deg": (0.0, 5.0)}, schedule="constant")
    assert changed == Job(lr=0.3, schedule="constant", turn=Turn(rotation_deg=(0.0, 5.0)))


def test_none_clears_a_field_and_is_refused_where_a_value_is_needed():
    assert Job(limit_mm=3.0, pose=Turn()).with_overrides({"limit_mm": None, "pose": None}) == Job()
    assert Job(turn=Turn(most_mm=3.0)).with_overrides({"turn.most_mm": None}) == Job()
    with pytest.raises(FieldError, match=r"^size_px None: expected 8 to 224$"):
        Job().with_overrides(size_px=None)


def test_a_part_is_switched_on_kept_and_taken_away():
    own = Turn(length_mm=90.0)
    assert Job().with_overrides(pose=True).pose == Turn()
    assert Job(pose=own).with_overrides(pose=True).pose == own
    assert Job(pose=own).with_overrides(pose=False).pose is None
    assert Job().with_overrides({"pose": True, "pose.length_mm": 5.0}).pose == Turn(length_mm=5.0)
    assert Job().with_overrides({"blur": True, "blur.sigma_px": 2.0}).blur == Blur(2.0)


def test_a_setting_of_a_part_that_is_off_is_refused():
    with pytest.raises(FieldError, match=r"pose.length_mm 5: expected together with pose, which is off"):
        Job().with_overrides({"pose.length_mm": 5.0})


def test_an_override_of_a_part_is_validated_under_its_whole_path():
    with pytest.raises(FieldError, match=r"^turn.length_mm -1: expected above 0$"):
        Job().with_overrides({"turn.length_mm": -1.0})


def test_the_record_comes_back_as_the_same_config():
    job = Job(pose=Turn(rotation_deg=(0, 5)), blur=Blur(2.0), added=3)
    assert Job(**json.loads(json.dumps(job.record()))) == job


def test_the_record_leaves_later_fields_out():
    held = {
        "schedule": "cosine", "size_px": 100, "lr": 0.1, "pose": None, "blur": None,
        "turn": {"rotation_deg": [-180.0, 180.0], "length_mm": 270.0, "probability": 0.5},
    }  # fmt: skip
    assert Job().record() == Job(note="kept apart").record() == held
    hashes = {
        sha256_json(Job(**values).record())
        for values in ({}, {"added": 1}, {"lr": 0.2}, {"turn": Turn(probability=0.4)})
    }
    assert len(hashes) == 4


def test_the_same_number_has_the_same_hash_however_it_is_written():
    assert sha256_json(Job(lr=1).record()) == sha256_json(Job(lr=1.0).record())
    whole, parts = (Turn(rotation_deg=(low, high)).record() for low, high in ((0, 5), (0.0, 5.0)))
    assert sha256_json(whole) == sha256_json(parts)


class Drop(Config):
    fastest_m_s: float = 1.5
    wait_s: float = 2.0


def test_rows_have_units_and_leave_out_what_does_not_act():
    rows = dict(Job(pose=Turn()).rows())
    assert rows["turn"] == "rotation -180 to 180°, length 270 mm, probability 0.5"
    assert rows["size px"] == "100 px" and "blur" not in rows
    assert describe(Drop()) == "fastest 1.5 m/s, wait 2 s"
    lines = align_rows(list(rows.items()))
    assert len({len(line) - len(line[2:].partition("  ")[2].lstrip()) for line in lines}) == 1


def test_a_pair_that_is_no_range_does_not_read_as_one():
    class Sheet(Config):
        sheet_mm: Annotated[Range, Joined(" × ")] = (177.0, 241.0)
        at_m: Annotated[tuple[float, float] | None, Joined(", ")] = None

    class Page(Config):
        sheet: Sheet = Sheet()

    assert Sheet(at_m=(3, 4.5)).rows() == [("sheet mm", "177 × 241 mm"), ("at m", "3, 4.5 m")]
    assert dict(Page().rows())["sheet"].startswith("sheet 177 × 241 mm")


def test_bounds_in_words():
    class Bounds(Config):
        a: Annotated[int, Field(ge=8, le=224)] = 8
        b: Annotated[int, Field(ge=2)] = 2
        c: Annotated[float, Field(gt=0, lt=1)] = 0.5
        d: float = 0.0
        e: Annotated[int, Field(ge=2, le=10_000_000)] = 2

    assert [bounds_of(info) for info in Bounds.model_fields.values()] == [
        "8 to 224", "at least 2", "above 0 and below 1", "", "2 to 10000000"
    ]  # fmt: skip


def test_help_says_what_each_field_means_and_nothing_of_pydantic():
    import pydoc

    from toolkit.evaluation import EvalConfig

    said = pydoc.render_doc(EvalConfig, renderer=pydoc.plaintext)
    assert len(said) < 4000 and "model_dump" not in said and "validator" not in said.lower()
    assert "replace=False" in said and "with_overrides" in said
    for name, info in EvalConfig.model_fields.items():
        assert f"{name}: {info.description}" in said


def test_changes_of_a_recipe_name_what_differs():
    class Part(Config):
        strength: float = 1.0

    class Recipe(Config):
        evenly: bool = False
        part: Part | None = None
        size_px: int = 8

    assert describe_changes(Recipe(), {"evenly": False, "part": False, "size_px": 8}) == ""
    assert describe_changes(Recipe(), {"evenly": True, "part": True, "size_px": 9}) == "evenly on, part on, size 9 px"
    assert describe_changes(Recipe(evenly=True, part=Part()), {"evenly": False, "part": True}) == "evenly off"
