"""A scene file of ours as Blender's Cycles sees it: a picture that shares nothing with the project but its input.

    blender -b -P cycles.py -- SCENE.json ENVIRONMENT OUT.exr WIDTH HEIGHT SPP [--direct]

Lambert, mirror and smooth glass have exact counterparts there; other materials, glTF and other layouts than lat-long are
refused. The picture is linear radiance in 32-bit floats. --direct leaves out all light that scattered at more than one
matte surface. What differs without being anybody's mistake: Cycles averages the pixel over other camera rays, shades
interpolated normals at grazing angles in its own way, cuts paths after BOUNCES events, and does not scale radiance by
n^2 within glass, which shows only on a matte thing that stands inside glass.
"""
import argparse
import json
import math
import os
import sys

import bpy
from mathutils import Matrix, Vector

BOUNCES = 24
# Blender's Z points up where ours does Y: a quarter turn about X, (x, y, z) -> (x, -z, y).
UPRIGHT = Matrix.Rotation(math.pi / 2, 4, "X")


def refuse(text):
    # sys.exit would be swallowed: Blender ends with 0 after an error in a script.
    print(f"cycles.py: {text}", file=sys.stderr, flush=True)
    os._exit(1)


def read_arguments():
    parser = argparse.ArgumentParser(prog="cycles.py")
    for name, kind in (("scene", str), ("environment", str), ("out", str), ("width", int), ("height", int), ("spp", int)):
        parser.add_argument(name, type=kind)
    parser.add_argument("--direct", action="store_true")
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1:])


def make_material(name, spec):
    """One node that scatters, straight into the output."""
    shaders = {"lambert": ("ShaderNodeBsdfDiffuse", {"Color": spec.get("albedo")}),
               "mirror": ("ShaderNodeBsdfGlossy", {"Color": spec.get("reflectance", [1, 1, 1])}),
               "glass": ("ShaderNodeBsdfGlass", {"Color": [1, 1, 1], "IOR": spec.get("ior", 1.5)})}
    if spec["type"] not in shaders:
        refuse(f"material '{name}' is {spec['type']}, of which Cycles has no exact counterpart")
    kind, inputs = shaders[spec["type"]]
    material = bpy.data.materials.new("scene file: " + name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    shader, output = nodes.new(kind), nodes.new("ShaderNodeOutputMaterial")
    if hasattr(shader, "distribution"):
        shader.distribution = "SHARP"
    else:
        shader.inputs["Roughness"].default_value = 0.0  # else Oren and Nayar's
    for key, value in inputs.items():
        shader.inputs[key].default_value = (*value, 1.0) if isinstance(value, list) else value
    links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    return material


def load_model(folder, model, materials):
    before = set(bpy.data.objects)
    path = os.path.join(folder, model["file"])
    if path.lower().endswith(".obj"):
        bpy.ops.wm.obj_import(filepath=path, forward_axis="Y", up_axis="Z")  # axes as they stand in the file
    elif path.lower().endswith(".ply"):
        bpy.ops.import_mesh.ply(filepath=path)
    else:
        refuse(f"model '{model['file']}' is neither OBJ nor PLY")
    t = model.get("transform")
    world = UPRIGHT @ (Matrix([t[row::4] for row in range(4)]) if t else Matrix())
    for thing in set(bpy.data.objects) - before:
        thing.matrix_world = world
        mesh = thing.data
        if "material" in model:
            mesh.materials.clear()
            mesh.materials.append(materials[model["material"]])
        else:
            for slot in thing.material_slots:
                # Blender numbers names that are taken; they are not, because imported materials are removed below.
                slot.material = materials[slot.material.name]
        # Normals of the file live in auto smooth; flat polygons ignore them.
        for polygon in mesh.polygons:
            polygon.use_smooth = bool(model.get("smooth", False))
    for imported in set(bpy.data.materials) - set(materials.values()):
        bpy.data.materials.remove(imported)


def place_camera(scene, desc):
    cameras = desc.get("cameras", [])
    spec = desc.get("camera") or (cameras if isinstance(cameras, list) else list(cameras.values()))[0]
    back = (Vector(spec["position"]) - Vector(spec["look_at"])).normalized()
    right = Vector(spec.get("up", [0, 1, 0])).cross(back).normalized()
    frame = Matrix((right, back.cross(right), back)).transposed().to_4x4()  # a camera looks along its -Z
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.angle_y = "VERTICAL", math.radians(spec["fov_y_degrees"])
    camera.clip_start, camera.clip_end = 1e-3, 1e7
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.camera.matrix_world = UPRIGHT @ Matrix.Translation(spec["position"]) @ frame
    scene.collection.objects.link(scene.camera)


def light_by(scene, path):
    """The environment, texel by texel. Its middle is our +Z, which Cycles would put a quarter turn further left."""
    scene.world = bpy.data.worlds.new("environment")
    scene.world.use_nodes = True
    nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
    texels, turn, place = (nodes.new("ShaderNode" + kind) for kind in ("TexEnvironment", "VectorRotate", "TexCoord"))
    texels.image = bpy.data.images.load(os.path.abspath(path))
    texels.image.colorspace_settings.is_data = True
    texels.interpolation = "Closest"
    turn.rotation_type = "Z_AXIS"
    turn.inputs["Angle"].default_value = math.pi / 2
    links.new(place.outputs["Generated"], turn.inputs["Vector"])
    links.new(turn.outputs["Vector"], texels.inputs["Vector"])
    links.new(texels.outputs["Color"], nodes["Background"].inputs["Color"])
    width, height = texels.image.size
    if width != 2 * height:
        refuse(f"{path} is {width}x{height}, not lat-long")
    # What Cycles samples must be as fine as what it looks up, or it finds the sun by accident only.
    scene.world.cycles.sampling_method = "MANUAL"
    scene.world.cycles.sample_map_resolution = min(max(width, 1024), 8192)


def choose_paths(scene, spp, direct):
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", spp, 0
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.max_bounces = cycles.glossy_bounces = cycles.transmission_bounces = BOUNCES
    cycles.diffuse_bounces = 0 if direct else BOUNCES
    # Nothing that trades truth for calm.
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.blur_glossy = cycles.light_sampling_threshold = 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0


def write_picture(scene, path, width, height):
    scene.view_settings.view_transform = "Raw"
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    picture = render.image_settings
    picture.file_format, picture.color_mode, picture.color_depth, picture.exr_codec = "OPEN_EXR", "RGB", "32", "ZIP"
    render.filepath = os.path.abspath(path)
    bpy.ops.render.render(write_still=True)


def main():
    arguments = read_arguments()
    with open(arguments.scene, encoding="utf-8") as file:
        desc = json.load(file)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    choose_paths(scene, arguments.spp, arguments.direct)
    materials = {name: make_material(name, spec) for name, spec in desc.get("materials", {}).items()}
    for model in desc["models"]:
        load_model(os.path.dirname(arguments.scene), model, materials)
    place_camera(scene, desc)
    light_by(scene, arguments.environment)
    write_picture(scene, arguments.out, arguments.width, arguments.height)


try:
    main()
except Exception as fault:  # the traceback says where; Blender's exit code would not
    import traceback
    traceback.print_exc()
    refuse(repr(fault))
