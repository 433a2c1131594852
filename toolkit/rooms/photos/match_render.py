"""Which pose of the plan a photograph shows, where there is no board: the render that it looks most like.

Each pose is rendered once, small. A photograph is compared with all of them in every place and at every size. The
comparison uses the directions of its edges (histograms of oriented gradients: Dalal and Triggs, 2005) and differences
of colour between places. Neither depends on the brightness or tint of the light.

The rig's pictures of the four built-in objects differ from the templates in light, table, lens, and by a few degrees.
The correct pose comes first in 262 of 288. 189 are called unambiguous; 1 of these is wrong. The thresholds were set on
half of these pictures. Photographs of real objects are harder: the mesh is not exact.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.plan import Pose
from toolkit.rig.renderers import RAYCAST, make_renderer
from toolkit.rig.shading import tone_map
from toolkit.rig.studio import make_studio

CELL_PX = 8
BINS = 9
OBJECT_CELLS = 20
"""The object's longer side in the picture, in cells."""
WINDOW_CELLS = OBJECT_CELLS + 2
SHARES = tuple(float(share) for share in 1.08 * 0.87 ** np.arange(10))
"""Sizes at which the object is looked for: its longer side as a share of the photograph's shorter side."""
COLOUR_WEIGHT = 0.5
"""Weight of colour against edges for an object as colourful as `COLOURFUL`; paler objects get less."""
COLOURFUL = 0.12
LEAST_SCORE = 0.3
LEAST_MARGIN = 0.05
"""Below this margin, or score, the pose is not known. The margin matters more: an empty table, or another object, may
score 0.6 with every pose alike."""
RENDER_SIDE_PX = 260
ROUGH = BakeDetail(key_rays=6, room_rays=32, surface_spacing=0.04, table_spacing=0.06)


@dataclass(frozen=True)
class RenderMatch:
    """How much a photograph looks like each pose.

    Attributes:
        ranking: (pose id, score) of all poses, the best first; a score is 1 for equal pictures, about 0 for unrelated.
    """

    ranking: tuple[tuple[int, float], ...]

    @property
    def pose_id(self) -> int:
        """The pose that it looks most like."""
        return self.ranking[0][0]

    @property
    def score(self) -> float:
        """Score of that pose."""
        return self.ranking[0][1]

    @property
    def runner_up(self) -> int | None:
        """The next pose; None in a plan with a single pose."""
        return self.ranking[1][0] if len(self.ranking) > 1 else None

    @property
    def margin(self) -> float:
        """How much better the best is than the next."""
        return self.score - self.ranking[1][1] if len(self.ranking) > 1 else float("inf")

    @property
    def ambiguous(self) -> bool:
        """Whether the next pose is about as like, or none is like the photograph at all."""
        return self.margin < LEAST_MARGIN or self.score < LEAST_SCORE


@dataclass(frozen=True)
class PoseTemplates:
    """Renders of every pose as `match_by_render` compares them.

    Attributes:
        edges, edge_masks: (n, k) features of unit length, 0 outside the object, and where they count.
        colours, colour_masks: the same for colour.
        colour_weight: of colour against edges.
    """

    ids: tuple[int, ...]
    edges: np.ndarray
    edge_masks: np.ndarray
    colours: np.ndarray
    colour_masks: np.ndarray
    colour_weight: float


def make_templates(mesh: Mesh, camera: Camera, poses: Sequence[Pose]) -> PoseTemplates:
    """Render poses of a plan, a fraction of a second each, for any number of photographs; `mesh` is in world mm."""
    if not poses:
        raise ToolkitError("no poses to match with: make a plan with 'toolkit plan'")
    # small renders: cells of gradients and colours are all that is compared
    share = RENDER_SIDE_PX / min(camera.width, camera.height)
    small = camera.scaled(round(camera.width * share), round(camera.height * share))
    renderer = make_renderer(RAYCAST, mesh, make_studio(0, float(mesh.size_mm.max()), "concrete"), ROUGH)
    edges, edge_masks, colours, colour_masks, spread = [], [], [], [], []
    lights = renderer.render_many((small, pose.matrix()) for pose in poses)
    for pose, light in zip(poses, lights, strict=True):
        picture = tone_map(light, (0, pose.id), noise=0)
        covered = renderer.buffers(small, pose.matrix())["material"] >= 0
        crop, inside = _crop_window(picture, covered)
        edge_map, colour_map = _edge_cells(crop), _colour_cells(crop)
        area = cv2.resize(inside.astype(np.float32), (WINDOW_CELLS, WINDOW_CELLS), interpolation=cv2.INTER_AREA)
        # the outline's own edges lie in the cells round it
        near = (cv2.dilate(area, np.ones((3, 3))) > 0.2).astype(np.float32)
        solid = (area > 0.75).astype(np.float32)
        edges.append(_normalise(edge_map, near))
        edge_masks.append(np.repeat(near.reshape(-1), BINS))
        colours.append(_normalise(colour_map, solid, centre=True))
        colour_masks.append(solid.reshape(-1))
        spread.append(colour_map[solid > 0].std(axis=0).max() if solid.any() else 0.0)
    # colours of an object of a single colour do not tell poses apart
    weight = COLOUR_WEIGHT * min(1.0, float(np.mean(spread)) / COLOURFUL)
    lines, line_masks, paint, paint_masks = (
        np.stack(parts).astype(np.float32) for parts in (edges, edge_masks, colours, colour_masks)
    )
    return PoseTemplates(tuple(pose.id for pose in poses), lines, line_masks, paint, paint_masks, weight)


def match_by_render(image: np.ndarray, templates: PoseTemplates) -> RenderMatch:
    """Rank the poses by how much a photograph (h, w, 3) uint8 sRGB, upright, looks like each."""
    (best,) = _score(image, [templates])
    order = np.argsort(-best, kind="stable")
    return RenderMatch(tuple((templates.ids[i], float(best[i])) for i in order))


def match_objects(image: np.ndarray, templates: Mapping[str, PoseTemplates]) -> dict[str, float]:
    """How much a photograph looks like each object, by name: the score of the pose that it looks most like."""
    found = _score(image, list(templates.values()))
    return {name: float(best.max()) for name, best in zip(templates, found, strict=True)}


def _score(image: np.ndarray, templates: Sequence[PoseTemplates]) -> list[np.ndarray]:
    """Return for each object (poses,) the score of the window that looks most like the pose."""
    best = [np.full(len(template.ids), -1.0) for template in templates]
    for edges, colours in _windows(image):
        # with the squares, a matrix product gives the energy of each window within each mask
        squares = edges**2
        for k, compared in enumerate(templates):
            score = edges @ compared.edges.T
            # a cosine: a window of strong edges is no more alike for that
            score /= np.sqrt(np.maximum(squares @ compared.edge_masks.T, 1e-6))
            if compared.colour_weight > 0:
                score = score + compared.colour_weight * _compare_colours(colours, compared)
                score /= 1 + compared.colour_weight
            best[k] = np.maximum(best[k], score.max(axis=0))
    return best


def _windows(image: np.ndarray) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Per size, edges (n, k) and colours (n, cells, 2) of every window of the photograph."""
    for share in SHARES:
        scale = OBJECT_CELLS * CELL_PX / share / min(image.shape[:2])
        size = tuple(max(1, round(side * scale / CELL_PX)) * CELL_PX for side in image.shape[1::-1])
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        rim = max(WINDOW_CELLS // 4, -(-(WINDOW_CELLS - min(size) // CELL_PX) // 2) + 1)
        edges = np.pad(_edge_cells(small), ((rim, rim), (rim, rim), (0, 0)))
        # the rim repeats the picture's own colour: black would be a difference of colour
        colours = np.pad(_colour_cells(small), ((rim, rim), (rim, rim), (0, 0)), mode="edge")
        yield _unfold(edges).reshape(-1, WINDOW_CELLS**2 * BINS), _unfold(colours)


def _unfold(cells: np.ndarray) -> np.ndarray:
    """(n, window cells, c) all windows of (h, w, c) cells."""
    views = np.lib.stride_tricks.sliding_window_view(cells, (WINDOW_CELLS, WINDOW_CELLS), axis=(0, 1))
    count = views.shape[0] * views.shape[1]
    return np.moveaxis(views, 2, -1).reshape(count, WINDOW_CELLS**2, cells.shape[2])


def _compare_colours(windows: np.ndarray, templates: PoseTemplates) -> np.ndarray:
    """(n, poses) correlation of colour differences within each pose's outline."""
    masks = templates.colour_masks
    count = np.maximum(masks.sum(axis=1), 1)
    flat = windows.reshape(len(windows), -1)
    dot = flat @ templates.colours.T
    energy = np.zeros_like(dot)
    for channel in (0, 1):
        values = windows[..., channel]
        # sum of squares, less the squared sum over the count: the deviation within the mask, without a loop
        energy += values**2 @ masks.T - (values @ masks.T) ** 2 / count
    return dot / np.sqrt(np.maximum(energy, 1e-4 * count))


def _crop_window(picture: np.ndarray, covered: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The square window round an object, as large as the comparison asks for, and the object's place in it."""
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    if len(rows) == 0:
        raise ToolkitError("a pose of the plan does not see the object: plan again with 'toolkit plan'")
    side = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
    middle = np.array([(columns[0] + columns[-1]) / 2, (rows[0] + rows[-1]) / 2])
    # the object's longer side fills OBJECT_CELLS of the window
    scale = OBJECT_CELLS * CELL_PX / side
    size = WINDOW_CELLS * CELL_PX
    place = np.array([[scale, 0, size / 2 - scale * middle[0]], [0, scale, size / 2 - scale * middle[1]]])
    crop = cv2.warpAffine(picture, place, (size, size), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return crop, cv2.warpAffine(covered.astype(np.uint8), place, (size, size), flags=cv2.INTER_NEAREST)


def _edge_cells(picture: np.ndarray) -> np.ndarray:
    """(h / 8, w / 8, 9) strength of edges by direction, each cell against the strength round it."""
    # the root evens out how strong edges in the dark and in the light are
    grey = np.sqrt(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255)
    across, down = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    strength = np.hypot(across, down)
    # modulo 180°: an edge is the same whether the object is lighter or darker than what lies behind it
    place = np.mod(np.arctan2(down, across), np.float32(np.pi)) * np.float32(BINS / np.pi)
    below = np.floor(place).astype(int) % BINS
    share = place - np.floor(place)
    cells = []
    size = (picture.shape[1] // CELL_PX, picture.shape[0] // CELL_PX)
    for direction in range(BINS):
        # each direction's strength is shared between the two nearest bins, so that a small turn changes little
        part = np.where(below == direction, 1 - share, 0) + np.where((below + 1) % BINS == direction, share, 0)
        cells.append(cv2.resize((part * strength).astype(np.float32), size, interpolation=cv2.INTER_AREA))
    map_ = np.stack(cells, axis=-1)
    energy = cv2.blur((map_**2).sum(axis=-1), (3, 3), borderType=cv2.BORDER_REPLICATE)
    # 0.02 keeps noise on an even wall from being raised to edges; the cap keeps a strong edge from being all
    return np.minimum(map_ / np.sqrt(energy + 0.02**2)[..., None], 0.6)


def _colour_cells(picture: np.ndarray) -> np.ndarray:
    """(h / 8, w / 8, 2) chroma."""
    lab = cv2.cvtColor(picture.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    size = (picture.shape[1] // CELL_PX, picture.shape[0] // CELL_PX)
    return cv2.resize(lab[..., 1:] / 100, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], 2)


def _normalise(cells: np.ndarray, mask: np.ndarray, centre: bool = False) -> np.ndarray:
    """(k,) cells within a mask as a vector of unit length."""
    weights = mask[..., None]
    if centre:
        cells = cells - (cells * weights).sum(axis=(0, 1)) / max(float(mask.sum()), 1)
    vector = (cells * weights).reshape(-1)
    return vector / max(float(np.linalg.norm(vector)), 1e-6)
