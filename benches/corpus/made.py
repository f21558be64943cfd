"""Makes small scenes in Blender and exports each as glTF, one feature per file.

    pip install numpy bpy==5.0.1           # Python 3.11
    python3 benches/corpus/made.py FOLDER [NAME...]

Without names it makes all of them. The bytes depend on the exporter's version.
"""
import math
import sys
from pathlib import Path

import bpy
import numpy as np

GOLD = (0.9, 0.6, 0.2, 1.0)
BLUE = (0.1, 0.2, 0.8, 1.0)
WHITE = (0.8, 0.8, 0.8, 1.0)


def reset():
    bpy.ops.wm.read_factory_settings(use_empty=True)


def material(name, **inputs):
    """A Principled BSDF; an input's name is written with underscores."""
    made = bpy.data.materials.new(name)
    shader = made.node_tree.nodes["Principled BSDF"]
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    return made


def named(_result, name, material=None, location=None):
    """Names the active object, which the operator with this result has just made."""
    made = bpy.context.object
    made.name = made.data.name = name
    if material:
        made.data.materials.append(material)
    if location:
        made.location = location
    return made


def sphere(name, material, location, segments=24):
    made = named(bpy.ops.mesh.primitive_uv_sphere_add(segments=segments, ring_count=segments // 2, radius=0.45), name,
                 material, location)
    bpy.ops.object.shade_smooth()
    return made


def cube(name, material, location, size=0.8):
    return named(bpy.ops.mesh.primitive_cube_add(size=size), name, material, location)


def floor(surface=None, size=6.0):
    surface = surface or material("floor", Base_Color=WHITE)
    return named(bpy.ops.mesh.primitive_plane_add(size=size), "floor", surface, (0, 0, -0.5))


def light(kind, name, energy, location, aim=(0, 0, 0), **properties):
    data = bpy.data.lights.new(name, kind)
    data.energy = energy
    for key, value in properties.items():
        setattr(data, key, value)
    return placed(data, location, aim)


def camera(location, aim=(0, 0, 0), name="camera", **properties):
    data = bpy.data.cameras.new(name)
    for key, value in properties.items():
        setattr(data, key, value)
    made = placed(data, location, aim)
    bpy.context.scene.camera = made
    return made


def placed(data, location, aim):
    from mathutils import Vector
    made = bpy.data.objects.new(data.name, data)
    made.location = location
    made.rotation_euler = (Vector(aim) - Vector(location)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(made)
    return made


def image(name, pixels, is_color=True):
    """An image from an array of height x width x 3 with values in [0, 1]; row 0 is at the bottom."""
    height, width, _ = pixels.shape
    made = bpy.data.images.new(name, width, height)
    if not is_color:
        made.colorspace_settings.name = "Non-Color"
    made.pixels = np.dstack([pixels, np.ones((height, width))]).astype(np.float32).ravel()
    made.pack()
    return made


def checker(size=64, cells=8, low=(0.1, 0.1, 0.1), high=(0.9, 0.3, 0.2)):
    y, x = np.mgrid[:size, :size] * cells // size
    return np.where(((x + y) % 2)[..., None], np.array(high), np.array(low))


def bumps(size=64, cells=8, slope=0.4):
    """A normal map of waves in both directions."""
    y, x = np.mgrid[:size, :size] / size * cells * math.pi
    normals = np.dstack([slope * np.sin(x), slope * np.sin(y), np.ones_like(x)])
    return 0.5 + 0.5 * normals / np.linalg.norm(normals, axis=2, keepdims=True)


def textured(made, image, output="Color", target="Base Color", through=None, uv=None):
    """Connects an image to an input of the material's shader, if need be through a node in between."""
    tree = made.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    if uv:
        mapping, coordinates = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeUVMap")
        coordinates.uv_map = "UVMap"
        for key, value in uv.items():
            mapping.inputs[key].default_value = value
        tree.links.new(coordinates.outputs["UV"], mapping.inputs["Vector"])
        tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    source = texture.outputs[output]
    if through:
        between = tree.nodes.new(through)
        tree.links.new(source, between.inputs["Color"])
        source = between.outputs[{"ShaderNodeNormalMap": "Normal", "ShaderNodeSeparateColor": "Green"}[through]]
    tree.links.new(source, tree.nodes["Principled BSDF"].inputs[target])
    return made


def diffuse(name, color, **inputs):
    """A Lambert surface."""
    return material(name, Base_Color=color, Specular_IOR_Level=0.0, **inputs)


def still_life(surfaces, kind, segments):
    """Floor, sphere and cube with these materials, a camera, and one light: "point", "spot" or "area" (an emissive square)."""
    floor(surfaces[0])
    sphere("sphere", surfaces[1], (-0.6, 0, 0), segments)
    cube("cube", surfaces[2], (0.7, 0.2, -0.1)).rotation_euler = (0, 0, 0.5)
    if kind == "area":
        lamp = diffuse("lamp", (0, 0, 0, 1), Emission_Color=(1, 1, 1, 1), Emission_Strength=12.0)
        named(bpy.ops.mesh.primitive_plane_add(size=1.5), "lamp", lamp, (0.5, -1.5, 3)).rotation_euler = (3.6, 0, 0)
    else:
        shape = {"spot_size": 0.6, "spot_blend": 0.0} if kind == "spot" else {}
        light(kind.upper(), kind, 400, (1.5, -2.5, 3), shadow_soft_size=0.0, **shape)
    camera((0, -4, 1.5), (0, 0, -0.1), angle=0.7)
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 240


def from_blender():
    """The scene of docs/GUIDE.md, which is scenes/from-blender.glb."""
    still_life([diffuse("white", WHITE), material("gold", Base_Color=GOLD, Metallic=1.0, Roughness=0.5),
                material("plastic", Base_Color=BLUE, Roughness=0.4)], "area", 48)


def row(materials):
    floor()
    for number, made in enumerate(materials):
        sphere(made.name, made, (number - (len(materials) - 1) / 2, 0, 0))


def metals():
    row([material(f"metal {r}", Base_Color=GOLD, Metallic=1.0, Roughness=r) for r in (0.1, 0.3, 0.6, 1.0)])


def plastics():
    row([material(f"plastic {r}", Base_Color=BLUE, Roughness=r) for r in (0.1, 0.3, 0.6, 1.0)])


def glass():
    row([material("smooth", Transmission_Weight=1.0, Roughness=0.0, IOR=1.5),
         material("rough", Transmission_Weight=1.0, Roughness=0.3, IOR=1.33)])


def layers():
    row([material("clearcoat", Base_Color=BLUE, Coat_Weight=1.0), material("sheen", Base_Color=BLUE, Sheen_Weight=1.0),
         material("specular", Base_Color=BLUE, Specular_IOR_Level=1.0, Specular_Tint=GOLD),
         material("anisotropic", Base_Color=GOLD, Metallic=1.0, Roughness=0.3, Anisotropic=0.8)])


def emission():
    floor()
    sphere("lamp", material("lamp", Emission_Color=GOLD, Emission_Strength=20.0), (0, 0, 0.5))
    cube("cube", material("cube", Base_Color=BLUE), (1.2, 0, 0))


def base_color_texture():
    floor(textured(material("checker", Roughness=0.9), image("checker", checker())))
    cube("cube", textured(material("cube"), image("stripes", checker(64, 4, (0.2, 0.4, 0.9), (0.9, 0.9, 0.2)))), (0, 0, 0))


def roughness_texture():
    made = material("varied", Base_Color=GOLD, Metallic=1.0)
    pixels = checker(64, 8, (0, 0.2, 0), (0, 0.8, 0))
    floor(textured(made, image("roughness", pixels, False), "Color", "Roughness", "ShaderNodeSeparateColor"))
    sphere("sphere", material("sphere", Base_Color=BLUE), (0, 0, 0))


def normal_texture():
    made = material("bumps", Base_Color=WHITE)
    floor(textured(made, image("normals", bumps(), False), "Color", "Normal", "ShaderNodeNormalMap"))
    cube("cube", material("cube", Base_Color=BLUE), (0, 0, 0))


def texture_transform():
    made = material("moved", Roughness=0.9)
    uv = {"Location": (0.25, 0.1, 0), "Rotation": (0, 0, 0.5), "Scale": (2, 3, 1)}
    floor(textured(made, image("checker", checker(64, 2)), uv=uv))


def alpha():
    floor(textured(material("checker"), image("checker", checker())))
    blend = material("blend", Base_Color=BLUE, Alpha=0.4)
    blend.surface_render_method = "BLENDED"
    cube("cube", blend, (0, 0, 0.2))


def vertex_colors():
    floor()
    made = sphere("sphere", material("colored"), (0, 0, 0))
    colors = made.data.color_attributes.new("Color", "FLOAT_COLOR", "POINT")
    for index, vertex in enumerate(made.data.vertices):
        colors.data[index].color = (*(0.5 + c for c in vertex.co), 1.0)
    tree = made.data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "Color"
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])


def hierarchy():
    floor()
    made = material("link", Base_Color=GOLD)
    first = parent = cube("link 0", made, (0, 0, 0), 0.4)
    for number in range(1, 6):
        child = bpy.data.objects.new(f"link {number}", first.data)
        bpy.context.scene.collection.objects.link(child)
        child.parent = parent
        child.location, child.rotation_euler, child.scale = (0.5, 0, 0.1), (0, 0, 0.5), (0.8, 0.8, 1.2)
        parent = child
    mirrored = bpy.data.objects.new("mirrored", first.data)
    bpy.context.scene.collection.objects.link(mirrored)
    mirrored.location, mirrored.scale = (-1, 0, 0), (-1, 1, 1)


def instances():
    floor()
    data = cube("cube", material("cube", Base_Color=GOLD), (0, 0, 0), 0.3).data
    bpy.data.objects.remove(bpy.data.objects["cube"])
    parent = bpy.data.objects.new("rows", None)
    bpy.context.scene.collection.objects.link(parent)
    for number in range(25):
        made = bpy.data.objects.new(f"cube {number}", data)
        bpy.context.scene.collection.objects.link(made)
        made.parent, made.location = parent, (0.5 * (number % 5) - 1, 0.5 * (number // 5) - 1, 0)


def lights():
    row([material("a", Base_Color=WHITE), material("b", Base_Color=BLUE), material("c", Base_Color=GOLD)])
    light("POINT", "point", 100, (-2, -2, 2))
    light("SPOT", "spot", 300, (2, -2, 3), spot_size=0.8, spot_blend=0.3)
    camera((0, -6, 2.5))


def sun_and_orthographic():
    row([material("a", Base_Color=WHITE)])
    light("SUN", "sun", 3, (1, -1, 3))
    camera((0, -6, 2.5), type="ORTHO", ortho_scale=4)


def skin():
    made = named(bpy.ops.mesh.primitive_cylinder_add(vertices=16, depth=2, radius=0.3), "arm", material("arm", Base_Color=GOLD))
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide(number_cuts=6)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.object.armature_add(location=(0, 0, -1))
    rig = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    bones = rig.data.edit_bones
    bones[0].tail = (0, 0, 1)
    upper = bones.new("upper")
    upper.head, upper.tail, upper.parent = (0, 0, 1), (0, 0, 2), bones[0]
    bpy.ops.object.mode_set(mode="OBJECT")
    made.select_set(True)
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    rig.pose.bones["upper"].rotation_mode = "XYZ"
    rig.pose.bones["upper"].rotation_euler = (1.0, 0, 0)


def morph():
    floor()
    made = cube("cube", material("cube", Base_Color=GOLD), (0, 0, 0))
    made.shape_key_add(name="Basis")
    key = made.shape_key_add(name="taller")
    for point, vertex in zip(key.data, made.data.vertices):
        point.co = vertex.co * (1.0 if vertex.co.z < 0 else 1.5)
    key.value = 1.0


def modifiers():
    floor()
    made = named(bpy.ops.mesh.primitive_monkey_add(size=1), "monkey", material("monkey", Base_Color=GOLD, Roughness=0.4))
    made.modifiers.new("smooth", "SUBSURF").levels = 1
    made.modifiers.new("copies", "ARRAY").count = 2


def text():
    bpy.ops.object.text_add(rotation=(math.pi / 2, 0, 0))
    made = bpy.context.object
    made.data.body, made.data.extrude = "gate", 0.1
    made.data.materials.append(material("letters", Base_Color=BLUE))


# Name, function, further arguments of the exporter.
SCENES = [(f.__name__, f, {}) for f in (
    metals, plastics, glass, layers, emission, base_color_texture, roughness_texture, normal_texture, texture_transform, alpha,
    vertex_colors, hierarchy, instances, lights, sun_and_orthographic, skin, morph, modifiers, text, from_blender)]
SCENES += [
    ("lights_in_candela", lights, {"export_import_convert_lighting_mode": "SPEC"}),
    ("gpu_instances", instances, {"export_gpu_instances": True}),
    ("draco", modifiers, {"export_draco_mesh_compression_enable": True}),
    ("webp", base_color_texture, {"export_image_format": "WEBP"}),
    ("jpeg", base_color_texture, {"export_image_format": "JPEG"}),
    ("separate_files", base_color_texture, {"export_format": "GLTF_SEPARATE"}),
]


def export(path, **options):
    """Exports the scene with the settings that docs/GUIDE.md recommends, unless `options` override them."""
    settings = {"export_cameras": True, "export_lights": True, "export_extras": True, "export_apply": True,
                "export_import_convert_lighting_mode": "COMPAT", "export_vertex_color": "MATERIAL"}
    bpy.ops.export_scene.gltf(filepath=str(path), **{**settings, **options})


def main():
    folder, names = Path(sys.argv[1]), sys.argv[2:]
    folder.mkdir(parents=True, exist_ok=True)
    for name, make, options in SCENES:
        if not names or name in names:
            reset()
            make()
            # Applying modifiers removes shape keys.
            export(folder / f"{name}.glb", **{"export_apply": make not in (morph, skin),
                                              "export_rest_position_armature": make is not skin, **options})


if __name__ == "__main__":
    main()
