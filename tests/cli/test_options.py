"""Options that are made from a config: what is typed, what the help says, what an error says."""

from typing import Annotated, Literal

import pytest
import typer
from pydantic import Field
from typer.testing import CliRunner

from toolkit.cli import options
from toolkit.cli.app import make_single
from toolkit.cli.options import Only, Overrides, from_config, list_flags
from toolkit.core.config import Config, Flag, Range, Rising
from toolkit.core.errors import FieldError, ToolkitError


class Turn(Config):
    rotation_deg: Annotated[Range, Rising(-360, 360), Flag("--rotation", group="Where")] = Field(
        (-180.0, 180.0), description="Degrees."
    )
    hidden: float = 1.0


class Job(Config):
    files: Annotated[tuple[str, ...], Flag("--file")] = Field((), description="Files.")
    size_px: Annotated[int, Field(ge=8, le=224), Flag()] = Field(100, description="Side, pixels.")
    schedule: Annotated[Literal["linear", "cosine"], Flag()] = Field("cosine", description="How it falls.")
    flip: Annotated[bool, Flag()] = Field(False, description="Mirror it.")
    turn: Turn = Turn()
    pose: Annotated[Turn | None, Flag(group="Where")] = Field(None, description="As a camera sees it.")
    about: str = Field("", exclude=True)


class Crop(Config):
    side: Annotated[int, Field(ge=1), Flag(positional=True, metavar="SIDE")] = Field(description="Pixels.")


RECIPES = {"default": Job(about="ours", pose=None), "paper": Job(about="as published", size_px=32, flip=True)}


def run(command, *arguments):
    """Exit code, what the command received, its help or usage error, and the toolkit's error."""
    outcome = CliRunner().invoke(make_single(command), list(arguments), env={"COLUMNS": "100"})
    error = outcome.exception if isinstance(outcome.exception, ToolkitError) else None
    return outcome.exit_code, outcome.output, "" if error is None else str(error)


@pytest.fixture
def received():
    return {}


@pytest.fixture
def command(received):
    class Plain(Job):
        pose: None = None

    @from_config(overrides={name: Plain(**dict(one)) for name, one in RECIPES.items()})
    def work(
        overrides: Overrides,
        recipe: str,
        name: Annotated[str | None, typer.Option("--called", help="A name.")] = None,
        seed: options.Seed = 0,
    ) -> None:
        """Work."""
        received.update(overrides=overrides, recipe=recipe, name=name, seed=seed)
        if name == "bad":
            raise FieldError("expected a better one; see {size_px}", {"name": name})
        if name == "deep":
            raise FieldError("expected less", {"rotation_deg": (1.0, 2.0)})

    return work


def test_only_what_was_typed_is_an_override(command, received):
    assert run(command)[0] == 0
    assert received == {"overrides": {}, "recipe": "default", "name": None, "seed": 0}
    typed = ["--recipe", "paper", "--size-px", "9", "--rotation", "-5", "5", "--no-flip", "--file", "a", "--file", "b"]
    code, text, _ = run(command, *typed, "--seed", "3")
    assert code == 0, text
    wanted = {"size_px": 9, "turn.rotation_deg": (-5, 5), "flip": False, "files": ["a", "b"]}
    assert received == {"overrides": wanted, "recipe": "paper", "name": None, "seed": 3}


def test_the_help_takes_defaults_from_the_recipes_and_bounds_from_the_fields(command):
    _, text, _ = run(command, "--help")
    words = " ".join(text.split())
    assert "--size-px N Side, pixels. [8 to 224; default: 100; paper: 32]" in words
    assert "--schedule linear|cosine How it falls. [default: cosine]" in words
    assert "--flip / --no-flip Mirror it. [default: off; paper: on]" in words
    assert "--rotation LOW HIGH Degrees. [default: -180 180]" in words
    assert "default: ours; paper: as published" in words
    assert "hidden" not in words
    assert text.index("Options:") < text.index("Where:") < text.index("Every command:") < text.index("--seed")


@pytest.mark.parametrize(
    ("name", "message"),
    [("bad", "--called bad: expected a better one; see --size-px"), ("deep", "--rotation 1 2: expected less")],
)
def test_a_field_that_is_refused_anywhere_is_named_by_its_flag(command, name, message):
    assert run(command, "--called", name)[2] == message


def test_two_fields_with_one_flag_are_a_mistake_of_ours():
    with pytest.raises(ValueError, match=r"--rotation is the flag of turn.rotation_deg and of pose.rotation_deg"):
        from_config(job=Job)(lambda job: None)


def test_a_named_tuple_stands_for_the_options_of_its_fields(received):
    @from_config(one=Turn)
    def work(network: options.NamedNetwork, one: Turn) -> None:
        received.update(network=network)
        if network.device == "odd":
            raise FieldError("expected with {weights}", {"model": network.model})

    assert run(work, "--model", "vgg11", "--device", "cpu")[0] == 0
    assert received["network"] == options.NamedNetwork("vgg11", None, "cpu")
    assert run(work)[0] == 0 and received["network"] == options.NamedNetwork()
    assert run(work, "--model", "x", "--device", "odd")[2] == "--model x: expected with --weights"


def test_a_ready_config_and_a_positional_argument(received):
    @from_config(crop=Crop, one=Turn)
    def work(crop: Crop, one: Turn) -> None:
        received.update(crop=crop, one=one)

    code, text, _ = run(work, "7", "--rotation", "0", "5")
    assert code == 0, text
    assert received == {"crop": Crop(side=7), "one": Turn(rotation_deg=(0, 5))}
    assert run(work, "0")[2] == "SIDE 0: expected at least 1"
    assert run(work, "3", "--rotation", "5", "0")[2] == "--rotation 5 0: expected two rising numbers from -360 to 360"
    assert "Missing argument 'SIDE'" in run(work)[1]


def test_a_switch_of_a_ready_config_puts_its_part_in(received):
    class Quiet(Config):
        seen: Annotated[Turn | None, Flag("--turn")] = Field(None, description="Turn it.")

    @from_config(one=Quiet)
    def work(one: Quiet) -> None:
        received.update(one=one)

    for flags, part in (((), None), (("--turn",), Turn())):
        code, text, error = run(work, *flags)
        assert code == 0, text + error
        assert received["one"].seen == part


def test_a_part_is_a_switch():
    switch = next(flag for flag in list_flags(Job) if flag.path == "pose")
    assert switch.is_switch and switch.spelling == "--pose"


def test_of_a_recipe_a_command_may_offer_some_fields_alone(received):
    @from_config(overrides=Only({"default": Job(), "paper": Job(size_px=32)}, ("size_px",)))
    def work(overrides: Overrides, recipe: str) -> None:
        received.update(overrides=overrides, recipe=recipe)

    assert run(work, "--recipe", "paper", "--size-px", "9")[0] == 0
    assert received == {"overrides": {"size_px": 9}, "recipe": "paper"}
    assert "No such option: --schedule" in run(work, "--schedule", "linear")[1]
