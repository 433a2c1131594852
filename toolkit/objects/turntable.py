"""An object to turn with the mouse or a finger: one HTML page with the GLB and three.js in it, without a network."""

from dataclasses import replace
from html import escape
from io import BytesIO

from toolkit.objects.export import to_glb
from toolkit.objects.mesh import Mesh

MOST_TRIANGLES = 400_000
"""Of a page that a phone opens."""
LIGHTS = (
    "scene.background=new THREE.Color(0xe9ebee);scene.add(new THREE.HemisphereLight(0xffffff,0x9a948c,0.55));"
    "tracklight.intensity*=0.25;"
    "renderer.outputEncoding=THREE.sRGBEncoding;addEventListener('pointerdown',()=>{turning=false});"
)
CAPTION = """<p style="position:fixed;left:0;right:0;bottom:0;margin:0;padding:10px 14px;
font:15px/1.4 system-ui,sans-serif;background:#fffc;color:#1b1f24">{words}</p>"""


def make_turntable(mesh: Mesh, title: str, words: str) -> str | None:
    """A page that shows a mesh turning until it is touched, then as it is dragged; None for a mesh too large for it.

    The viewer is the one that trimesh brings along, three.js inlined.

    Args:
        mesh: on the table; its front comes first.
        title, words: of the page, and below the picture.
    """
    if len(mesh.faces) > MOST_TRIANGLES:
        return None
    import trimesh
    from trimesh.viewer.notebook import scene_to_html

    # metal shows what is round it, and here is nothing
    dull = tuple(replace(one, metallic=0.0, roughness=max(one.roughness, 0.6)) for one in mesh.materials)
    scene = trimesh.load_scene(BytesIO(to_glb(replace(mesh, materials=dull), title)), file_type="glb")
    page = scene_to_html(scene)
    for old, new in (
        ("loader=new THREE.GLTFLoader();", f"{LIGHTS}loader=new THREE.GLTFLoader();"),
        ("camera=gltf.cameras[0];", "camera=gltf.cameras[0];upright=camera.fov;"),
        (
            "camera.updateProjectionMatrix();",
            "camera.fov=Math.min(110,1.6*upright*Math.max(1,1/camera.aspect));camera.updateProjectionMatrix();",
        ),
        ("scene.add(gltf.scene);", "turned=gltf.scene;scene.add(turned);"),
        ("controls.update();}", "controls.update();if(turning&&turned){turned.rotation.y+=0.008;render();}}"),
        (
            "init();</script>",
            f"var turning=true,turned=null,upright=60;init();</script>{CAPTION.format(words=escape(words))}",
        ),
    ):
        page = page.replace(old, new, 1)
    start, end = page.find("<title>"), page.find("</title>")
    return f"{page[:start]}<title>{escape(title)}{page[end:]}" if 0 <= start < end else page
