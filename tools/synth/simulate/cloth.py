"""One stage of cloth simulation in Blender."""
from dataclasses import dataclass

import bpy
import numpy as np

# Piles stand twice too tall at true scale: simulate larger, gravity included, and scale back.
SCALE = 5.0
GRAVITY = 9.81
FRAMES_PER_SECOND = 30
SPACING = 0.0028  # distance at which layers of cloth meet, metres


@dataclass
class Fabric:
    bending: float
    band_bending: float  # of collars, bands and hems
    mass: float


def draw_fabric(rng):
    bending = float(np.exp(rng.uniform(np.log(0.012), np.log(0.09))))
    return Fabric(bending, bending * float(rng.uniform(4, 15)), float(rng.uniform(0.2, 0.4)))


def _clear():
    for o in list(bpy.data.objects):
        bpy.data.objects.remove(o, do_unlink=True)
    for m in list(bpy.data.meshes):
        bpy.data.meshes.remove(m)
    for a in list(bpy.data.actions):
        bpy.data.actions.remove(a)


def _table(scene):
    a, depth = 2.0 * SCALE, 0.3 * SCALE
    corners = [(x, y, z) for z in (-depth, 0.0) for x, y in ((-a, -a), (a, -a), (a, a), (-a, a))]
    sides = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    mesh = bpy.data.meshes.new("table")
    mesh.from_pydata(corners, [], sides)
    table = bpy.data.objects.new("table", mesh)
    scene.collection.objects.link(table)
    table.modifiers.new("collision", "COLLISION")
    table.collision.thickness_outer = 0.006 * SCALE
    table.collision.thickness_inner = 0.05 * SCALE
    table.collision.cloth_friction = 15
    table.collision.damping = 0.5
    table.collision.use_culling = False


def simulate(mesh, start, fabric, frames, pins=None, path=None, table=True, still=0.0, press=1.0):
    """Positions after `frames` frames from rest at `start` ([V,3], metres).

    pins: vertices that are held; path: [(frame, (dx, dy, dz))] along which they are carried.
    still: stop when the mean step per frame is below this (metres). press: times gravity, as hands
    that smooth the cloth down.
    """
    _clear()
    scene = bpy.context.scene
    scene.render.fps = FRAMES_PER_SECOND
    scene.gravity = (0, 0, -GRAVITY * SCALE * press)
    data = bpy.data.meshes.new("cloth")
    data.from_pydata((mesh.rest * SCALE).tolist(), [], mesh.faces.tolist())
    data.update()
    ob = bpy.data.objects.new("cloth", data)
    scene.collection.objects.link(ob)
    ob.shape_key_add(name="rest")
    pose = ob.shape_key_add(name="pose")
    pose.value = 1.0
    pose.data.foreach_set("co", (start * SCALE).astype(np.float32).ravel())
    modifier = ob.modifiers.new("cloth", "CLOTH")
    s, c = modifier.settings, modifier.collision_settings
    s.rest_shape_key = data.shape_keys.key_blocks["rest"]
    s.quality = 7
    s.mass = fabric.mass
    s.tension_stiffness, s.shear_stiffness, s.compression_stiffness = 20, 10, 15
    s.tension_damping = s.compression_damping = s.shear_damping = 5
    s.bending_model = "ANGULAR"
    s.bending_stiffness, s.bending_damping = fabric.bending, 0.5
    s.air_damping = 1.0
    c.collision_quality = 3
    c.distance_min = SPACING * SCALE
    c.friction = 15
    c.use_self_collision = True
    c.self_distance_min = SPACING * SCALE
    c.self_friction = 5
    stiff = np.flatnonzero(mesh.stiff > 0)
    if len(stiff):
        group = ob.vertex_groups.new(name="band")
        for i in stiff.tolist():
            group.add([i], float(mesh.stiff[i]), "REPLACE")
        s.vertex_group_bending = "band"
        s.bending_stiffness_max = fabric.band_bending
    if pins is not None:
        group = ob.vertex_groups.new(name="pin")
        group.add([int(i) for i in pins], 1.0, "REPLACE")
        s.vertex_group_mass = "pin"
        s.pin_stiffness = 1.0
    if path:
        for frame, step in path:
            ob.location = [x * SCALE for x in step]
            ob.keyframe_insert("location", frame=frame)
        for curve in ob.animation_data.action.fcurves:
            for key in curve.keyframe_points:
                key.interpolation = "LINEAR"
    if table:
        _table(scene)
    modifier.point_cache.frame_start, modifier.point_cache.frame_end = 1, frames + 1
    previous = None
    for frame in range(1, frames + 2):
        scene.frame_set(frame)
        evaluated = ob.evaluated_get(bpy.context.evaluated_depsgraph_get())
        flat = np.empty(3 * len(start), np.float32)
        evaluated.data.vertices.foreach_get("co", flat)
        m = np.array(ob.matrix_world)
        p = (flat.reshape(-1, 3).astype(np.float64) @ m[:3, :3].T + m[:3, 3]) / SCALE
        if not np.isfinite(p).all():
            return p
        if previous is not None and frame > 10 and np.linalg.norm(p - previous, axis=1).mean() < still:
            break
        previous = p
    return p
