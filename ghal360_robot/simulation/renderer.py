"""Pictures of the world from a camera in it, drawn by Panda3D's software renderer: no screen, no GPU."""

from __future__ import annotations

import math
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from panda3d import core

from ghal360_robot.simulation.building import Light, add_doorway, add_room, illuminate
from ghal360_robot.simulation.meshes import Batch, Mesh, Surface
from ghal360_robot.simulation.panorama import ATLAS, FACES, CubeMap, face_fov_deg
from ghal360_robot.simulation.raycast import Shapes
from ghal360_robot.simulation.rooms import CEILING_M, Room
from ghal360_robot.simulation.textures import make_texture
from ghal360_robot.simulation.things import add_shadow, add_thing, look_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ghal360_robot.simulation.world import World

NEAR_M, FAR_M = 0.12, 24.0
PATCH_M = 3.0
"""Geometry is cut into patches of floor this wide, so that each of the six views skips what it cannot show."""
SMALL_THINGS = ("laptop", "bottle", "vase", "monitor", "keyboard", "paper tray", "book pile", "mug", "table lamp")
"""Things that stand on furniture and shade it."""
SETTINGS = """
load-display p3tinydisplay
window-type offscreen
audio-library-name null
notify-level error
notify-level-display fatal
notify-level-x11display fatal
notify-level-device fatal
textures-power-2 none
"""


class PanoramaRenderer:
    """Draws equirectangular panoramas of a world. Not thread-safe; about one tenth of a second to build."""

    def __init__(
        self, world: World, width: int = 1920, height: int = 960, face: int = 576, *, painted: bool = False
    ) -> None:
        """Panorama size in pixels (2:1), and the width of the four side views it is made from (even).

        `painted`: things wear the paint of their class for the `painted` detector, instead of looking natural.
        """
        _configure()
        self.world = world
        self._look = look_of(world.target, painted=painted)
        self.width, self.height, self.face = width, height, face
        self._atlas = (round(ATLAS[0] * face), round(ATLAS[1] * face))
        self._textures: dict[str, Any] = {}
        self._root = core.NodePath("world")
        self._rooms: dict[str, Any] = {}
        self._build()
        self._open_buffer()
        self._walls = Shapes.of((), world.plan.wall_boxes(), CEILING_M)

    def render(self, x: float, y: float, yaw: float, camera_height: float) -> NDArray[np.uint8]:
        """The panorama (height, width, 3) RGB at a place; the middle column looks along `yaw`, left is left."""
        bgra = self._map.panorama(self._draw(x, y, yaw, camera_height))
        return np.asarray(cv2.cvtColor(bgra, cv2.COLOR_BGRA2RGB), np.uint8)

    def close(self) -> None:
        """Release the drawing buffer."""
        self._engine.removeWindow(self._buffer)

    @cached_property
    def _map(self) -> CubeMap:
        return CubeMap.build(self.width, self.height, self.face)

    def _draw(self, x: float, y: float, yaw: float, camera_height: float) -> NDArray[np.uint8]:
        in_sight = self._rooms_in_sight(x, y)
        for name, node in self._rooms.items():
            if name in in_sight:
                node.show()
            else:
                node.hide()
        # Panda's heading 0 looks along +y, ours along +x.
        self._rig.setPosHpr(x, y, camera_height, math.degrees(yaw) - 90.0, 0.0, 0.0)
        self._robot.setZ(-camera_height)
        self._engine.renderFrame()
        image = np.frombuffer(self._picture.getRamImage(), np.uint8)
        return image.reshape(*self._atlas[::-1], 4)

    def _rooms_in_sight(self, x: float, y: float) -> set[str]:
        """Rooms that a ray at some bearing reaches; only walls stop it."""
        yaw = np.linspace(-math.pi, math.pi, 720, endpoint=False)
        reach = np.minimum(self._walls.ranges(x, y, yaw), FAR_M)
        along = np.arange(0.0, 1.0001, 0.04)[:, None] * np.maximum(reach - 0.01, 0.0)
        px, py = x + along * np.cos(yaw), y + along * np.sin(yaw)
        return {
            room.name
            for room in self.world.rooms
            if ((px >= room.x0) & (px <= room.x1) & (py >= room.y0) & (py <= room.y1)).any()
        }

    def _build(self) -> None:
        plan, seed = self.world.plan, self.world.seed
        lights: dict[str, list[Light]] = {}
        for room in plan.rooms:
            mesh, shadows = Mesh(), Mesh()
            lights[room.name] = add_room(mesh, plan, room)
            for item in self.world.objects:
                if self._room_of(item.x, item.y) is room:
                    frame = mesh.at(item.x, item.y, item.z, item.yaw)
                    add_thing(frame, item, seed, room.name, self._look)
                    if item.solid or item.name in SMALL_THINGS:
                        add_shadow(shadows.at(item.x, item.y, item.z, item.yaw), item)
            self._rooms[room.name] = self._attach(room.name, mesh, lights[room.name], room)
            self._attach_shadows(self._rooms[room.name], shadows)
        frames = Mesh()
        for door in plan.doors:
            add_doorway(frames, door)
        self._attach("doorways", frames, [light for group in lights.values() for light in group], None)

    def _room_of(self, x: float, y: float) -> Room:
        """The room a thing belongs to (the nearest one, for things in a wall's thickness)."""

        def outside(room: Room) -> float:
            return max(room.x0 - x, x - room.x1, room.y0 - y, y - room.y1)

        return min(self.world.rooms, key=outside)

    def _attach(self, name: str, mesh: Mesh, lights: list[Light], room: Room | None) -> Any:
        node = self._root.attachNewNode(name)
        for texture, batch in mesh.batches.items():
            for geometry in _geometries(batch, lights, room):
                node.attachNewNode(geometry).setTexture(self._texture(texture))
        return node

    def _attach_shadows(self, room: Any, shadows: Mesh) -> None:
        for texture, batch in shadows.batches.items():
            for geometry in _geometries(batch, [], None):
                part = room.attachNewNode(geometry)
                part.setTexture(self._texture(texture))
                part.setTransparency(core.TransparencyAttrib.MAlpha)
                part.setDepthWrite(False)
                part.setBin("transparent", 10)

    def _texture(self, name: str) -> Any:
        if name not in self._textures:
            pixels = make_texture(name, self.world.seed)
            height, width, channels = pixels.shape
            texture = core.Texture(name)
            layout = core.Texture.FRgba if channels == 4 else core.Texture.FRgb
            texture.setup2dTexture(width, height, core.Texture.TUnsignedByte, layout)
            order = [2, 1, 0, 3][:channels]
            texture.setRamImage(np.ascontiguousarray(pixels[::-1, :, order]).tobytes())
            # Better filters than the default one show specks and a green tint, and take three times as long.
            texture.setQualityLevel(core.Texture.QLNormal)
            texture.setMinfilter(core.SamplerState.FTLinearMipmapLinear)
            texture.setMagfilter(core.SamplerState.FTLinear)
            repeats = channels == 3
            wrap = core.SamplerState.WMRepeat if repeats else core.SamplerState.WMClamp
            texture.setWrapU(wrap)
            texture.setWrapV(wrap)
            self._textures[name] = texture
        return self._textures[name]

    def _open_buffer(self) -> None:
        pipe = core.GraphicsPipeSelection.getGlobalPtr().makeModulePipe("p3tinydisplay")
        self._engine = core.GraphicsEngine()
        frame = core.FrameBufferProperties()
        frame.setRgbColor(True)
        frame.setDepthBits(24)
        size = core.WindowProperties.size(*self._atlas)
        self._buffer = self._engine.makeOutput(pipe, "panorama", 0, frame, size, core.GraphicsPipe.BFRefuseWindow)
        if self._buffer is None:
            raise RuntimeError("Panda3D's software renderer could not open a picture buffer; reinstall panda3d.")
        self._picture = core.Texture("faces")
        self._buffer.addRenderTexture(self._picture, core.GraphicsOutput.RTMCopyRam)
        self._buffer.setClearColorActive(False)
        self._rig = self._root.attachNewNode("camera rig")
        self._robot = self._rig.attachNewNode("robot")
        mesh = Mesh()
        add_robot(mesh)
        for name, batch in mesh.batches.items():
            for geometry in _geometries(batch, [], None):
                self._robot.attachNewNode(geometry).setTexture(self._texture(name))
        for face in FACES:
            left, bottom = face.column / ATLAS[0], face.row / ATLAS[1]
            region = self._buffer.makeDisplayRegion(
                left, left + face.size / ATLAS[0], bottom, bottom + face.size / ATLAS[1]
            )
            lens = core.PerspectiveLens()
            fov = face_fov_deg(round(face.size * self.face))
            lens.setFov(fov, fov)
            lens.setNearFar(NEAR_M, FAR_M)
            camera = self._rig.attachNewNode(core.Camera("face", lens))
            camera.setHpr(face.heading_deg, face.pitch_deg, 0.0)
            region.setCamera(camera)
            region.setClearDepthActive(True)
            region.setClearColorActive(True)
            region.setClearColor((0.5, 0.5, 0.5, 1.0))


@cache
def _configure() -> None:
    """Panda3D's settings are global; set them once."""
    core.loadPrcFileData("", SETTINGS)
    # By default things are drawn in the order of their addresses, which differs from run to run.
    core.CullBinManager.getGlobalPtr().setBinType("opaque", core.CullBinManager.BTUnsorted)


def add_robot(mesh: Mesh) -> None:
    """What the camera sees of its own robot: wheels, deck and mast; front along +x, floor at z = 0."""
    robot = mesh.at(0.0, 0.0, 0.0, math.pi / 2)
    dark, grey = Surface("plain", (0.16, 0.16, 0.17)), Surface("steel", (0.36, 0.37, 0.38), 0.4)
    robot.box(0, 0, 0.14, (0.46, 0.52, 0.16), dark)
    robot.box(0, 0, 0.30, (0.40, 0.44, 0.02), grey)
    for side in (-1.0, 1.0):
        wheel = robot.at(side * 0.28 - 0.045, 0, 0.21, yaw=-math.pi / 2, pitch=math.pi / 2)
        wheel.tube(0, 0, 0, [(0.0, 0.0), (0.19, 0.0), (0.21, 0.02), (0.21, 0.07), (0.19, 0.09), (0.0, 0.09)],
                   Surface("canvas", (0.12, 0.12, 0.125), 0.3), sides=28)  # fmt: skip
    robot.tube(0, -0.20, 0.20, [(0.045, 0.0), (0.045, 0.08), (0.0, 0.081)], Surface("plain", (0.28, 0.29, 0.30)))
    robot.tube(0, 0, 0.3, [(0.03, 0.0), (0.022, 0.72), (0.0, 0.721)], Surface("plain", (0.22, 0.22, 0.23)), sides=10)


def _geometries(batch: Batch, lights: list[Light], room: Room | None) -> Iterator[Any]:
    """Panda nodes of a batch, one per patch of the floor, with the light baked into the colours."""
    points, normals = np.concatenate(batch.points), np.concatenate(batch.normals)
    colours, glow = np.concatenate(batch.colours), np.concatenate(batch.glow)
    lit = np.where(glow, 1.0, illuminate(points, normals, lights, room))
    rgba = np.clip(np.column_stack((colours[:, :3] * lit[:, None], colours[:, 3])), 0.0, 1.0)
    vertices = np.zeros(len(points), [("point", "<f4", 3), ("colour", "u1", 4), ("uv", "<f4", 2)])
    vertices["point"] = points
    vertices["colour"] = np.round(rgba * 255)
    vertices["uv"] = np.concatenate(batch.uv)
    triangles = np.concatenate(batch.triangles)
    patch = np.floor(points[triangles, :2].mean(axis=1) / PATCH_M).astype(int)
    _, which = np.unique(patch, axis=0, return_inverse=True)
    for index in range(int(which.max()) + 1):
        used, renumbered = np.unique(triangles[which.ravel() == index], return_inverse=True)
        yield _node(vertices[used], renumbered)


def _node(vertices: NDArray[Any], triangles: NDArray[np.int64]) -> Any:
    data = core.GeomVertexData("part", core.GeomVertexFormat.getV3c4t2(), core.Geom.UHStatic)
    data.uncleanSetNumRows(len(vertices))
    data.modifyArrayHandle(0).copyDataFrom(vertices.tobytes())
    primitive = core.GeomTriangles(core.Geom.UHStatic)
    primitive.setIndexType(core.Geom.NTUint32)
    array = primitive.modifyVertices()
    array.uncleanSetNumRows(triangles.size)
    array.modifyHandle().copyDataFrom(triangles.astype("<u4").tobytes())
    geometry = core.Geom(data)
    geometry.addPrimitive(primitive)
    node = core.GeomNode("part")
    node.addGeom(geometry)
    return node
