"""Pictures of the town through a robot's lens, rendered without a screen.

Road and room come from backdrop.py. Things are meshes drawn by OpenGL, their vertices bent by the same lens model.
Radiance is carried as the square root of the signal, see sensor.py.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Dict, List, Optional, Sequence, Tuple

import cv2
import moderngl
import numpy as np
from scipy.spatial import ConvexHull

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.types import Array
from obst_avoid.sim import shaders
from obst_avoid.sim.backdrop import RGB, Backdrop, Surfaces, brightness_at, make_backdrop, see
from obst_avoid.sim.lens import Lens, lay_out
from obst_avoid.sim.light import HEADLIGHT_COLOR, Lamp, Light, headlight
from obst_avoid.sim.meshes import Mesh, coarse, mesh_of
from obst_avoid.sim.things import Thing
from obst_avoid.sim.town import Town, WorldPose, robot_from_world

LARGEST_LAMPS = 3
NEAR = 0.01
"""[m] ahead of the camera; nothing nearer is drawn."""
SMEAR_STEP = 2.0
"""[px] between the pictures that make up a blurred one."""
LARGEST_PARTS = 16
COARSE_BELOW, COARSE_CELL = 24.0, 0.14
"""[px] of a thing's height in the picture below which a coarser mesh does, and its detail in heights of the thing."""
SHADOW_RAYS, FARTHEST_SHADOW = 3, 2.0
"""Points of a lamp's disc that cast a shadow each; [m] from the robot to a thing beyond which it casts none."""


class RenderError(RuntimeError):
    """OpenGL is not to be had. The message says what is missing."""


@dataclass(frozen=True)
class Scene:
    """Everything that one picture shows, beside the robot's place. seed: of texture and room.

    shading: how much of red, green and blue light the lens loses per squared distance from the picture's middle, in
    picture sizes; unequal ones tint the corners.
    """

    town: Town
    things: Tuple[Thing, ...] = ()
    light: Light = Light()
    surfaces: Surfaces = Surfaces()
    shading: RGB = (0.9, 0.9, 0.9)
    seed: int = 0


class Renderer:
    """Holds the OpenGL context, and on the graphics side what stays the same from picture to picture."""

    def __init__(self, calibration: Calibration, samples: int = 0) -> None:
        """Raises RenderError. samples: per pixel of a thing's edge; 0 is fastest, 4 is smooth.

        With 0, small things are drawn with less detail than `names` knows of them: labels want samples.
        """
        try:
            self._gl = moderngl.create_context(standalone=True, backend='egl', require=330)
        except Exception as error:  # moderngl raises plain Exception
            raise RenderError(
                'OpenGL without a screen is not to be had (%s), expected Mesa: libegl1 libegl-mesa0 libgl1-mesa-dri'
                % error
            ) from error
        self._lens = lay_out(calibration)
        self._size = (calibration.width, calibration.height)
        self._blind = self._lens.blind if self._lens.blind.any() else None
        self._samples = samples
        self._things = self._gl.program(vertex_shader=shaders.LENS + shaders.THING, fragment_shader=shaders.COLOR)
        self._shadows = self._gl.program(vertex_shader=shaders.LENS + shaders.SHADOW, fragment_shader=shaders.FLAT)
        self._names = self._gl.program(vertex_shader=shaders.LENS + shaders.NAME, fragment_shader=shaders.FLAT)
        self._target = self._framebuffer(samples)
        self._plain = self._framebuffer(0) if samples else self._target
        self._meshes: Dict[Tuple[str, bool], Tuple[Any, Any, Any, Any]] = {}
        self._members = {
            id(program): {name: program[name] for name in program}
            for program in (self._things, self._shadows, self._names)
        }
        self._scene: Optional[Scene] = None
        self._backdrop: Optional[Backdrop] = None
        for program in (self._things, self._shadows, self._names):
            self._set(program, _uniforms(self._lens))

    @property
    def focal_length(self) -> float:
        """[px] in the middle of the picture."""
        return float(self._lens.calibration.camera_matrix[0, 0])

    def close(self) -> None:
        """Give back what the context holds."""
        self._gl.release()

    def render(self, scene: Scene, path: Sequence[WorldPose], factors: RGB) -> Array:
        """The signal that the sensor gathers, encoded: (H, W, 3) uint8 BGR.

        path: the robot's poses at the beginning and at the end of the exposure, or one pose. factors: from radiance to
        signal, red, green, blue.
        """
        parts = self._parts(path)
        with self._gl:  # another renderer's context may be the current one
            if len(parts) == 1:
                return self._part(scene, parts[0], factors)
            total = np.zeros((self._size[1], self._size[0], 3), dtype=np.float32)
            for pose in parts:
                cv2.accumulateSquare(self._part(scene, pose, factors), total)
        encoded: Array = cv2.sqrt(total / len(parts))
        return np.rint(encoded).astype(np.uint8)

    def names(self, scene: Scene, pose: WorldPose) -> Array:
        """Which thing each pixel shows: (H, W) uint8, 0 for none, else its index in scene.things + 1."""
        with self._gl:
            self._plain.use()
            self._gl.disable(moderngl.BLEND)
            self._gl.enable(moderngl.DEPTH_TEST)
            self._plain.clear(0, 0, 0, 0, depth=1.0)
            for index, thing in self._visible(scene, pose):
                self._set(self._names, {**_place(thing, pose), 'factor': ((index + 1) / 255.0, 0.0, 0.0, 1.0)})
                self._mesh(thing)[2].render()
            return self._framed(np.ascontiguousarray(self._read(self._plain)[..., 0]))

    def _parts(self, path: Sequence[WorldPose]) -> List[WorldPose]:
        """Poses whose pictures make up a blurred one: spread evenly over the exposure."""
        first, last = path[0], path[-1]
        smear = self.smear(first, last)
        count = min(max(1, math.ceil(smear / SMEAR_STEP)), LARGEST_PARTS)
        turn = math.remainder(last.heading - first.heading, 2 * math.pi)
        shares = [(index + 0.5) / count for index in range(count)]
        return [
            WorldPose(
                first.x + share * (last.x - first.x),
                first.y + share * (last.y - first.y),
                first.heading + share * turn,
            )
            for share in shares
        ]

    def smear(self, first: WorldPose, last: WorldPose) -> float:
        """[px] by which the road ahead moves in the picture between two poses; an upper bound if it is tiny."""
        moved = robot_from_world(np.array([[last.x, last.y]]), first)[0]
        turn = math.remainder(last.heading - first.heading, 2 * math.pi)
        bound = self.focal_length * (abs(turn) + 5 * float(np.hypot(*moved)))
        if bound < SMEAR_STEP / 2:
            return float(bound)
        points = np.array([[0.25, 0.0], [0.4, 0.1], [0.4, -0.1], [1.0, 0.0]])
        cos, sin = math.cos(turn), math.sin(turn)
        after = (points - moved) @ np.array([[cos, -sin], [sin, cos]])
        shift = self._lens.pixels_from_ground(after) - self._lens.pixels_from_ground(points)
        return float(np.hypot(shift[:, 0], shift[:, 1]).max())

    def _prepare(self, scene: Scene) -> Backdrop:
        before = self._scene
        same = before is not None and replace(before, things=()) == replace(scene, things=())
        if self._backdrop is None or not same:
            self._backdrop = make_backdrop(
                self._lens, scene.town, scene.surfaces, scene.light, scene.shading, scene.seed
            )
            lamps = scene.light.lamps
            shares = [lamp.share / lamp.direction[2] for lamp in lamps] + [0.0] * (LARGEST_LAMPS - len(lamps))
            self._set(
                self._things, {'shares': tuple(shares), 'ambient': scene.light.ambient, 'vignette': scene.shading}
            )
            self._scene = scene
        return self._backdrop

    def _part(self, scene: Scene, pose: WorldPose, factors: RGB) -> Array:
        """One sharp picture."""
        backdrop = self._prepare(scene)
        picture = see(backdrop, pose, factors)
        visible = self._visible(scene, pose)
        if not visible:
            return self._framed(picture)
        self._target.use()
        self._target.clear(0, 0, 0, 1, depth=1.0)  # alpha: how much of the backdrop is seen
        self._draw_shadows(scene, pose, visible)
        self._draw_things(backdrop, pose, visible, factors)
        drawn = self._read(self._target)
        shown = cv2.cvtColor(drawn[..., 3], cv2.COLOR_GRAY2BGR)
        mixed: Array = cv2.add(cv2.multiply(picture, shown, scale=1 / 255), cv2.cvtColor(drawn, cv2.COLOR_RGBA2BGR))
        return self._framed(mixed)

    def _framed(self, picture: Array) -> Array:
        """Black, or no thing, where no ray reaches the sensor: beyond the lens's fold vertices lie anywhere."""
        if self._blind is not None:
            picture[self._blind] = 0
        return picture

    def _read(self, framebuffer: Any) -> Array:
        """(H, W, 4) uint8 RGBA."""
        if framebuffer is self._target and self._samples:
            self._gl.copy_framebuffer(self._plain, self._target)
            framebuffer = self._plain
        width, height = self._size
        return np.frombuffer(framebuffer.read(components=4), dtype=np.uint8).reshape(height, width, 4)

    def _draw_shadows(self, scene: Scene, pose: WorldPose, visible: Sequence[Tuple[int, Thing]]) -> None:
        gl = self._gl
        gl.enable(moderngl.DEPTH_TEST | moderngl.BLEND)
        gl.blend_func = moderngl.ZERO, moderngl.SRC_ALPHA
        for layer, (direction, share) in enumerate(_shadow_rays(scene.light)):
            # a layer of its own: where two things shade the same lamp, its light is taken away once
            common = {'lamp': _turned(direction, -pose.heading), 'layer': 0.999 - 0.0008 * layer}
            self._set(self._shadows, {**common, 'factor': (0.0, 0.0, 0.0, math.sqrt(1 - share))})
            for _, thing in visible:
                if math.hypot(thing.x - pose.x, thing.y - pose.y) < FARTHEST_SHADOW:
                    self._set(self._shadows, _place(thing, pose))
                    self._mesh(thing)[3].render()

    def _draw_things(
        self, backdrop: Backdrop, pose: WorldPose, visible: Sequence[Tuple[int, Thing]], factors: RGB
    ) -> None:
        self._gl.disable(moderngl.BLEND)
        self._gl.enable(moderngl.DEPTH_TEST)
        light, eye = backdrop.light, self._lens.eye
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        camera = (pose.x + cos * eye[0] - sin * eye[1], pose.y + sin * eye[0] + cos * eye[1])
        lamps = list(light.lamps) + [Lamp(0.0, 1.0, 0.0)] * (LARGEST_LAMPS - len(light.lamps))
        for _, thing in visible:
            strength = light.strength * brightness_at(backdrop, thing.x, thing.y)
            shone = 0.0
            if light.headlight:
                ahead, left = _seen_from(pose, thing.x, thing.y)
                shone = float(headlight(light, np.array([ahead]), np.array([left]))[0])
            x, y = _seen_from(WorldPose(thing.x, thing.y, thing.yaw), *camera)
            values = {
                **_place(thing, pose),
                'lamps': [_turned(lamp.direction, -thing.yaw) for lamp in lamps],
                'eye': (x / thing.height, y / thing.height, eye[2] / thing.height),
                'factor': tuple(
                    (strength * c + shone * h) * f * t
                    for c, h, f, t in zip(light.color, HEADLIGHT_COLOR, factors, thing.tint)
                ),
            }
            self._set(self._things, values)
            distance = math.hypot(thing.x - pose.x, thing.y - pose.y)
            far = not self._samples and self.focal_length * thing.height < COARSE_BELOW * distance
            self._mesh(thing)[1 if far else 0].render()

    def _visible(self, scene: Scene, pose: WorldPose) -> List[Tuple[int, Thing]]:
        """Things that may be seen, or whose shadow may be, with their index."""
        kept = []
        for index, thing in enumerate(scene.things):
            x, y = _seen_from(pose, thing.x, thing.y)
            if x > -2 * thing.height and math.hypot(x, y) < 6.0 and abs(y) < 2.5 * x + 0.3 + 2 * thing.height:
                kept.append((index, thing))
        return kept

    def _mesh(self, thing: Thing) -> Tuple[Any, Any, Any, Any]:
        """Vertex arrays of a thing's mesh: in colour, the same coarse, by name, and its shadow's hull."""
        key = (thing.sort, thing.lying)
        if key not in self._meshes:
            mesh = mesh_of(*key)
            hull = self._gl.buffer(_hull(mesh.vertices).astype(np.float32).tobytes())
            self._meshes[key] = (
                self._vertex_array(self._things, mesh),
                self._vertex_array(self._things, coarse(mesh, COARSE_CELL)),
                self._vertex_array(self._names, mesh),
                self._gl.vertex_array(self._shadows, [(hull, '3f', 'position')]),
            )
        return self._meshes[key]

    def _vertex_array(self, program: Any, mesh: Mesh) -> Any:
        packed = np.concatenate([mesh.vertices, mesh.normals, mesh.albedo, mesh.gloss[:, None]], axis=1)
        buffer = self._gl.buffer(packed.astype(np.float32).tobytes())
        indices = self._gl.buffer(mesh.triangles.astype(np.int32).tobytes())
        named = [(buffer, '3f 28x', 'position')]
        colored = [(buffer, '3f 3f 3f 1f', 'position', 'normal', 'albedo', 'gloss')]
        return self._gl.vertex_array(program, colored if program is self._things else named, indices)

    def _framebuffer(self, samples: int) -> Any:
        gl, size = self._gl, self._size
        color = gl.renderbuffer(size, 4, samples=samples) if samples else gl.texture(size, 4)
        return gl.framebuffer([color], gl.depth_renderbuffer(size, samples=samples))

    def _set(self, program: Any, values: Dict[str, Any]) -> None:
        known = self._members[id(program)]
        for name, value in values.items():
            if name in known:  # a driver drops what a shader does not use
                known[name].value = value


def _uniforms(lens: Lens) -> Dict[str, Any]:
    """What the shaders know of the camera."""
    calibration = lens.calibration
    return {
        'camera': tuple(np.concatenate([lens.projection, [[0, 0, 0, 1]]]).T.ravel()),
        'rectification': tuple(calibration.rectification.ravel()),  # read column by column: its inverse
        'lens': tuple(calibration.camera_matrix[[0, 1, 0, 1], [0, 1, 2, 2]]),
        'radial': tuple(calibration.distortion[[0, 1, 4]]),
        'tangential': tuple(calibration.distortion[2:4]),
        'fold': lens.fold,
        'picture_size': (calibration.width, calibration.height),
        'near': NEAR,
    }


def _turned(vector: Tuple[float, float, float], angle: float) -> Tuple[float, float, float]:
    """A vector turned about the vertical by angle rad to the left."""
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1], vector[2]


def _place(thing: Thing, pose: WorldPose) -> Dict[str, Any]:
    """Where a thing stands in the robot frame."""
    yaw = thing.yaw - pose.heading
    return {'place': (*_seen_from(pose, thing.x, thing.y), math.cos(yaw), math.sin(yaw)), 'scale': thing.height}


def _seen_from(pose: WorldPose, x: float, y: float) -> Tuple[float, float]:
    """One point of the world in the frame of a pose; for so few, arrays would take longer."""
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    return cos * (x - pose.x) + sin * (y - pose.y), -sin * (x - pose.x) + cos * (y - pose.y)


def _hull(vertices: Array) -> Array:
    """(M, 3) corners of a coarse convex hull's triangles, for shadows."""
    coarse = np.unique(np.round(vertices / 0.12) * 0.12, axis=0)
    hull = ConvexHull(coarse, qhull_options='QJ')
    corners: Array = coarse[hull.simplices].reshape(-1, 3)
    return corners


def _shadow_rays(light: Light) -> List[Tuple[Tuple[float, float, float], float]]:
    """Directions to parts of the lamps, world frame, each with the share of the light that it gives."""
    rays = [(Lamp(0.0, math.pi / 2 - 0.05, 1.0).direction, 0.5 * light.ambient)]
    for lamp in light.lamps[:LARGEST_LAMPS]:
        for index in range(SHADOW_RAYS):
            angle = 2 * math.pi * index / SHADOW_RAYS
            moved = replace(
                lamp,
                azimuth=lamp.azimuth + lamp.size * math.cos(angle) * 0.7,
                elevation=lamp.elevation + lamp.size * math.sin(angle) * 0.7,
            )
            rays.append((moved.direction, lamp.share / SHADOW_RAYS))
    return rays
