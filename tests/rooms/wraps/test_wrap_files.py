"""The folder of a wrap: what is written is read again, and what was changed is told in one line."""

import json
from pathlib import Path

import numpy as np
import pytest
from test_wrap_pieces import box

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import make_workspace
from toolkit.objects.load import BUILTIN, TableObject, load_object
from toolkit.objects.mesh import place_on_table
from toolkit.objects.records import pack_arrays
from toolkit.objects.spec import ObjectSpec
from toolkit.rooms.wraps.config import WrapConfig
from toolkit.rooms.wraps.wrap import Wrap, find_wrap, lay_out, read_wrap, texel_box, write_wrap
from toolkit.rooms.wraps.wrap_plan import plan_wrap


@pytest.fixture(scope="module")
def item() -> TableObject:
    spec = ObjectSpec(name="carton", **{"class": "carton"}, mesh="carton.glb", length_mm=60)
    return TableObject(spec, place_on_table(box(60, 40, 30)))


@pytest.fixture(scope="module")
def wrap(item: TableObject) -> Wrap:
    return plan_wrap(item, WrapConfig(views=8, texel_mm=0.5))


def test_what_is_written_is_read_again(item: TableObject, wrap: Wrap, tmp_path: Path) -> None:
    space = make_workspace(tmp_path)
    written = write_wrap(space.wraps_dir / "carton", wrap)
    found = find_wrap(space, item)
    assert found.record == written.record and found.pixels is not None
    assert np.array_equal(found.pixels, written.pixels)
    for one, other in zip(found.pieces, wrap.pieces, strict=True):
        assert np.array_equal(one.faces, other.faces) and np.array_equal(one.flat_mm, other.flat_mm)
    assert found.record.covered == 1  # the top and the four sides, all that is seen
    again = write_wrap(tmp_path / "again", wrap)
    assert again.record == written.record  # nothing of the day is in the files
    assert space.wrap("carton") == space.wraps_dir / "carton"


def test_the_canvas_keeps_sizes_and_pieces_apart(item: TableObject, wrap: Wrap) -> None:
    record = wrap.record
    uv = wrap.corner_uv(len(item.mesh.faces))
    for piece, at in zip(wrap.pieces, record.pieces, strict=True):
        lying = (uv[piece.faces] * record.n_px - at.origin_px) * record.texel_mm
        assert lying == pytest.approx(piece.flat_mm, abs=1e-3)
    assert np.isnan(uv[np.setdiff1d(np.arange(len(uv)), np.concatenate([p.faces for p in wrap.pieces]))]).all()
    sizes = [(31.0, 10.0), (12.0, 60.0), (12.5, 12.0), (40.0, 40.0)]
    side, origins = lay_out(sizes, 1.0)
    used = np.zeros((side, side), int)
    for size, (column, row) in zip(sizes, origins, strict=True):
        wide, high = texel_box(size, 1.0)
        used[row - 2 : row - 2 + high, column - 2 : column - 2 + wide] += 1
    assert used.max() == 1 and used.sum() == sum(np.prod(texel_box(size, 1.0)) for size in sizes)
    with pytest.raises(FieldError, match="canvas of more than 1024"):
        lay_out([(3000.0, 10.0)], 1.0)


def test_a_shipped_wrap_counts_where_it_fits_alone(item: TableObject, wrap: Wrap, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("toolkit.core.workspace.PACKAGE_DATA", tmp_path / "data")
    monkeypatch.setattr("toolkit.rooms.wraps.wrap.PACKAGE_DATA", tmp_path / "data")
    space = make_workspace(tmp_path / "space")
    shipped = write_wrap(tmp_path / "data" / "wraps" / "carton", wrap)
    assert find_wrap(space, item).record == shipped.record
    # the user's own object may have the name of a shipped one
    other = TableObject(item.spec, place_on_table(box(60, 40, 31)))
    with pytest.raises(ToolkitError, match="no wrap is for 'carton'"):
        find_wrap(space, other)
    write_wrap(space.wraps_dir / "carton", wrap)
    assert space.wrap("carton") == space.wraps_dir / "carton"


def test_a_copy_made_to_be_shipped_is_the_same_wrap_in_less_room(
    item: TableObject, wrap: Wrap, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parents[3] / "docs" / "scripts")
    from ship_wraps import ship_wrap

    written = write_wrap(tmp_path / "own", wrap)
    size = ship_wrap(tmp_path / "own", tmp_path / "shipped", item)
    assert size < 0.7 * sum(file.stat().st_size for file in (tmp_path / "own").iterdir())
    shipped = read_wrap(tmp_path / "shipped")
    assert np.array_equal(shipped.pixels, written.pixels)
    assert shipped.record == written.record.model_copy(update={"map_sha256": shipped.record.map_sha256})
    for one, other in zip(shipped.pieces, wrap.pieces, strict=True):
        assert np.array_equal(one.faces, other.faces) and one.flat_mm == pytest.approx(other.flat_mm, abs=2e-5)


@pytest.mark.parametrize("name", BUILTIN)
def test_a_trained_wrap_of_each_object_comes_with_the_kit(name: str, tmp_path: Path) -> None:
    space = make_workspace(tmp_path)
    shipped = find_wrap(space, load_object(space.object_spec(name)))
    assert shipped.record.booster is not None and len(shipped.record.booster.networks) == 4
    assert np.ptp(shipped.pixels) > 0.5


def test_another_mesh_is_told(item: TableObject, wrap: Wrap, tmp_path: Path) -> None:
    space = make_workspace(tmp_path)
    write_wrap(space.wraps_dir / "carton", wrap)
    with pytest.raises(ToolkitError, match="another mesh or size"):
        find_wrap(space, TableObject(item.spec, place_on_table(box(60, 40, 31))))
    with pytest.raises(ToolkitError, match="no wrap is for 'mug'"):
        find_wrap(
            space, TableObject(ObjectSpec(name="mug", **{"class": "mug"}, mesh="mug.glb", length_mm=60), item.mesh)
        )


@pytest.mark.parametrize(
    "change, said",
    [
        (lambda arrays: {"faces": arrays["faces"]}, "no readable map of pieces"),
        (lambda arrays: arrays | {"piece": arrays["piece"] + 1}, "its pieces are not the"),
        (lambda arrays: arrays | {"faces": arrays["faces"] * 0}, "on two pieces"),
        (lambda arrays: arrays | {"faces": -1 - arrays["faces"]}, "negative"),
        (lambda arrays: arrays | {"flat_mm": arrays["flat_mm"] * np.nan}, "NaN"),
        (lambda arrays: arrays | {"flat_mm": arrays["flat_mm"] * 2}, "in its record"),
        (lambda arrays: arrays | {"flat_mm": arrays["flat_mm"][:1]}, "of shape"),
    ],
)
def test_a_map_of_other_pieces_is_told(change, said: str, wrap: Wrap, tmp_path: Path) -> None:
    write_wrap(tmp_path, wrap)
    with np.load(tmp_path / "pieces.npz") as given:
        content = pack_arrays(change(dict(given)))
    (tmp_path / "pieces.npz").write_bytes(content)
    record = json.loads((tmp_path / "wrap.json").read_text())
    (tmp_path / "wrap.json").write_text(json.dumps(record | {"map_sha256": sha256_bytes(content)}))
    with pytest.raises(ToolkitError, match=said) as error:
        read_wrap(tmp_path)
    assert "\n" not in str(error.value)


def test_changed_files_are_told(wrap: Wrap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_wrap(tmp_path, wrap)
    monkeypatch.setattr("toolkit.objects.records.MAX_ARRAY_BYTES", 100)
    with pytest.raises(ToolkitError, match="unpacks to"):
        read_wrap(tmp_path)
    monkeypatch.undo()
    (tmp_path / "01.png").write_bytes(b"no picture")
    with pytest.raises(ToolkitError, match="does not match"):
        read_wrap(tmp_path)
    (tmp_path / "pieces.npz").write_bytes(b"no map")
    with pytest.raises(ToolkitError, match="does not match"):
        read_wrap(tmp_path)
    record = json.loads((tmp_path / "wrap.json").read_text())
    record["pieces"][0]["origin_px"] = [5000, 0]
    (tmp_path / "wrap.json").write_text(json.dumps(record))
    with pytest.raises(ToolkitError, match="leaves the canvas"):
        read_wrap(tmp_path)
    (tmp_path / "wrap.json").unlink()
    with pytest.raises(ToolkitError, match="is no wrap"):
        read_wrap(tmp_path)
