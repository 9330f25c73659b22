"""Pictures, depth and labels of textured meshes, drawn without a screen.

pyrender over EGL, with four corrections that its pictures need before they are data: GL's pixel
centres lie half a pixel from OpenCV's, its multisampled buffer returns depth from a shifted sample,
its scenes are drawn in the order of memory addresses, and its viewer would load a window system.
One `MeshRenderer` per process: closing one of two shuts the display under the other.
"""

import os
import sys
import types
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.types import Float32, Float64, Int64, UInt8

APT_LINE = "apt-get install -y --no-install-recommends libegl1 libgl1"
NEAR, FAR = 0.1, 30.0
"""Metres; what lies outside is not drawn."""
SELF_TEST_SIZE = 16


class RendererError(UserError):
    """Headless GL is missing or refuses to work."""


def _headless_pyrender() -> types.ModuleType:
    """pyrender, imported so that it needs no screen and draws one sample per pixel.

    Raises:
        RendererError: when no GL library can be loaded.
    """
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    os.environ.setdefault("PYGLET_HEADLESS", "1")
    if "pyrender.viewer" not in sys.modules:
        viewer = types.ModuleType("pyrender.viewer")
        viewer.Viewer = None  # type: ignore[attr-defined] # stands in for a class that needs X11
        sys.modules["pyrender.viewer"] = viewer
    try:
        import pyrender
        import pyrender.renderer
        from OpenGL.GL import glRenderbufferStorage
    except (ImportError, AttributeError, OSError) as error:
        raise _gl_missing(error) from error
    pyrender.renderer.glRenderbufferStorageMultisample = (
        lambda target, samples, form, width, height: glRenderbufferStorage(
            target, form, width, height
        )
    )
    return pyrender  # type: ignore[no-any-return] # ships no annotations


def _ordered_scene(pyrender: types.ModuleType) -> type:
    """A scene that gives its meshes and lights to the renderer in the order of their names.

    pyrender keeps them in sets, so their order would follow from where in memory they happen to
    lie. Where two triangles have the same depth the one drawn first stays, and sums of three or
    more lights round by their order: pictures would differ from run to run in a few pixels.
    """

    class OrderedScene(pyrender.Scene):  # type: ignore[name-defined,misc] # ships no annotations
        @property
        def mesh_nodes(self) -> list[object]:
            return sorted(super().mesh_nodes, key=attrgetter("name"))

        @property
        def light_nodes(self) -> list[object]:
            return sorted(super().light_nodes, key=attrgetter("name"))

    return OrderedScene


def _gl_missing(cause: BaseException) -> RendererError:
    return RendererError(
        f"cannot draw without a screen ({cause}): Mesa's EGL is missing or does not start; "
        f"install it with `{APT_LINE}`"
    )


@dataclass(frozen=True)
class Pinhole:
    """A camera without distortion: OpenCV axes, metres, pixel centres at integers."""

    K: Float64
    """(3, 3) pixels."""
    R: Float64
    """(3, 3) camera from world."""
    T: Float64
    """(3,) camera from world, metres."""
    size: tuple[int, int]
    """Width, height."""

    def finer(self, factor: int) -> "Pinhole":
        """The same view with `factor` times the pixels per side."""
        K = self.K.copy()
        K[:2] *= factor
        K[:2, 2] += 0.5 * factor - 0.5
        return Pinhole(K, self.R, self.T, (self.size[0] * factor, self.size[1] * factor))

    def cropped(self, box: tuple[int, int, int, int]) -> "Pinhole":
        """The part (left, top, right, bottom) of the view; right and bottom are outside."""
        left, top, right, bottom = box
        K = self.K.copy()
        K[:2, 2] -= [left, top]
        return Pinhole(K, self.R, self.T, (right - left, bottom - top))


@dataclass(frozen=True)
class Paint:
    """A texture to draw with; make it once per actor, so that it is uploaded once."""

    material: object


@dataclass(frozen=True)
class Mesh:
    """Triangles of one paint and one label; vertices repeat along texture seams."""

    vertices: Float32
    """(V, 3) world frame, metres."""
    normals: Float32
    """(V, 3) unit."""
    faces: Int64
    """(F, 3)."""
    uv: Float32
    """(V, 2); v = 1 is the top row of the texture."""
    paint: Paint
    label: int
    """1 to 255: what `Drawing.labels` says where this mesh is in front."""


@dataclass(frozen=True)
class Light:
    """Parallel light."""

    direction: Float64
    """(3,) the way the light travels, world frame."""
    intensity: float
    """pi gives a matt white surface that faces the light its full colour."""


@dataclass(frozen=True)
class Lighting:
    """What falls on the scene."""

    lights: tuple[Light, ...]
    ambient: float
    """Share of full light that comes from everywhere."""


@dataclass(frozen=True)
class Drawing:
    """One drawn picture."""

    rgb: UInt8
    """(H, W, 3) sRGB, black where nothing is."""
    depth: Float32
    """(H, W) metres along the optical axis, 0 where nothing is."""
    labels: UInt8
    """(H, W) label of the front mesh, 0 where nothing is."""


class MeshRenderer:
    """Draws meshes as OpenCV cameras see them: pixel (i, j) is the ray through integer (i, j).

    Raises:
        RendererError: when headless GL does not start.
    """

    def __init__(self) -> None:
        self._pyrender = _headless_pyrender()
        self._scene = _ordered_scene(self._pyrender)
        # By identity; the mesh is kept with its twin, so that no other can take its identity.
        self._held: dict[int, tuple[Mesh, object]] = {}
        try:
            self._offscreen = self._pyrender.OffscreenRenderer(SELF_TEST_SIZE, SELF_TEST_SIZE)
        except (ImportError, AttributeError, OSError, RuntimeError, ValueError) as error:
            raise _gl_missing(error) from error

    def paint(self, texture: UInt8, double_sided: bool = False) -> Paint:
        """A paint from an sRGB picture (H, W, 3)."""
        pyrender = self._pyrender
        source = pyrender.Texture(source=np.ascontiguousarray(texture), source_channels="RGB")
        return Paint(
            pyrender.MetallicRoughnessMaterial(
                baseColorTexture=source,
                metallicFactor=0.0,
                roughnessFactor=1.0,
                doubleSided=double_sided,
            )
        )

    def draw(
        self,
        meshes: Sequence[Mesh],
        camera: Pinhole,
        lighting: Lighting | None,
        labels: bool = True,
    ) -> Drawing:
        """The meshes seen by one camera; no lighting gives the texture's own colours.

        Where several have the same depth, the one given first is in front.
        Without `labels` the second pass is saved and `Drawing.labels` is 1 wherever a mesh is.
        Meshes stay uploaded until others are drawn: draw all cameras of a frame in a row.
        """
        pyrender = self._pyrender
        scene = self._scene(
            bg_color=(0, 0, 0, 0), ambient_light=[lighting.ambient if lighting else 1.0] * 3
        )
        nodes: dict[object, int] = {}
        for place, (mesh, uploaded) in enumerate(zip(meshes, self._uploaded(meshes), strict=True)):
            node = pyrender.Node(name=_name(place), mesh=uploaded)
            scene.add_node(node)
            nodes[node] = mesh.label
        self._add_camera(scene, camera)
        for place, light in enumerate(lighting.lights if lighting else ()):
            scene.add_node(self._light(light, _name(place)))
        self._offscreen.viewport_width, self._offscreen.viewport_height = camera.size
        flags = pyrender.RenderFlags
        rgb, depth = self._offscreen.render(scene, flags.NONE if lighting else flags.FLAT)
        if labels:
            colours = {node: (label, label, label) for node, label in nodes.items()}
            segmented, _ = self._offscreen.render(scene, flags.SEG, colours)
            found = segmented[..., 0]
        else:
            found = (depth > 0).astype(np.uint8)
        return Drawing(rgb, depth, found)

    def __enter__(self) -> "MeshRenderer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Gives the display back; nothing can be drawn afterwards in this process."""
        self._offscreen.delete()

    def _uploaded(self, meshes: Sequence[Mesh]) -> list[object]:
        """What pyrender draws for the meshes; those of the last drawing are used again."""
        held = {}
        for mesh in meshes:
            twin = self._held.get(id(mesh))
            held[id(mesh)] = twin or (mesh, self._pyrender.Mesh([self._primitive(mesh)]))
        self._held = held
        return [held[id(mesh)][1] for mesh in meshes]

    def _primitive(self, mesh: Mesh) -> object:
        return self._pyrender.Primitive(
            positions=mesh.vertices,
            normals=mesh.normals,
            indices=mesh.faces,
            texcoord_0=mesh.uv,
            material=mesh.paint.material,
        )

    def _add_camera(self, scene: object, camera: Pinhole) -> None:
        """Half a pixel is added because GL's pixel centres lie at halves."""
        K = camera.K
        intrinsics = self._pyrender.IntrinsicsCamera(
            K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5, znear=NEAR, zfar=FAR
        )
        world_from_camera = np.eye(4)
        world_from_camera[:3, :3] = camera.R.T
        world_from_camera[:3, 3] = -camera.R.T @ camera.T
        gl_axes = np.diag([1.0, -1.0, -1.0, 1.0])
        scene.add(intrinsics, pose=world_from_camera @ gl_axes)  # type: ignore[attr-defined]

    def _light(self, light: Light, name: str) -> object:
        """GL lights shine along their own -z."""
        back = -light.direction / np.linalg.norm(light.direction)
        helper = np.eye(3)[np.argmin(np.abs(back))]
        right = np.cross(helper, back)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
        source = self._pyrender.DirectionalLight(color=np.ones(3), intensity=light.intensity)
        return self._pyrender.Node(name=name, light=source, matrix=pose)


def _name(place: int) -> str:
    """A name whose alphabetical order is that of the places.

    >>> _name(2) < _name(10)
    True
    """
    return f"{place:06d}"


def check_headless_gl() -> str:
    """One line on the GL that draws, after drawing one triangle.

    Raises:
        RendererError: with the line that installs what is missing.
    """
    renderer = MeshRenderer()
    try:
        triangle = Mesh(
            np.array([[-1, -1, 2], [1, -1, 2], [0, 1, 2]], dtype=np.float32),
            np.tile(np.array([0, 0, -1], dtype=np.float32), (3, 1)),
            np.array([[0, 2, 1]]),
            np.zeros((3, 2), dtype=np.float32),
            renderer.paint(np.full((4, 4, 3), 200, dtype=np.uint8), double_sided=True),
            label=1,
        )
        K = np.array([[8.0, 0, 7.5], [0, 8.0, 7.5], [0, 0, 1]])
        camera = Pinhole(K, np.eye(3), np.zeros(3), (SELF_TEST_SIZE, SELF_TEST_SIZE))
        drawing = renderer.draw([triangle], camera, None)
        if drawing.rgb[8, 8, 0] != 200 or drawing.labels[8, 8] != 1:
            raise _gl_missing(RuntimeError("a test triangle came out empty"))
        from OpenGL.GL import GL_RENDERER, GL_VERSION, glGetString

        name, version = (glGetString(key).decode() for key in (GL_RENDERER, GL_VERSION))
        return f"headless GL works: {name}, {version}"
    finally:
        renderer.close()


if __name__ == "__main__":
    try:
        sys.stdout.write(f"{check_headless_gl()}\n")
    except RendererError as error:
        sys.stderr.write(f"error: {error}\n")
        raise SystemExit(1) from error
