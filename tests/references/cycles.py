"""A scene file of ours as Blender's Cycles sees it: a picture that shares nothing with the project but its input.

    blender -b -P cycles.py -- SCENE ENVIRONMENT OUT.exr WIDTH HEIGHT SPP [--direct] [--camera NAME]
        [--as-imported] [--smooth-sky] [--seed K]

SCENE is a JSON scene, or a glTF file, of which the first camera counts or the one of that name. Of JSON materials
lambert, mirror and smooth glass have exact counterparts; others, and other layouts than lat-long, are refused. glTF
models come by Blender's own importer (it needs numpy), with its Principled BSDF, whose matte part glTF's
replaces; --as-imported leaves it. The picture is linear radiance in 32-bit floats. --direct leaves out all light that scattered at more than one
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
    parser.add_argument("--camera")
    parser.add_argument("--as-imported", action="store_true")
    parser.add_argument("--smooth-sky", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
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


def is_gltf(path):
    return path.lower().endswith((".gltf", ".glb"))


class Graph:
    """The nodes around one Principled BSDF."""

    def __init__(self, material, shader):
        self.tree, self.shader = material.node_tree, shader

    def connect(self, value, socket):
        """value: an output, or a constant as a socket has it."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif hasattr(socket.default_value, "__len__") and not hasattr(value, "__len__"):
            socket.default_value = (value, value, value, 1)
        else:
            socket.default_value = value

    def value(self, name):
        socket = self.shader.inputs[name]
        return socket.links[0].from_socket if socket.is_linked else socket.default_value

    def is_zero(self, name):
        return not self.shader.inputs[name].is_linked and self.value(name) == 0

    def math(self, operation, a, b):
        node = self.tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        self.connect(a, node.inputs[0])
        self.connect(b, node.inputs[1])
        return node.outputs[0]

    def times(self, colour, factor):
        node = self.tree.nodes.new("ShaderNodeMixRGB")
        node.blend_type, node.inputs[0].default_value = "MULTIPLY", 1
        self.connect(colour, node.inputs[1])
        self.connect(factor, node.inputs[2])
        return node.outputs[0]

    def cut_out(self, threshold):
        """MASK: Cycles does not know the material's threshold, which itself is surface."""
        self.connect(self.math("GREATER_THAN", self.value("Alpha"), threshold - 1e-6), self.shader.inputs["Alpha"])

    def use_lambert(self):
        """glTF's matte part is Lambert's below the surface's Fresnel reflection [glTF 2.0, B.3.5]. Principled, until
        Blender 4, has Disney's there, undimmed: a rough dielectric of base colour 0.8 returns 0.86."""
        base, metallic, shader = self.value("Base Color"), self.value("Metallic"), self.shader
        lambert, fresnel, face, sum_, holes, mix = (self.tree.nodes.new("ShaderNode" + kind) for kind in (
            "BsdfDiffuse", "Fresnel", "NewGeometry", "AddShader", "BsdfTransparent", "MixShader"))
        # The node takes the back of a face for the inside of a body, and the reciprocal of the index.
        side = self.math("SUBTRACT", 1, self.math("MULTIPLY", 2, face.outputs["Backfacing"]))
        self.connect(self.math("POWER", 1.5, side), fresnel.inputs["IOR"])
        if shader.inputs["Normal"].is_linked:
            self.connect(self.value("Normal"), lambert.inputs["Normal"])
            self.connect(self.value("Normal"), fresnel.inputs["Normal"])
        enters = self.math("MULTIPLY", self.math("SUBTRACT", 1, metallic), self.math("SUBTRACT", 1, fresnel.outputs[0]))
        self.connect(self.times(base, enters), lambert.inputs["Color"])
        self.connect(self.times(base, metallic), shader.inputs["Base Color"])
        ends = [link.to_socket for link in shader.outputs[0].links]
        self.connect(shader.outputs[0], sum_.inputs[0])
        self.connect(lambert.outputs[0], sum_.inputs[1])
        self.connect(self.value("Alpha"), mix.inputs[0])
        for link in list(shader.inputs["Alpha"].links):
            self.tree.links.remove(link)
        shader.inputs["Alpha"].default_value = 1
        self.connect(holes.outputs[0], mix.inputs[1])
        self.connect(sum_.outputs[0], mix.inputs[2])
        for end in ends:
            self.connect(mix.outputs[0], end)


def load_gltf(path, transform, as_imported):
    import addon_utils
    import numpy
    if not hasattr(numpy, "bool"):
        numpy.bool = bool  # Blender 3.4 uses a name that numpy 1.24 no longer has
    addon_utils.enable("io_scene_gltf2", default_set=True)
    before, materials = set(bpy.data.objects), set(bpy.data.materials)
    bpy.ops.import_scene.gltf(filepath=path)
    for thing in set(bpy.data.objects) - before:
        if thing.type == "LIGHT":
            refuse(f"{path} has lights, whose units differ")
        if not thing.parent:
            thing.matrix_world = UPRIGHT @ transform @ UPRIGHT.inverted() @ thing.matrix_world
    for material in set(bpy.data.materials) - materials:
        for shader in [n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"]:
            graph = Graph(material, shader)
            # A rough metal loses up to 60 % without further reflections between microfacets, a dielectric next to nothing;
            # there Cycles' MULTI_GGX beside a matte part adds half of the highlight to it.
            shader.distribution = "GGX" if graph.is_zero("Metallic") else "MULTI_GGX"
            if material.blend_method == "CLIP":
                graph.cut_out(material.alpha_threshold)
            if graph.is_zero("Transmission") and not as_imported:
                graph.use_lambert()


def load_model(folder, model, materials, as_imported):
    before = set(bpy.data.objects)
    path = os.path.join(folder, model["file"])
    if is_gltf(path):
        t = model.get("transform")
        return load_gltf(path, Matrix([t[row::4] for row in range(4)]) if t else Matrix(), as_imported)
    if path.lower().endswith(".obj"):
        bpy.ops.wm.obj_import(filepath=path, forward_axis="Y", up_axis="Z")  # axes as they stand in the file
    elif path.lower().endswith(".ply"):
        bpy.ops.import_mesh.ply(filepath=path)
    else:
        refuse(f"model '{model['file']}' is neither OBJ, PLY nor glTF")
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


def choose_camera(scene, name):
    """A camera of a glTF file. Its field of view is vertical whatever the picture's shape; clipping planes do not count."""
    cameras = [thing for thing in bpy.data.objects if thing.type == "CAMERA" and name in (None, thing.name)]
    if not cameras:
        refuse(f"there is no camera {name or ''}")
    scene.camera = cameras[0]
    if cameras[0].data.type != "PERSP" or cameras[0].data.sensor_fit != "VERTICAL":
        refuse("the importer made another kind of camera")
    cameras[0].data.clip_start, cameras[0].data.clip_end = 1e-3, 1e7


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


def light_by(scene, path, smooth):
    """The environment, texel by texel or, as a viewer sees it, smooth. Its middle is our +Z, which Cycles would put a quarter turn further left."""
    scene.world = bpy.data.worlds.new("environment")
    scene.world.use_nodes = True
    nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
    texels, turn, place = (nodes.new("ShaderNode" + kind) for kind in ("TexEnvironment", "VectorRotate", "TexCoord"))
    texels.image = bpy.data.images.load(os.path.abspath(path))
    texels.image.colorspace_settings.is_data = True
    texels.interpolation = "Linear" if smooth else "Closest"
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


def choose_paths(scene, spp, direct, seed):
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", spp, seed
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.max_bounces = cycles.glossy_bounces = cycles.transmission_bounces = BOUNCES
    cycles.transparent_max_bounces = 256  # one a card, hole or not
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
    desc = {"models": [{"file": os.path.basename(arguments.scene)}]}
    if not is_gltf(arguments.scene):
        with open(arguments.scene, encoding="utf-8") as file:
            desc = json.load(file)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    choose_paths(scene, arguments.spp, arguments.direct, arguments.seed)
    materials = {name: make_material(name, spec) for name, spec in desc.get("materials", {}).items()}
    for model in desc["models"]:
        load_model(os.path.dirname(arguments.scene), model, materials, arguments.as_imported)
    if is_gltf(arguments.scene):
        choose_camera(scene, arguments.camera)
    else:
        place_camera(scene, desc)
    light_by(scene, arguments.environment, arguments.smooth_sky)
    write_picture(scene, arguments.out, arguments.width, arguments.height)


try:
    main()
except Exception as fault:  # the traceback says where; Blender's exit code would not
    import traceback
    traceback.print_exc()
    refuse(repr(fault))
