"""Does a sheet lie on its place, and is it in the frame? Against shapes whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from box_object import as_object
from typer.testing import CliRunner

from toolkit.cli.app import make_single
from toolkit.cli.print_ import print_patches
from toolkit.cli.rig import capture_sim, plan
from toolkit.core.workspace import Workspace
from toolkit.objects.load import load_object
from toolkit.objects.spec import PatchMount
from toolkit.rig import Pattern
from toolkit.rig.camera import Camera, pixel_rays
from toolkit.rig.fit import describe_misfit, measure_fit, sheet_points
from toolkit.rig.plan import list_misfits, make_plan, plan_poses, seen_share, write_plan


def test_on_a_flat_top_all_of_it_lies(make_box):
    fit = measure_fit(as_object(make_box((200.0, 160.0, 40.0))), 60)
    assert (fit.floating, fit.loose, fit.overhang) == (0, 0, 0) and fit.lies
    assert fit.bend_deg < 1 and fit.relief_mm < 0.1
    assert np.ptp(fit.points_mm, axis=0) == pytest.approx([70, 70, 0], abs=0.5)


def test_what_hangs_over_an_edge_has_nothing_below(make_box):
    """A sheet of 60 + 10 mm, its middle 20 mm from the edge of a box 200 mm deep: 15 mm of 70 stand out."""
    fit = measure_fit(as_object(make_box((200.0, 160.0, 40.0)), offset_mm=(80, 0)), 60)
    assert fit.overhang == pytest.approx(15 / 70, abs=0.04)


def test_a_stick_is_no_place_and_its_left_is_one(make_box):
    """20 mm wide, 60 mm deep on top, but 120 mm high and 60 mm wide as seen from its left."""
    stick = as_object(make_box((60.0, 20.0, 120.0)))
    fit = measure_fit(stick, 50)
    assert not fit.lies and fit.overhang > 0.4
    assert "'toolkit place --object box' shows where one fits" in describe_misfit(stick, 50)
    assert describe_misfit(replace(stick, spec=stick.spec.with_mounts([PatchMount(at="left")])), 50) is None


def test_a_patch_over_half_of_the_object_is_told(make_box):
    line = describe_misfit(as_object(make_box((100.0, 90.0, 40.0))), 88)
    assert "over half of the object's longest side" in line


def test_the_shipped_objects_wear_their_sheets_and_are_framed_as_before(tmp_path):
    space = Workspace(tmp_path)
    (line,) = list_misfits(space, ["racer", "warplane", "coffeepot", "eggnog"])
    assert line.startswith("coffeepot: a patch of 88 mm does not fit flat on its top"), (
        "over the lid's rim: said as of all"
    )
    eggnog = load_object(space.object_spec("eggnog"))
    assert sheet_points(space, eggnog) is None
    assert measure_fit(eggnog, 88.2).lies  # round the wall of a carton


def test_sheet_and_object_are_framed_together(make_box):
    """A sheet that stands 35 mm out of a small box at its side."""
    item, camera = as_object(make_box((60.0, 60.0, 60.0)), offset_mm=(30, 0)), Camera.from_fov()
    points = measure_fit(item, 28).points_mm + np.array([25.0, 0, 0])
    pattern = Pattern(fill=0.9)
    bare, both = plan_poses(item, camera, pattern), plan_poses(item, camera, pattern, points)
    assert min(seen_share(points, camera, pose) for pose in bare) < 0.95
    assert [seen_share(points, camera, pose) for pose in both] == [1.0] * len(both)
    assert plan_poses(item, camera, pattern, points * 0.1) == bare  # a sheet within the object changes nothing


def test_the_frame_holds_what_falls_on_its_first_and_last_pixel(make_box):
    camera = Camera.from_fov(64, 48, 60)
    pose = plan_poses(as_object(make_box()), camera, Pattern(fill=0.9))[0]
    rays = pixel_rays(camera, pose.matrix(), np.array([(0.4, 0.4), (63.6, 47.6), (-0.4, 20), (64.4, 20)]))
    points = rays[:, :3] + 300 * rays[:, 3:]
    assert [seen_share(np.array([point]), camera, pose) for point in points] == [1, 1, 0, 0]


def test_the_commands_say_so(tmp_path, make_crate_space, monkeypatch):
    space = make_crate_space(tmp_path)
    monkeypatch.chdir(tmp_path)
    spec = space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text() + "offset_mm = [45, 0]\n")
    item = load_object(space.object_spec("crate"))

    def said(command, *arguments) -> str:
        result = CliRunner().invoke(make_single(command), list(arguments))
        assert result.exit_code == 0, result.output
        return " ".join(result.output.split())

    expected = "crate: a patch of 40 mm does not fit flat on its top"
    assert expected in said(print_patches, "--object", "crate")
    assert expected in said(plan, "--object", "crate", "--fill", "0.95", "--resolution", "96", "72")
    write_plan(space.plan_file, make_plan([item], Camera.from_fov(96, 72), Pattern(count=2, fill=0.95)))
    captured = said(capture_sim, "--object", "crate", "--quiet")
    assert expected in captured and "the sheet leaves the frame in" in captured
    assert "'toolkit plan --object crate' frames object and sheet together" in captured
    assert expected not in said(capture_sim, "--object", "crate", "--variant", "unpatched", "--quiet")


def test_places_on_a_mesh_of_very_many_faces_are_found_by_rays(make_box, monkeypatch):
    """No look at every face for each of hundreds of places, and the same verdict."""
    from toolkit.objects.mesh import make_ray_scene
    from toolkit.rig import fit

    item = as_object(make_box((200.0, 160.0, 40.0)))
    by_faces = fit.measure_fit(item, 60.0)
    monkeypatch.setattr(fit, "MANY_FACES", 1)
    monkeypatch.setattr(fit, "survey_heights", None)
    by_rays = fit.measure_fit(item, 60.0, scene=make_ray_scene(item.mesh))
    assert by_rays.lies and by_faces.lies
    np.testing.assert_allclose(by_rays.points_mm, by_faces.points_mm, atol=0.05)


def test_heights_are_those_that_rays_find(tmp_path, make_box):
    """Against Open3D's rays, over the racer's cockpit and wings, tilted; and what a box hides below is not seen."""
    from toolkit.objects.mesh import make_ray_scene
    from toolkit.rig.fit import survey_heights
    from toolkit.rig.mount import cast_heights

    racer = load_object(Workspace(tmp_path).object_spec("racer"))
    for mesh in (racer.mesh, make_box()):
        tilt = np.radians(20)
        T = np.eye(4)
        T[:3, :3] = [[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]]
        T[:3, 3] = [10, 5, 50]
        found, cast = survey_heights(mesh, T, 90.0), cast_heights(make_ray_scene(mesh), T, 90.0)
        both = np.isfinite(found) & np.isfinite(cast)
        assert (np.isfinite(found) == np.isfinite(cast)).mean() > 0.99 and both.any()
        assert np.quantile(np.abs(found[both] - cast[both]), 0.99) < 0.01
