"""What tests of training share: the views of one object in one setting are rendered once."""

import hashlib

import pytest


@pytest.fixture(scope="session")
def rendered_views():
    return {}


@pytest.fixture(autouse=True)
def shared_views(rendered_views, monkeypatch):
    """Runs in this process take a block of views from an earlier run of the same object, settings, seed and number.

    A block is a function of these alone, which tests/rig/test_view_stream.py asks.
    """
    from toolkit.objects.mesh import hash_mesh
    from toolkit.rig import views

    render = views.render_block

    def render_once(subjects, settings, seed, kind, block, **where):
        if where["with_depth"] or where["setting"] is not views.IN_STUDIO or where["renderer"] != views.RAYCAST:
            return render(subjects, settings, seed, kind, block, **where)
        if any(type(one) is not views.PaintableObject for one in subjects):  # looks another way in each block
            return render(subjects, settings, seed, kind, block, **where)
        parts = [(hash_mesh(one.mesh), one.material, hash_mesh(one.bare)) for one in subjects]
        key = hashlib.sha256(repr((parts, settings, seed, kind, block)).encode()).digest()
        if key not in rendered_views:
            rendered_views[key] = render(subjects, settings, seed, kind, block, **where)
        return rendered_views[key]

    monkeypatch.setattr(views, "render_block", render_once)
